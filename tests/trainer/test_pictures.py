"""The picture of known surfaces, tile by tile."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from seeds import generator
from trainer.branch import Back, Branch, Front
from trainer.learner import Learner
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.pictures import ERROR_DEG, ERROR_MM, MARGIN, picture
from trainer.views import DepthRange, Sample

FRONT = Front(net=FrontNetConfig(width=8))
BACK = Back(generator=BackNetConfig(width=8), discriminator=DiscriminatorConfig(width=8))
Slopes = tuple[tuple[float, float], ...]
ROWS, COLUMNS, PIXEL, VIEWS = 20, 16, 0.01, 2
BORDER = 3
"""Pixels round the silhouette."""
TRUE = ((0.3, -0.4), (-0.8, 0.1))
"""Slopes of each view's plane along x and y."""
TILES = (
    *("rgb", "given normals", "predicted normals", "true normals"),
    *("given depth", "predicted depth", "predicted angle"),
)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def planes(slopes: Slopes) -> torch.Tensor:
    """(B, 1, H, W) metres, 2 in the middle."""
    x = (torch.arange(COLUMNS) + 0.5 - COLUMNS / 2) * PIXEL
    y = (ROWS / 2 - torch.arange(ROWS) - 0.5)[:, None] * PIXEL
    return torch.stack([2 + right * x + up * y for right, up in slopes])[:, None]


def silhouette() -> torch.Tensor:
    mask = torch.zeros(VIEWS, 1, ROWS, COLUMNS, dtype=torch.bool)
    mask[..., BORDER:-BORDER, BORDER:-BORDER] = True
    return mask


def batch(given: torch.Tensor, true: Slopes = TRUE) -> Sample:
    """The same for both branches; colours are noise."""
    colors = generator(0, "", "colors").integers(0, 256, (VIEWS, 3, ROWS, COLUMNS))
    mask = silhouette()
    given, depth = (torch.where(mask, depth, 0) for depth in (given, planes(true)))
    return Sample(
        rgb=torch.where(mask, torch.from_numpy(colors).float() / 255, 0),
        sensor=given,
        valid=mask,
        front=depth,
        back=depth,
        coarse=given,
        body=mask,
        mask=mask,
        pixel_size=torch.full((VIEWS,), PIXEL),
        index=torch.arange(VIEWS),
    )


def drawn(
    branch: Branch, given: torch.Tensor, predicted: torch.Tensor, true: Slopes = TRUE
) -> np.ndarray:
    """The picture where this is given and that predicted."""
    made = Learner(branch, DepthRange(1.0, 3.0), 1e-3)
    made.predict = lambda each: torch.where(each.mask, predicted, 0)  # type: ignore[method-assign]
    return picture(made, batch(given, true))


def tile(page: np.ndarray, view: int, name: str) -> np.ndarray:
    """(H, W, 3)."""
    column = TILES.index(name)
    return page[view * ROWS : (view + 1) * ROWS, column * COLUMNS : (column + 1) * COLUMNS]


def inner(values: np.ndarray) -> np.ndarray:
    """What of a tile shows the silhouette."""
    return values[BORDER:-BORDER, BORDER:-BORDER]


def color(slope: tuple[float, float], side: str) -> np.ndarray:
    """Of a plane's normal: x, y and the part towards the viewer, -1 to 1 as 0 to 255."""
    normal = np.array([*slope, 1.0]) / math.hypot(*slope, 1)
    if side == "back":
        normal[:2] *= -1
    return 255 * (normal + 1) / 2


def test_a_row_for_each_view_and_seven_tiles_in_it() -> None:
    page = drawn(FRONT, planes(TRUE), planes(TRUE))
    assert page.shape == (VIEWS * ROWS, len(TILES) * COLUMNS, 3)
    assert page.dtype == np.uint8
    assert len(TILES) == 7


@pytest.mark.parametrize("empty", [False, True])
def test_no_more_is_shown_than_the_people_need(empty: bool) -> None:
    small = batch(planes(TRUE) + 0.01)
    if empty:
        small = small._replace(mask=torch.zeros_like(small.mask))
    wide = MARGIN - BORDER + 30

    def padded(margin: int) -> np.ndarray:
        maps = {
            name: torch.nn.functional.pad(each, [margin] * 4) if each.ndim == 4 else each
            for name, each in small._asdict().items()
        }
        made = Learner(FRONT, DepthRange(1.0, 3.0), 1e-3)
        made.predict = lambda each: each.sensor  # type: ignore[method-assign]
        return picture(made, Sample(**maps))

    if empty:
        assert (padded(wide) == 255).all()
    else:
        np.testing.assert_array_equal(padded(wide), padded(MARGIN - BORDER))


