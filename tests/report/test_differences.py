"""Differences between front and back of surfaces that are known in closed form."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from report import differences as report
from report.differences import BINS, compare, differences, pooled, statistics, table
from shards.dataset import Dataset

HEIGHT, WIDTH = 64, 96
INSIDE = np.zeros((HEIGHT, WIDTH), dtype=bool)
INSIDE[4:60, 30:70] = True


def maps(front: np.ndarray, back: np.ndarray, mask: np.ndarray = INSIDE) -> dict[str, np.ndarray]:
    """A view with these depths in metres, and colours that tell the sides apart."""
    return {
        "mask": mask,
        "depth_front": np.where(mask, front, 0),
        "depth_back": np.where(mask, back, 0),
        "rgb_front": np.where(mask[..., None], (200, 40, 40), 0),
        "rgb_back": np.where(mask[..., None], (40, 40, 200), 0),
    }


def mirrored() -> dict[str, np.ndarray]:
    """Front and back the same, each seen from its own camera."""
    bulge = 0.1 * np.sin(np.linspace(0, np.pi, WIDTH)) * np.ones((HEIGHT, 1))
    return maps(2.0 - bulge, 2.0 + bulge)


def stepping(share: float) -> dict[str, np.ndarray]:
    """`share` of the columns of a slab stand 80 mm ahead of the others."""
    ahead = np.zeros((HEIGHT, WIDTH))
    ahead[:, 30 : 30 + round(40 * share)] = 0.08
    return maps(1.9 - ahead, 2.1 - ahead)


def test_a_mirrored_body_has_no_difference_wherever_it_stands() -> None:
    for shift in (0.0, 0.37):
        view = mirrored()
        found = differences(view["mask"], view["depth_front"] + shift, view["depth_back"] + shift)
        assert np.isnan(found[~INSIDE]).all()
        assert found[INSIDE].max() == 0.0
        assert statistics(found).counts == (INSIDE.sum(), *[0] * 11)


def test_a_leg_set_forward_differs_by_twice_its_step() -> None:
    view = stepping(0.25)
    found = differences(view["mask"], view["depth_front"], view["depth_back"])
    # The front is farthest where it did not step, the back is nearest where it did: from there
    # both sides of the leg are 80 mm off, and so is all the rest, the other way round.
    assert found[INSIDE] == pytest.approx(80.0, abs=1e-3)
    # A slab that leans differs by twice what it leans, from none in its middle.
    lean = np.linspace(0, 0.2, WIDTH) * np.ones((HEIGHT, 1))
    found = differences(INSIDE, 1.9 + lean, 2.1 + lean)
    due = np.abs(2 * lean - (lean[INSIDE].max() + lean[INSIDE].min())) * 1000
    assert found[INSIDE] == pytest.approx(due[INSIDE], abs=1e-3)


def test_one_stray_point_moves_the_whole_surface_unless_left_out() -> None:
    view = mirrored()
    view["depth_front"][10, 40] = 2.6
    found = statistics(differences(view["mask"], view["depth_front"], view["depth_back"]))
    assert found.above_100 > 0.99
    spared = differences(view["mask"], view["depth_front"], view["depth_back"], left_out=0.001)
    assert np.median(spared[INSIDE]) < 1.0
    assert np.nanmax(spared) > 500.0


def test_each_bin_ends_with_its_number() -> None:
    edges = np.array(
        [0.0, 0.001, 10.0, 10.001, 40.0, 40.001, 90.001, 100.0, 100.001, 350.0, np.nan]
    )
    found = statistics(edges)
    assert dict(zip(BINS, found.counts, strict=True)) == {
        "0": 1, "10": 2, "20": 1, "30": 0, "40": 1, "50": 1,
        "60": 0, "70": 0, "80": 0, "90": 0, "100": 2, ">100": 2,
    }  # fmt: skip
    assert (found.pixels, found.largest) == (10, 350.0)
    assert found.up_to_40 == 0.5
    assert found.above_100 == 0.2
    both = pooled([found, statistics(np.array([400.0, 5.0]))])
    assert (both.pixels, both.largest, both.above_100) == (12, 400.0, 0.25)
    with pytest.raises(ValueError, match="no pixel"):
        statistics(np.full((2, 2), np.nan))


def leaning(millimetres: float) -> dict[str, np.ndarray]:
    lean = np.linspace(0, millimetres / 1000, WIDTH) * np.ones((HEIGHT, 1))
    return maps(1.9 + lean, 2.1 + lean)


@pytest.fixture
def folder(build: Any) -> Path:
    """Three subjects, from none to wide differences, and one without a pose's name."""
    return build(
        {
            "calm": {"maps": mirrored(), "body": {"pose": "stand", "hard": False}},
            "plain": {"maps": leaning(100), "body": {}},
            "wild": {"maps": leaning(600), "body": {"pose": {"name": "deep_bow", "hard": True}}},
        }
    )


def spaced(text: str) -> str:
    """Each run of blanks as one."""
    return " ".join(text.split())


