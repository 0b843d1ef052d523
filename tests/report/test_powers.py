"""The figure of a light sweep: where the head is, what is drawn of it, and what is measured."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from augment.color_camera import ColorCamera
from augment.light import LightConfig
from augment.photograph import develop, photograph
from augment.srgb import linear
from report.powers import (
    ABOVE,
    COLUMNS,
    GAP,
    LABEL,
    MARGIN,
    PAPER,
    SIDE,
    TITLE,
    Photographs,
    brightened,
    figure,
    handful,
    head_box,
    main,
    read,
    signal_to_noise,
)
from shards.archive import Shard, write_shard
from shards.dataset import Dataset, DatasetWriter
from shards.schema import RADIANCE_WATTS
from shards.sweep import power_folder, write_index
from tests.report.conftest import Build
from tests.shards.conftest import HEIGHT, PIXEL, WIDTH

POWERS = [2000.0, 500.0, 100.0]
CROWN, MIDDLE = 0.3, 0.8
"""Of the figure's head, metres from the image's top and left."""
EXPOSURE = 0.06


def person(
    pixel_size: float, hand: float, crown: float = CROWN, middle: float = MIDDLE, hair: float = 0
) -> np.ndarray:
    """(H, W) silhouette of 1.28 m x 1.92 m: a trunk, a head, and a hand raised above it.

    hand: radius, metres; hair: metres that stand around the head.
    """
    rows, columns = round(HEIGHT * PIXEL / pixel_size), round(WIDTH * PIXEL / pixel_size)
    y = (np.arange(rows)[:, None] + 0.5) * pixel_size
    x = (np.arange(columns)[None] + 0.5) * pixel_size
    head = np.hypot((x - middle) / 0.08, (y - crown - 0.12) / 0.12) <= 1 + hair / 0.12
    trunk = (abs(x - middle) < 0.2) & (y > crown + 0.28)
    neck = (abs(x - middle) < 0.05) & (y > crown + 0.1)
    arm = (abs(x - middle - 0.3) < 0.04) & (y > 0.1) & (y < crown + 0.4)
    return head | trunk | neck | arm | (np.hypot(x - middle - 0.3, y - 0.1) <= hand)


@pytest.mark.parametrize("pixel_size", [0.02, 0.005, 0.0025])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_head_is_found_below_a_raised_hand(pixel_size: float, mirrored: bool) -> None:
    silhouette = person(pixel_size, 0.05)
    box = head_box(silhouette[:, ::-1] if mirrored else silhouette, pixel_size)
    assert box is not None
    left, top, side = (n * pixel_size for n in box)
    middle = WIDTH * PIXEL - MIDDLE if mirrored else MIDDLE
    assert side == pytest.approx(SIDE, abs=pixel_size / 2)
    # An ellipse is narrower at its crown than the disc that is laid into it.
    assert top + ABOVE == pytest.approx(CROWN + 0.015, abs=0.015 + pixel_size)
    assert left + side / 2 == pytest.approx(middle, abs=1.5 * pixel_size)


def test_a_hand_as_wide_as_a_head_is_taken_for_one() -> None:
    """The limit that `head_box` tells of."""
    box = head_box(person(0.005, 0.08), 0.005)
    assert box is not None
    assert box[1] * 0.005 + ABOVE < 0.05


def test_no_head_where_all_is_slim() -> None:
    assert head_box(np.zeros((40, 40), dtype=bool), 0.02) is None
    slim = np.zeros((40, 40), dtype=bool)
    slim[:, 18:22] = True
    assert head_box(slim, 0.02) is None


def test_a_head_need_not_be_above_its_trunk_nor_all_in_the_image() -> None:
    silhouette = np.zeros((60, 60), dtype=bool)
    silhouette[:10, 10:21] = True
    silhouette[12:50, 25:50] = True
    assert head_box(silhouette, 0.02) == (7, round(-ABOVE / 0.02), 17)


def test_light_is_scaled_in_linear_light() -> None:
    every = np.arange(256, dtype=np.uint8).reshape(-1, 1).repeat(3, axis=1)
    np.testing.assert_array_equal(develop(linear(every / 255)), every)
    np.testing.assert_array_equal(brightened(every, 1.0), every)
    for factor in (2.0, 20.0):
        light = factor * linear(every / 255)
        # A byte's rounding is at most half of the steepest step.
        np.testing.assert_allclose(
            linear(brightened(every, factor) / 255), np.minimum(light, 1), atol=0.5 * 2.3 / 255
        )
        assert (brightened(every, factor)[light > 1] == 255).all()


@pytest.mark.parametrize("light", [0.5, 0.05, 0.01])
def test_noise_is_that_of_the_camera(light: float) -> None:
    camera = ColorCamera(full_well=2000.0, read_noise=5.0)
    exposed = np.full((20_000, 3), light)
    colors = camera.photograph(exposed, np.random.default_rng(1))
    electrons = light * camera.full_well
    expected = 20 * math.log10(electrons / math.sqrt(electrons + camera.read_noise**2))
    assert signal_to_noise(colors, exposed) == pytest.approx(expected, abs=0.3)


def test_no_noise_has_no_ratio() -> None:
    colors = np.full((5, 3), 90, dtype=np.uint8)
    assert math.isnan(signal_to_noise(colors, linear(colors / 255)))
    assert math.isnan(signal_to_noise(colors[:0], linear(colors[:0] / 255)))
    assert math.isnan(signal_to_noise(colors, np.zeros((5, 3))))


@pytest.mark.parametrize(
    ("powers", "expected"),
    [
        ([2000.0 - 100 * k for k in range(20)], [2000, 1000, 500, 200, 100]),
        ([2000.0, 1900.0], [2000, 1900]),
        ([60.0], [60]),
    ],
)
def test_a_handful_spans_the_powers(powers: list[float], expected: list[float]) -> None:
    assert handful(powers) == expected


def photographs(powers: list[float], side: int) -> Photographs:
    """Every pixel of every power another colour; the left column is beyond the subject."""
    rng = np.random.default_rng(0)
    seen = np.ones((side, side), dtype=bool)
    seen[:, 0] = False
    colors = {p: rng.integers(0, 256, (side, side, 3)).astype(np.uint8) for p in powers}
    return Photographs("one", seen, colors, None)


@pytest.mark.parametrize(("count", "side"), [(1, 17), (4, 68), (7, 136), (20, 68), (6, 300)])
def test_a_pixel_is_a_square_of_the_page(count: int, side: int) -> None:
    shown = photographs([100.0 * (count - k) for k in range(count)], side)
    page = np.asarray(figure(shown))
    scale = max(280 // side, 1)
    tile = scale * side
    assert page.shape[1] == 2 * MARGIN + COLUMNS * tile + (COLUMNS - 1) * GAP
    line = LABEL + tile + GAP

    def drawn(top: int, k: int) -> np.ndarray:
        left = MARGIN + k * (tile + GAP)
        part = page[top + LABEL : top + LABEL + tile, left : left + tile]
        blocks = part.reshape(side, scale, side, scale, 3)
        assert (blocks == blocks[:, :1, :, :1]).all()
        assert (blocks[:, 0, 0, 0] == PAPER).all()
        return blocks[:, 0, 1:, 0]

    for k, colors in enumerate(shown.colors.values()):
        row, column = divmod(k, COLUMNS)
        np.testing.assert_array_equal(drawn(MARGIN + TITLE + row * line, column), colors[:, 1:])
    pairs = MARGIN + 2 * TITLE + math.ceil(count / COLUMNS) * line
    few = handful(list(shown.colors))
    for k, power in enumerate(few):
        colors = shown.colors[power][:, 1:]
        np.testing.assert_array_equal(drawn(pairs, k), colors)
        bright = brightened(colors, 100.0 * count / power)
        np.testing.assert_array_equal(drawn(pairs + line, k), bright)


def test_the_ratio_has_a_chart_of_its_own_only_if_it_is_known() -> None:
    unknown = photographs(POWERS, 17)
    light = {p: linear(colors / 255) * 0.9 for p, colors in unknown.colors.items()}
    known = Photographs("one", unknown.seen, unknown.colors, light)
    without, pages = np.asarray(figure(unknown)), np.asarray(figure(known))
    assert without.shape == pages.shape
    differing = np.flatnonzero((without != pages).any(axis=(1, 2)))
    assert differing.size
    assert differing[0] > without.shape[0] - 300


Made = Callable[..., Path]


@pytest.fixture
def sweep(build: Build, tmp_path: Path) -> Made:
    """sweep(radiance, base_noise, noise, body, crown): the folder of a sweep of one subject, "a".

    radiance: whether the base keeps it; base_noise, noise: whether the base's and the sweep's
    colours have a camera's noise; body: whether the subject has one; crown: as `person` has it.

    Its head is red from the front and, from behind, its left half (seen from the front) is green;
    it has hair, a hand above, and two views, turned by 40 and by -3 degrees.
    """

    def sweep(
        radiance: bool = False,
        base_noise: bool = False,
        noise: bool = True,
        body: bool = True,
        crown: float = CROWN,
    ) -> Path:
        mask = person(PIXEL, 0.05, crown, hair=0.04)
        bare = person(PIXEL, 0.05, crown) if body else np.zeros_like(mask)
        light = {side: np.zeros((HEIGHT, WIDTH, 3), np.float32) for side in ("front", "back")}
        light["front"][mask] = (0.004, 0.001, 0.001)
        light["back"][mask] = (0.001, 0.001, 0.004)
        light["back"][:, : round(MIDDLE / PIXEL)][mask[:, : round(MIDDLE / PIXEL)]] = (
            (0.001, 0.004, 0.001)
        )  # fmt: skip
        maps: dict[str, np.ndarray] = {
            "mask": mask,
            "body_depth_front": np.where(bare, 2.0, 0.0),
            **{f"rgb_{side}": develop(120 * image) for side, image in light.items()},
        }
        data = build({"a": {"maps": maps, "yaw_deg": [40.0, -3.0]}})
        path = data / "shards" / "a.npz"
        plain = Shard(path)
        meta = plain.meta | {"light": {"power": 2000.0, "position": [0, 0, 0], "exposure": 0.06}}
        if base_noise:
            meta["color_camera"] = {"full_well": 8000.0}
        arrays = {name: plain[name] for name in plain.names}
        if radiance:
            for side, image in light.items():
                arrays[f"radiance_{side}"] = np.stack([image * RADIANCE_WATTS] * 2).astype("<f2")
        sha256 = write_shard(path, arrays, meta)[1]
        folder = tmp_path / "sweep"
        folder.mkdir()
        write_index(folder, data, {}, POWERS)
        base = Dataset(data)
        camera = ColorCamera() if noise else None
        for power in POWERS:
            lamp = LightConfig(power, (0.0, 0.0, 0.0), EXPOSURE)
            with DatasetWriter(
                folder / power_folder(power), {"power": power}, ["a"], 7, {}, base
            ) as writer:
                colors = {
                    f"rgb_{side}": photograph(
                        [image[mask]] * 2, np.stack([mask] * 2), lamp, camera, (7, "a", side)
                    )
                    for side, image in light.items()
                }
                own = meta | {
                    "light": {"power": power, "position": [0, 0, 0], "exposure": EXPOSURE},
                    "color_camera": {"full_well": 8000.0} if noise else None,
                    "base": {
                        "shard": "base/shards/a.npz",
                        "contents": Shard(path).contents,
                        "sha256": sha256,
                    },
                }
                written = write_shard(writer.shard_path("a"), colors, own, base=Shard(path))
                writer.add("a", *written, 1.0, "CC0-1.0")
                writer.finish()
        return folder

    return sweep


def test_every_power_is_cut_alike_from_the_view_turned_least(sweep: Made) -> None:
    folder = sweep()
    found = read(folder, None, None, False)
    assert list(found.colors) == POWERS
    assert found.caption == "a, the view turned least, yaw -3.0°; exposure 0.06 for all"
    box = head_box(person(PIXEL, 0.05), PIXEL)
    assert box is not None
    left, top, side = box
    part = (slice(top, top + side), slice(left, left + side))
    for power, colors in found.colors.items():
        whole = Dataset(folder / power_folder(power)).shard("a").view(1, ["rgb_front"])
        np.testing.assert_array_equal(colors, whole["rgb_front"][part])
    np.testing.assert_array_equal(found.seen, person(PIXEL, 0.05, hair=0.04)[part])
    assert "view 0, yaw 40.0°" in read(folder, "a", 0, False).caption


def test_the_mask_serves_where_there_is_no_body(sweep: Made) -> None:
    found = read(sweep(body=False), None, None, False)
    box = head_box(person(PIXEL, 0.05, hair=0.04), PIXEL)
    assert box is not None
    left, top, side = box
    hairy = person(PIXEL, 0.05, hair=0.04)[top : top + side, left : left + side]
    np.testing.assert_array_equal(found.seen, hairy)


def test_the_back_is_turned_over(sweep: Made) -> None:
    found = read(sweep(), None, None, True)
    colors, side = found.colors[2000.0], len(found.seen)
    left, right = colors[side // 2, side // 2 - 3], colors[side // 2, side // 2 + 3]
    # What is on the left from the front is on the right from behind.
    assert left.argmax() == 2
    assert right.argmax() == 1
    assert "a from behind" in found.caption


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("radiance", [False, True])
def test_noise_is_told_from_the_base(sweep: Made, radiance: bool, back: bool) -> None:
    found = read(sweep(radiance=radiance, base_noise=radiance), None, None, back)
    assert found.light is not None
    for power, light in found.light.items():
        brightest = 0.004 * power * EXPOSURE
        assert light[found.seen].max() == pytest.approx(brightest, rel=0.02)
        # 99 % lie within two and a half standard deviations, and half a byte.
        off = linear(found.colors[power] / 255) - light
        bound = 2.5 * np.sqrt(light * 8000 + 9) / 8000 + 0.5 / 255 / 12.92
        assert (abs(off)[found.seen] < bound[found.seen]).mean() > 0.95
    ratios = [
        signal_to_noise(found.colors[p][found.seen], found.light[p][found.seen]) for p in POWERS
    ]
    assert ratios == sorted(ratios, reverse=True)


@pytest.mark.parametrize("given", [{"noise": False}, {"base_noise": True}])
def test_noise_is_left_out_where_it_cannot_be_told(sweep: Made, given: dict[str, bool]) -> None:
    assert read(sweep(**given), None, None, False).light is None


def test_beyond_the_image_s_edge_there_is_nothing(sweep: Made) -> None:
    found = read(sweep(crown=-0.02), None, None, False)
    silhouette = person(PIXEL, 0.05, crown=-0.02, hair=0.04)
    box = head_box(person(PIXEL, 0.05, crown=-0.02), PIXEL)
    assert box is not None
    left, top, side = box
    assert top < 0
    assert found.seen.shape == (side, side)
    assert not found.seen[:-top].any()
    np.testing.assert_array_equal(found.seen[-top:], silhouette[: top + side, left : left + side])


def test_a_call_writes_the_picture(
    sweep: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "powers.png"
    monkeypatch.setattr(sys, "argv", ["powers", str(sweep()), "--output", str(output)])
    assert main() == 0
    with Image.open(output) as image:
        assert image.width == 2 * MARGIN + 5 * 272 + 4 * GAP


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--subject", "b"], "has no finished subject 'b'"),
        (["--view", "7"], "a has views 0 to 1, not 7; set --view"),
        (None, "holds no sweep.json; name a folder of a sweep"),
    ],
)
def test_a_wrong_call_says_why_in_one_line(
    sweep: Made,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str] | None,
    words: str,
) -> None:
    folder = sweep()
    if options is None:
        folder, options = tmp_path / "dataset", []
    output = tmp_path / "powers.png"
    monkeypatch.setattr(sys, "argv", ["powers", str(folder), "--output", str(output), *options])
    assert main() == 2
    message = capsys.readouterr().err
    assert message.startswith("error: ")
    assert words in message
    assert message.count("\n") == 1
    assert not output.exists()