def test_all_is_white_outside_the_silhouette_and_colour_as_it_is_inside() -> None:
    given = planes(TRUE) + 0.005
    page = drawn(FRONT, given, given)
    outside = np.ones((ROWS, COLUMNS), dtype=bool)
    outside[BORDER:-BORDER, BORDER:-BORDER] = False
    for view in range(VIEWS):
        for name in TILES:
            assert (tile(page, view, name)[outside] == 255).all(), name
            assert (inner(tile(page, view, name)) != 255).any(), name
        colors = (255 * batch(given).rgb[view]).round().permute(1, 2, 0).numpy()
        np.testing.assert_array_equal(inner(tile(page, view, "rgb")), inner(colors))


@pytest.mark.parametrize("branch", [FRONT, BACK])
def test_normals_have_their_colours_seen_from_their_own_side(branch: Branch) -> None:
    given, predicted = ((0.0, 0.0), (0.5, 0.5)), ((0.2, 0.0), (0.0, -1.5))
    page = drawn(branch, planes(given), planes(predicted))
    for view in range(VIEWS):
        for name, slopes in (("given", given), ("predicted", predicted), ("true", TRUE)):
            found = inner(tile(page, view, f"{name} normals")).reshape(-1, 3)
            wanted = np.broadcast_to(color(slopes[view], branch.side), found.shape)
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1)
    # Whatever faces the viewer is light blue, on either side.
    assert inner(tile(page, 0, "given normals"))[0, 0].tolist() == [128, 128, 255]


@pytest.mark.parametrize("branch", [FRONT, BACK])
@pytest.mark.parametrize("sign", [1, -1])
def test_depths_error_grows_linearly_to_white_at_the_limit(branch: Branch, sign: int) -> None:
    millimetres = torch.arange(COLUMNS, dtype=torch.float32) * 2
    given = planes(TRUE) + sign * millimetres / 1000
    predicted = planes(TRUE) + sign * millimetres / 4000
    page = drawn(branch, given, predicted)
    assert BORDER * 2 < ERROR_MM < (COLUMNS - BORDER - 1) * 2  # linear, then white
    for name, factor in (("given depth", 1), ("predicted depth", 1 / 4)):
        for view in range(VIEWS):
            wanted = 255 * np.minimum(factor * millimetres.numpy() / ERROR_MM, 1)
            found = inner(tile(page, view, name))
            wanted = np.broadcast_to(wanted[BORDER:-BORDER, None], found.shape)
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1)


@pytest.mark.parametrize("branch", [FRONT, BACK])
@pytest.mark.parametrize("degrees", [0, 5, 15, 30, 44, 46, 80])
def test_the_angle_to_the_true_normals_likewise(branch: Branch, degrees: float) -> None:
    true = ((-0.5, 0.0), (0.0, 0.0))
    turned = tuple((math.tan(math.atan(x) + math.radians(degrees)), 0.0) for x, _ in true)
    page = drawn(branch, planes(true), planes(turned), true)
    for view in range(VIEWS):
        found = inner(tile(page, view, "predicted angle"))
        wanted = 255 * min(degrees / ERROR_DEG, 1)
        np.testing.assert_allclose(found, np.full_like(found, round(wanted)), rtol=0, atol=1)
        assert bool(found.max() == 255) is (degrees > ERROR_DEG)


def test_what_is_perfect_is_black() -> None:
    page = drawn(FRONT, planes(TRUE), planes(TRUE))
    for view in range(VIEWS):
        for name in TILES[4:]:
            assert not inner(tile(page, view, name)).any(), name


def test_a_file_of_it_is_read_back_unchanged(tmp_path: Path) -> None:
    page = drawn(BACK, planes(TRUE) + 0.01, planes(TRUE))
    Image.fromarray(page).save(tmp_path / "page.png", "PNG")
    with Image.open(tmp_path / "page.png") as image:
        assert image.format == "PNG"
        assert image.mode == "RGB"
        assert image.size == (len(TILES) * COLUMNS, VIEWS * ROWS)
        np.testing.assert_array_equal(np.asarray(image), page)


def test_networks_that_learn_draw_it() -> None:
    made = Learner(BACK, DepthRange(1.0, 3.0), 1e-3)
    given = batch(planes(TRUE) + 0.01)
    page = picture(made, given)
    predicted = made.predict(given)
    np.testing.assert_array_equal(page, drawn(BACK, given.coarse, predicted))
