"""Eq. 6 against spheres, planes, a slow loop and finite differences."""

import numpy as np
import pytest
import torch

from seeds import generator
from trainer.normals import normals

SIDES = ("front", "back")
FOUR = ((1, 0), (0, 1), (-1, 0), (0, -1))


def grid(rows: int, columns: int, pixel: float) -> tuple[torch.Tensor, torch.Tensor]:
    """x and y of the pixels' centres, double, as docs/conventions.md has them."""
    i, j = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    return (j.double() + 0.5 - columns / 2) * pixel, (rows / 2 - i.double() - 0.5) * pixel


def frame(values: torch.Tensor) -> torch.Tensor:
    """(1, 1, H, W)."""
    return values[None, None]


def drawn(shape: tuple[int, ...], purpose: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Rough depths and a ragged mask."""
    rng = generator(0, "", purpose)
    return torch.from_numpy(2 + 0.02 * rng.standard_normal(shape)), torch.from_numpy(
        rng.random(shape) < 0.7
    )


def reference(
    depth: np.ndarray, pixel: float, mask: np.ndarray, sign: int, ring=FOUR
) -> np.ndarray:
    """One map's normals, pixel by pixel and pair by pair, in metres."""
    rows, columns = depth.shape

    def point(i: int, j: int) -> np.ndarray:
        x, y = (j + 0.5 - columns / 2) * pixel, (rows / 2 - i - 0.5) * pixel
        return np.array([x, y, -depth[i, j]])

    def inside(i: int, j: int) -> bool:
        return 0 <= i < rows and 0 <= j < columns and bool(mask[i, j])

    found = np.zeros((3, rows, columns))
    for i, j in zip(*np.nonzero(mask), strict=True):
        total = np.zeros(3)
        for k in range(len(ring)):
            (right1, up1), (right2, up2) = ring[k], ring[(k + 1) % len(ring)]
            first, second = (i - up1, j + right1), (i - up2, j + right2)
            if inside(*first) and inside(*second):
                here = point(i, j)
                total += np.cross(point(*first) - here, point(*second) - here)
        if total.any():
            found[:, i, j] = sign * total / np.linalg.norm(total)
    return found


@pytest.mark.parametrize(("side", "sign"), [("front", 1), ("back", -1)])
def test_a_sphere_has_its_analytic_normals(side, sign):
    radius, pixel = 0.3, 0.005
    x, y = grid(130, 140, pixel)
    height = (radius**2 - x**2 - y**2).clamp_min(0).sqrt()
    mask = x**2 + y**2 < (0.9 * radius) ** 2
    found = normals(frame(2.0 - sign * height), pixel, frame(mask), side)[0]
    truth = torch.stack((x, y, sign * height)) / radius
    angle = torch.rad2deg(torch.acos((found * truth).sum(0).clamp(-1, 1)))
    inner = x**2 + y**2 < (0.8 * radius) ** 2
    assert angle[inner].max() < 0.03
    # At the outline differences are one-sided.
    assert angle[mask].max() < 1.5


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("slope", [(0, 0), (0.3, 0), (0, -0.7), (2, 1), (-30, 50), (1e4, -1e4)])
def test_a_plane_has_one_normal_to_its_ragged_outline(slope, side):
    x, y = grid(20, 30, 0.005)
    _, mask = drawn((20, 30), "plane")
    depth = 2 + slope[0] * x + slope[1] * y
    found = normals(frame(depth), 0.005, frame(mask), side)[0]
    truth = torch.tensor([*slope, 1.0], dtype=torch.float64)
    truth *= (1 if side == "front" else -1) / truth.norm()
    with_pair = found.norm(dim=0) > 0
    assert with_pair.sum() > 0.7 * mask.sum()
    torch.testing.assert_close(
        found[:, with_pair], truth[:, None].expand(-1, int(with_pair.sum())), rtol=0, atol=1e-5
    )
    assert not found[:, ~mask].any()


def test_single_precision_at_two_metres_is_good_to_a_hundredth_of_a_degree():
    x, y = grid(20, 30, 0.005)
    depth = (2 + 0.3 * x - 0.4 * y).float()
    found = normals(frame(depth), 0.005, torch.ones(1, 1, 20, 30, dtype=torch.bool), "front")
    truth = torch.tensor([0.3, -0.4, 1]) / np.sqrt(1.25)
    assert found.dtype == torch.float32
    assert (found[0] - truth[:, None, None]).abs().max() < 1e-4


@pytest.mark.parametrize("side", SIDES)
def test_the_slow_loop_agrees_for_pixels_of_each_maps_own_size(side):
    depth, mask = drawn((3, 1, 11, 13), "loop")
    pixels = (0.005, 0.01, 0.002)
    found = normals(depth, torch.tensor(pixels, dtype=torch.float64), mask, side)
    sign = 1 if side == "front" else -1
    for k, pixel in enumerate(pixels):
        slow = reference(depth[k, 0].numpy(), pixel, mask[k, 0].numpy(), sign)
        np.testing.assert_allclose(found[k].numpy(), slow, rtol=0, atol=1e-12)
        assert (np.linalg.norm(slow, axis=0) == 0)[mask[k, 0].numpy()].any()
    one = normals(depth[:1], pixels[0], mask[:1], side)
    assert torch.equal(one, found[:1])


@pytest.mark.parametrize("side", SIDES)
def test_normals_are_unit_or_zero_and_lean_to_their_side(side):
    depth, mask = drawn((2, 1, 40, 50), "unit")
    found = normals(depth.float(), 0.005, mask, side)
    assert found.shape == (2, 3, 40, 50)
    length = found.norm(dim=1)
    assert (((length - 1).abs() < 1e-6) | (length == 0)).all()
    lean = found[:, 2] if side == "front" else -found[:, 2]
    assert (lean[length > 0] > 0).all()


@pytest.mark.parametrize("side", SIDES)
def test_gradients_are_those_of_finite_differences(side):
    depth, mask = drawn((2, 1, 5, 6), "gradients")
    mask[1, 0, 2:] = False
    mask[1, 0, 4, 3] = True  # alone
    pixel = torch.tensor([0.02, 0.05], dtype=torch.float64)
    assert torch.autograd.gradcheck(
        lambda d: normals(d, pixel, mask, side), depth.requires_grad_(), eps=1e-7
    )


@pytest.mark.parametrize("outside", [0.0, float("nan"), float("inf"), -1e30])
def test_nothing_outside_the_mask_matters_or_has_a_gradient(outside):
    depth, mask = drawn((1, 1, 12, 12), "outside")
    weights = torch.from_numpy(generator(0, "", "weights").standard_normal((1, 3, 12, 12)))
    plain = normals(depth, 0.005, mask, "front")
    depth = torch.where(mask, depth, outside).requires_grad_()
    found = normals(depth, 0.005, mask, "front")
    assert torch.equal(found, plain)
    (found * weights).sum().backward()
    assert torch.isfinite(depth.grad).all()
    assert depth.grad[mask].any()
    assert not depth.grad[~mask].any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1)])
