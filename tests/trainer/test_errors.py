"""Errors of predictions that are known, against a slow computation in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from seeds import generator
from trainer.branch import Back, Branch, Front
from trainer.errors import angle, errors, means, sums
from trainer.errors import told as figures_told
from trainer.learner import Learner
from trainer.losses import Surface
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.views import DepthRange, Sample

FRONT = Front(net=FrontNetConfig(width=8))
BACK = Back(generator=BackNetConfig(width=8), discriminator=DiscriminatorConfig(width=8))
SIZES = ((2, 18, 16), (1, 11, 7), (3, 6, 9))
"""Views, rows and columns of the batches."""


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def learner(branch: Branch, told: Callable[[Sample], torch.Tensor] | None = None) -> Learner:
    """One that predicts what it is told to, if it is."""
    torch.manual_seed(0)
    made = Learner(branch, DepthRange(1.0, 3.0), 1e-3)
    if told is not None:
        made.predict = told  # type: ignore[method-assign]
    return made


def batch(views: int, rows: int, columns: int) -> Sample:
    """Rough depths in silhouettes of any size, and other values outside of them."""
    rng = generator(0, "", f"errors {views}")
    shape = (views, 1, rows, columns)

    def depth(noise: float) -> torch.Tensor:
        return torch.from_numpy((2 + noise * rng.standard_normal(shape)).astype("f4"))

    share = rng.uniform(0.2, 0.9, (views, 1, 1, 1))
    mask = torch.from_numpy(rng.random(shape) < share)
    return Sample(
        rgb=torch.from_numpy(rng.random((views, 3, rows, columns), dtype="f4")),
        sensor=depth(0.01),
        valid=mask,
        front=depth(0.002),
        back=depth(0.003),
        coarse=depth(0.02),
        body=mask,
        mask=mask,
        pixel_size=torch.tensor(rng.uniform(0.003, 0.01, views), dtype=torch.float32),
        index=torch.arange(views),
    )


def batches() -> list[Sample]:
    return [batch(*size) for size in SIZES]


def told(given: Sample) -> torch.Tensor:
    """A prediction between the given and the true, and far off outside the silhouette."""
    middle = (given.sensor + 2 * given.front) / 3
    return torch.where(given.mask, middle, 50.0)


def slow_normals(depth: np.ndarray, mask: np.ndarray, pixel: float) -> np.ndarray:
    """(H, W, 3) Eq. 6 of one map, pixel by pixel; towards the front."""
    found = np.zeros((*depth.shape, 3))
    steps = [(0, 1), (-1, 0), (0, -1), (1, 0)]  # right, up, left, down
    for i, j in np.argwhere(mask):
        edges: list[np.ndarray | None] = []
        for down, right in steps:
            k, n = i + down, j + right
            there = 0 <= k < mask.shape[0] and 0 <= n < mask.shape[1] and mask[k, n]
            rise = depth[i, j] - depth[k, n] if there else 0.0
            edges.append(np.array([right * pixel, -down * pixel, rise]) if there else None)
        for one, other in zip(edges, edges[1:] + edges[:1], strict=True):
            if one is not None and other is not None:
                found[i, j] += np.cross(one, other)
        found[i, j] /= max(np.linalg.norm(found[i, j]), 1e-30)
    return found


def slow(of: Callable[[Sample], torch.Tensor], true: Callable[[Sample], torch.Tensor]):
    """Millimetres and degrees: means over all pixels of all batches."""
    millimetres, degrees = [], []
    for each in batches():
        maps = (part[:, 0].numpy() for part in (of(each), true(each), each.mask))
        for found, wanted, mask, pixel in zip(*maps, each.pixel_size.numpy(), strict=True):
            found, wanted = found.astype(float), wanted.astype(float)
            ours, theirs = (slow_normals(depth, mask, pixel)[mask] for depth in (found, wanted))
            millimetres.extend(1000 * np.abs(found - wanted)[mask])
            chord = np.linalg.norm(ours - theirs, axis=1)
            degrees.extend(np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1))))
    return np.mean(millimetres), np.mean(degrees)


@pytest.mark.parametrize("degrees", [0, 1e-5, 1e-3, 0.1, 1, 30, 60, 90, 150, 179, 180])
@pytest.mark.parametrize("about", [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.36, -0.48, 0.8)])
def test_an_angle_is_known_from_a_turn(degrees: float, about: tuple[float, ...]) -> None:
    axis = np.array(about)
    start = np.cross(axis, [0.8, 0.0, -0.6])
    start /= np.linalg.norm(start)
    turn = np.radians(degrees)
    end = np.cos(turn) * start + np.sin(turn) * np.cross(axis, start)
    one, other = (torch.from_numpy(normal).view(1, 3, 1, 1) for normal in (start, end))
    found = angle(one, other)
    assert found.shape == (1, 1, 1, 1)
    # Towards 180 degrees a chord hardly grows.
    close = 1e-5 if degrees > 170 else 1e-10
    assert found.item() == pytest.approx(degrees, rel=1e-9, abs=close)
    assert angle(other, one).item() == found.item()


def test_single_precision_is_exact_at_0_and_fair_at_180() -> None:
    values = generator(0, "", "angle").standard_normal((2, 3, 30, 30), dtype="f4")
    normal = torch.nn.functional.normalize(torch.from_numpy(values), dim=1)
    assert not angle(normal, normal).any()
    opposite = angle(normal, -normal)
    assert torch.isfinite(opposite).all()
    assert (opposite - 180).abs().max() < 0.1
    # By the dot product a hundredth of a degree would not be told from none.
    turned = torch.stack([torch.zeros(5), torch.zeros(5), torch.ones(5)])[None, :, :, None]
    small = torch.tensor([1e-4, 1e-3, 0.01, 0.02, 0.1])
    other = turned.clone()
    other[0, 0, :, 0] = torch.deg2rad(small)
    torch.testing.assert_close(angle(other, turned)[0, 0, :, 0], small, rtol=1e-4, atol=0)


def test_maps_without_a_normal_are_no_degree_apart() -> None:
    nothing = torch.zeros(1, 3, 4, 4)
    assert not angle(nothing, nothing).any()


def test_means_are_over_the_pixels_of_all_batches_alike() -> None:
    found = errors(learner(FRONT, told), batches())
    counts = [int(each.mask.sum()) for each in batches()]
    assert max(counts) > 4 * min(counts)  # so a mean over batches would show
    given_mm, given_deg = slow(lambda each: each.sensor, lambda each: each.front)
    depth_mm, normal_deg = slow(told, lambda each: each.front)
    assert found == pytest.approx(
        {
            "given_mm": given_mm,
            "given_deg": given_deg,
            "depth_mm": depth_mm,
            "normal_deg": normal_deg,
            "depth_ratio": depth_mm / given_mm,
            "normal_ratio": normal_deg / given_deg,
        },
        rel=1e-4,
    )
    assert found["depth_ratio"] == pytest.approx(1 / 3, rel=1e-4)
    assert 0.2 < found["normal_ratio"] < 0.9


def test_the_backs_are_of_the_back_and_its_coarse_depth() -> None:
    found = errors(learner(BACK, lambda each: each.coarse), batches())
    millimetres, degrees = slow(lambda each: each.coarse, lambda each: each.back)
    assert found["given_mm"] == found["depth_mm"] == pytest.approx(millimetres, rel=1e-4)
    assert found["given_deg"] == found["normal_deg"] == pytest.approx(degrees, rel=1e-4)
    assert found["depth_ratio"] == found["normal_ratio"] == 1


@pytest.mark.parametrize("branch", [FRONT, BACK])
def test_a_perfect_prediction_has_no_error(branch: Branch) -> None:
    found = errors(learner(branch, branch.true), batches())
    for name in ("depth_mm", "normal_deg", "depth_ratio", "normal_ratio"):
        assert found[name] == 0, name
    assert found["given_mm"] > 1
    assert found["given_deg"] > 1


def test_given_depth_without_an_error_is_no_division_by_zero() -> None:
    perfect = [each._replace(sensor=each.front) for each in batches()]
    found = errors(learner(FRONT, lambda each: each.front), perfect)
    assert {found.pop("depth_ratio"), found.pop("normal_ratio")} == {None}
    assert set(found.values()) == {0.0}


def test_figures_are_told_in_a_line() -> None:
    names = ("depth_mm", "normal_deg", "given_mm", "given_deg", "depth_ratio", "normal_ratio")
    whole = dict(zip(names, (0.965, 4.51, 2.673, 15.73, 0.361, 0.287), strict=True))
    assert figures_told(whole) == (
        "depth off by 0.96 mm of 2.67 given (36.1%), normal off by 4.5 deg of 15.7 given (28.7%)"
    )
    bare = {**whole, "given_mm": None, "given_deg": None, "depth_ratio": None, "normal_ratio": None}
    assert figures_told(bare) == "depth off by 0.96 mm, normal off by 4.5 deg"


def test_pixels_that_the_sensor_did_not_read_count_as_they_are_given() -> None:
    """Both have to make do with what the row lends them."""
    blind = [each._replace(valid=torch.zeros_like(each.valid)) for each in batches()]
    made = learner(FRONT, told)
    assert errors(made, blind) == errors(made, batches())


def test_an_untrained_front_is_as_far_off_as_what_it_is_given() -> None:
    found = errors(learner(FRONT), batches())
    assert found["depth_ratio"] == pytest.approx(1, abs=1e-3)
    assert found["normal_ratio"] == pytest.approx(1, abs=1e-3)


def test_sums_of_two_masks_add_up_and_nothing_outside_counts() -> None:
    one = batch(*SIZES[1])
    made = learner(FRONT)
    found, true = made.surface(one.sensor, one), made.surface(one.front, one)
    half = one.mask.clone()
    half[..., : half.shape[3] // 2] = False
    whole, right, left = (sums(found, true, part) for part in (one.mask, half, one.mask & ~half))
    assert right[0] == half.sum() > 0
    torch.testing.assert_close(right + left, whole)
    off = 1000 * (one.sensor - one.front).abs()[half].mean()
    assert means(right)[0] == pytest.approx(float(off), rel=1e-5)
    lost = Surface(torch.where(half, found.depth, torch.nan), found.normal)
    assert torch.equal(sums(lost, true, half), right)
    assert means(torch.zeros(3)) == (None, None)


def test_no_views_are_no_error() -> None:
    assert set(errors(learner(FRONT), []).values()) == {None}