def test_the_table_tells_each_subject_and_the_set(folder: Path) -> None:
    found = compare(Dataset(folder), 0)
    assert [(c.subject, c.pose) for c in found] == [
        ("calm", "stand"),
        ("plain", "-"),
        ("wild", "deep_bow"),
    ]
    calm, _, wild = (c.whole for c in found)
    assert (calm.up_to_40, calm.above_100) == (1.0, 0.0)
    # 600 mm over 95 steps: 39 of them lie between the ends, and differ by -246 to 246 mm.
    assert wild.above_100 == (40 - 16) / 40
    assert wild.largest == pytest.approx(600 * 39 / 95, abs=1e-3)
    text = table(found)
    assert "calm stand 2240 100.00% 0.00% 0 mm" in spaced(text)
    assert "1 of 3 subjects have 25% or more" in text


def call(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["report.differences", *arguments])
    return report.main()


def test_the_figure_shows_the_easiest_and_the_hardest(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    output = folder.parent / "figure.png"
    assert call(monkeypatch, str(folder), "--output", str(output), "--rows", "0.5", "0.25") == 0
    said = capsys.readouterr().out
    assert "calm, row 32: 100.00% up to 40 mm" in said
    assert "wild, row 18:" in said
    with Image.open(output) as image:
        shown = np.asarray(image.convert("RGB")).astype(int)
    # The bars, the rows' lines and both sides of both subjects.
    for colour in ((0, 114, 178), (213, 94, 0), (150, 150, 150), (200, 40, 40), (40, 40, 200)):
        assert (np.abs(shown - colour).max(axis=2) <= 2).sum() > 500, colour
    first = output.read_bytes()
    call(monkeypatch, str(folder), "--output", str(output), "--easy", "wild", "--hard", "calm")
    assert output.read_bytes() != first
    assert capsys.readouterr().out.index("wild, row") > 0


def test_hard_and_easy_subjects_are_pooled_and_counted_apart(build: Any) -> None:
    easy, hard = {"pose": "stand"}, {"pose": "deep_bow", "hard": True}
    found = compare(
        Dataset(
            build(
                {
                    "a": {"maps": mirrored(), "body": easy},
                    "b": {"maps": leaning(200), "body": easy},
                    "c": {"maps": leaning(600), "body": hard},
                    "d": {"maps": mirrored(), "body": hard},
                    "e": {"maps": leaning(600), "body": {}},
                }
            )
        ),
        None,
    )
    assert [(c.easy, c.hard) for c in found] == [
        *[(True, False)] * 2,
        *[(False, True)] * 2,
        (False, False),
    ]
    text = table(found)
    assert "c deep_bow* 2240" in spaced(text)
    # Of 40 columns of 600 mm over 95 steps, 6 differ by up to 40 mm.
    calm, lean = found[0].whole, found[1].whole
    share = (calm.up_to_40 + lean.up_to_40) / 2
    assert 0.5 <= lean.up_to_40 < share < 1.0
    assert f"easy poses, 2 4480 {share:.2%}" in spaced(text)
    assert "hard poses*, 2 4480 57.50% 30.00%" in spaced(text)
    assert "2 of 5 subjects have 25% or more of their pixels above 100 mm" in text
    assert "1 of 2 hard subjects have 25% or more of their pixels above 100 mm" in text
    assert "2 of 2 easy subjects have 50% or more of their pixels up to 40 mm" in text
    assert "1 of 2 easy subjects have 75% or more of their pixels up to 40 mm" in text
    assert "hard" not in table(found[:1])


def test_the_view_turned_least_is_shown_unless_one_is_asked_for(
    build: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = build(
        {
            "a": {"maps": mirrored(), "yaw_deg": [30.0, -2.5, 15.0]},
            "b": {"maps": mirrored(), "yaw_deg": [-1.25, -15.0, 20.0]},
        }
    )
    assert [(c.view, c.yaw_deg) for c in compare(Dataset(folder), None)] == [(1, -2.5), (0, -1.25)]
    assert call(monkeypatch, str(folder)) == 0
    assert capsys.readouterr().out.startswith("the view turned least, yaw -2.5° to -1.2°\n")
    assert call(monkeypatch, str(folder), "--view", "2") == 0
    assert capsys.readouterr().out.startswith("view 2, yaw 15.0° to 20.0°\n")


def test_a_subject_that_is_not_seen_is_named(build: Any) -> None:
    unseen = maps(np.ones(INSIDE.shape), np.ones(INSIDE.shape), np.zeros_like(INSIDE))
    with pytest.raises(ValueError, match="b is not seen in view 0"):
        compare(Dataset(build({"a": {"maps": mirrored()}, "b": {"maps": unseen}})), None)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--view", "3"], "--view"),
        (["--easy", "nobody"], "--easy"),
        (["--rows", "0.3", "1.4"], "--rows"),
        (["--left-out", "0.7"], "--left-out"),
    ],
)
def test_a_wrong_call_is_named_in_one_line(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    named: str,
) -> None:
    assert call(monkeypatch, str(folder), *arguments) == 2
    said = capsys.readouterr().err
    assert named in said
    assert said.count("\n") == 1


def test_a_folder_without_subjects_is_refused(
    build: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, str(build({}))) == 2
    assert "no finished subject" in capsys.readouterr().err