def test_a_pixel_or_a_line_alone_has_no_normal_and_no_gradient(shape):
    mask = torch.zeros(1, 1, 9, 9, dtype=torch.bool)
    mask[..., 1 : 1 + shape[0], 1 : 1 + shape[1]] = True
    depth = drawn((1, 1, 9, 9), "alone")[0].requires_grad_()
    found = normals(depth, 0.005, mask, "back")
    assert not found.any()
    found.sum().backward()
    assert not depth.grad.any()  # NaN would be true


def test_a_mask_without_a_pixel_and_a_frame_of_one_give_zero():
    depth = torch.full((1, 1, 4, 4), 2.0)
    assert not normals(depth, 0.005, torch.zeros_like(depth, dtype=torch.bool), "front").any()
    one = torch.ones(1, 1, 1, 1)
    assert not normals(one, 0.005, one.bool(), "front").any()


def test_a_step_as_high_as_the_room_in_half_precision_stays_finite():
    depth = torch.full((1, 1, 6, 6), 2.0, dtype=torch.float16)
    depth[..., 3:] = 6.0
    depth.requires_grad_()
    found = normals(depth, 0.005, torch.ones(1, 1, 6, 6, dtype=torch.bool), "front")
    assert found.dtype == torch.float32
    found.sum().backward()
    assert torch.isfinite(found).all()
    assert torch.isfinite(depth.grad).all()
    assert (found.norm(dim=1) - 1).abs().max() < 1e-6


def test_rows_that_alternate_across_a_slope_show():
    """Sobel's eight neighbours would give every pixel the same normal."""
    x, _ = grid(12, 12, 0.005)
    i = torch.arange(12)[:, None]
    depth = 2 + 0.002 * torch.where(i % 2 == 0, 1, -1) * torch.sin(40 * x)
    mask = torch.ones(1, 1, 12, 12, dtype=torch.bool)
    found = normals(frame(depth), 0.005, mask, "front")[0, :, 1:-1, 1:-1]
    assert (found[0, 0] - found[0, 1]).abs().min() > 0.01
    ring = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
    eight = reference(depth.numpy(), 0.005, mask[0, 0].numpy(), 1, ring)[:, 1:-1, 1:-1]
    assert np.ptp(eight, axis=(1, 2)).max() < 1e-12


@pytest.mark.parametrize(
    ("depth", "mask", "pixel", "side", "message"),
    [
        ((1, 1, 4, 4), (1, 1, 4, 4), 0.005, "left", "side: 'left'; give one of front, back"),
        ((1, 4, 4), (1, 4, 4), 0.005, "front", r"depth is \(1, 4, 4\)"),
        ((1, 3, 4, 4), (1, 3, 4, 4), 0.005, "front", r"depth is \(1, 3, 4, 4\)"),
        ((2, 1, 4, 4), (1, 1, 4, 4), 0.005, "front", r"mask \(1, 1, 4, 4\)"),
        ((1, 1, 4, 4), (1, 1, 4, 4), (0.1, 0.2), "front", "pixel_size: 2 for 1 maps"),
    ],
)
def test_what_does_not_fit_is_said(depth, mask, pixel, side, message):
    with pytest.raises(ValueError, match=message):
        normals(torch.ones(depth), torch.tensor(pixel), torch.ones(mask, dtype=torch.bool), side)
