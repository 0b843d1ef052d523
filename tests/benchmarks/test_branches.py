"""The baselines and what measures them: filters on known depth, tuning, whole tables."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from benchmarks.branches import Bilateral, Median, measure, show, tuned
from trainer.views import Sample

ROWS, COLUMNS, PIXEL = 40, 30, 0.005


def sample(read: np.ndarray, mask: np.ndarray, true: np.ndarray | None = None) -> Sample:
    """A view of a reading; the body is the silhouette's upper half."""
    inside = torch.from_numpy(mask)[None, None]
    upper = inside.clone()
    upper[..., ROWS // 2 :, :] = False

    def depth(values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.where(mask, values, 0).astype("f4"))[None, None]

    front = depth(read if true is None else true)
    return Sample(
        rgb=torch.zeros(1, 3, ROWS, COLUMNS),
        sensor=depth(read),
        valid=inside,
        front=front,
        back=front + 0.2 * inside,
        coarse=depth(read),
        body=upper,
        mask=inside,
        pixel_size=torch.tensor([PIXEL]),
        index=torch.tensor([0]),
    )


@pytest.fixture
def silhouette() -> np.ndarray:
    """All but the frame's border of four pixels."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[4:-4, 4:-4] = True
    return mask


def noisy(silhouette: np.ndarray, noise: float, seed: int = 0) -> Sample:
    """A plane that leans, read with noise."""
    plane = 2 + 0.001 * np.arange(COLUMNS) * np.ones((ROWS, 1))
    rng = np.random.default_rng(seed)
    return sample(plane + noise * rng.standard_normal(plane.shape), silhouette, plane)


class FakeViews(list):
    """Views of one subject each."""

    @property
    def subjects(self) -> list[int]:
        return list(range(len(self)))


def views(silhouette: np.ndarray, noise: float) -> FakeViews:
    """As `Views` gives them, without the batch's axis."""
    batches = [noisy(silhouette, noise, seed) for seed in range(3)]
    return FakeViews(Sample(*(part[0] for part in batch)) for batch in batches)


@pytest.mark.parametrize("denoise", [Median(3), Median(7), Bilateral(0.8, 0.05)])
def test_a_filter_leaves_a_plane_a_step_and_what_lies_outside(denoise, silhouette):
    step = np.where(np.arange(COLUMNS) < 15, 2.0, 2.5) * np.ones((ROWS, 1))
    found = denoise(sample(step, silhouette))[0, 0].numpy()
    assert not found[~silhouette].any()
    # At the outline too: the background's zeros would draw the depth towards the camera.
    np.testing.assert_allclose(found[silhouette], step[silhouette], atol=1e-4)


@pytest.mark.parametrize("denoise", [Median(5), Bilateral(1.4, 0.5)])
def test_a_filter_takes_noise_away(denoise, silhouette):
    before = measure(lambda each: each.sensor, [noisy(silhouette, 0.003)])
    after = measure(denoise, [noisy(silhouette, 0.003)])
    assert after[0] < 0.5 * before[0]
    assert after[1] < 0.5 * before[1]


def test_a_median_of_one_pixel_does_nothing(silhouette):
    given = noisy(silhouette, 0.003)
    assert torch.equal(Median(1)(given), given.sensor)


def test_the_error_is_the_silhouettes_mean_and_the_bodys_where_asked(silhouette):
    one = sample(np.full((ROWS, COLUMNS), 2.0), silhouette)
    lower = one.mask & ~one.body

    def shifted(each: Sample) -> torch.Tensor:
        return torch.where(lower, each.back + 0.004, torch.where(each.mask, each.back - 0.001, 0))

    share = float(lower.sum() / one.mask.sum())
    millimetres, degrees = measure(shifted, [one, one], "back")
    assert millimetres == pytest.approx(4 * share + 1 * (1 - share), rel=1e-3)
    # The step of 5 mm between two rows turns each by as much as half of it in a pixel.
    slope = math.degrees(math.atan(0.0025 / PIXEL))
    rows = 2 * (COLUMNS - 8) / int(one.mask.sum())
    assert degrees == pytest.approx(slope * rows, rel=1e-2)
    assert measure(shifted, [one], "back", own=True)[0] == pytest.approx(1, rel=1e-3)


def test_nothing_to_measure_is_said(silhouette):
    empty = sample(np.full((ROWS, COLUMNS), 2.0), np.zeros_like(silhouette))
    with pytest.raises(ValueError, match="no pixel to measure"):
        measure(lambda each: each.sensor, [empty])


def test_tuning_takes_the_best_and_refuses_an_edge(silhouette):
    some = views(silhouette, 0.003)
    grid = [Median(size) for size in (1, 3, 5, 7, 29)]
    found = tuned(grid, some)
    batches = [Sample(*(part[None] for part in view)) for view in some]
    errors = {each: measure(each, batches)[0] for each in grid}
    assert errors[found] == min(errors.values())
    assert len(set(errors.values())) == len(grid)
    with pytest.raises(ValueError, match=r"Median\(size=3\) is the best .* widen size"):
        tuned([Median(1), Median(3)], some)


def test_a_table_gives_shares_of_its_first_row(capsys):
    show("front", {"the sensor": (2.0, 10.0), "a filter": (1.5, 2.5)})
    title, first, second = capsys.readouterr().out.strip().splitlines()
    assert title.startswith("front")
    assert first.split() == ["the", "sensor", "2.000", "100.0%", "10.00", "100.0%"]
    assert second.split() == ["a", "filter", "1.500", "75.0%", "2.50", "25.0%"]
