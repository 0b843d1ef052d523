"""A depth map's detail, against a slow mean over each pixel's surroundings."""

import numpy as np
import pytest
import torch

from seeds import generator
from trainer.networks.back import WINDOWS as BACK_WINDOWS
from trainer.networks.detail import LIMIT, SCALE
from trainer.networks.detail import detail as detail_of
from trainer.networks.front import WINDOWS, FrontNet, FrontNetConfig

MARGIN = max(WINDOWS) // 2


def detail(depth, mask, windows=WINDOWS):
    return detail_of(depth, mask, windows)


def plane(rows, columns, slope=(0.0, 0.0), dtype=torch.float32):
    i, j = torch.meshgrid(*(torch.arange(n).double() for n in (rows, columns)), indexing="ij")
    depth = 0.5 + slope[0] * (i - rows / 2) + slope[1] * (j - columns / 2)
    return depth.to(dtype)[None, None]


def whole(depth):
    return torch.ones_like(depth, dtype=torch.bool)


def drawn(batch, rows, columns, spread):
    """Rough depths and a ragged mask."""
    rng = generator(0, "", f"detail of {rows} x {columns}")
    shape = (batch, 1, rows, columns)
    depth = 0.5 + spread * rng.standard_normal(shape)
    return torch.from_numpy(depth), torch.from_numpy(rng.random(shape) < 0.6)


def reference(depth, mask, margin):
    """One map's, pixel by pixel."""
    found = np.zeros_like(depth)
    for i, j in np.argwhere(mask):
        rows, columns = (slice(max(k - margin, 0), k + margin + 1) for k in (i, j))
        found[i, j] = depth[i, j] - depth[rows, columns][mask[rows, columns]].mean()
    return found


@pytest.mark.parametrize("windows", [WINDOWS, BACK_WINDOWS], ids=["front", "back"])
@pytest.mark.parametrize("size", [(53, 37), (8, 5), (1, 7), (9, 1), (1, 1)])
def test_the_slow_mean_agrees_at_any_size(size, windows):
    depth, mask = drawn(2, *size, 0.1)
    found = detail(depth, mask, windows)
    assert found.shape == (2, len(windows), *size)
    assert found.dtype == depth.dtype
    for k in range(2):
        for channel, window in enumerate(windows):
            slow = reference(depth[k, 0].numpy(), mask[k, 0].numpy(), window // 2)
            np.testing.assert_allclose(found[k, channel].numpy(), slow, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("dtype", "close"), [(torch.float32, 1e-5), (torch.float64, 1e-9)])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.003, 0.0), (0.0, -0.01), (0.02, 0.015)])
def test_a_plane_has_none_but_at_its_outline(slope, dtype, close):
    depth = plane(31, 42, slope, dtype)
    inner = detail(depth, whole(depth))[..., MARGIN:-MARGIN, MARGIN:-MARGIN]
    assert inner.shape == (1, len(WINDOWS), 23, 34)
    assert inner.abs().max() < close


def test_a_level_plane_has_none_to_its_ragged_outline():
    _, mask = drawn(1, 31, 42, 0)
    assert detail(plane(31, 42), mask).abs().max() < 1e-5


def test_depth_added_everywhere_changes_nothing():
    depth, mask = drawn(1, 20, 20, 0.5)
    torch.testing.assert_close(detail(depth + 0.7, mask), detail(depth, mask))


@pytest.mark.parametrize("height", [1.0, -2.0, 0.1])
def test_a_spike_stands_out_of_each_window_and_lowers_the_rest_of_it(height):
    depth = plane(19, 19, dtype=torch.float64)
    depth[..., 9, 9] += height
    for found, window in zip(detail(depth, whole(depth))[0], WINDOWS, strict=True):
        share, margin = height / window**2, window // 2
        assert found[9, 9].item() == pytest.approx(height - share)
        assert found[9, 9 + margin].item() == pytest.approx(-share)
        assert found[9, 9 + margin + 1].item() == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_network_sees_a_step_cut_at_the_limit(sign):
    depth = plane(32, 32)
    depth[..., 16:] += sign
    (seen,) = inputs_of(depth)
    differences = seen[5:]
    assert differences.shape[0] == len(WINDOWS)
    assert (differences[:, :, 16] == sign * LIMIT).all()
    assert (differences[:, :, 15] == -sign * LIMIT).all()
    assert (differences[..., 16 - MARGIN - 1].abs() < 1e-3).all()


@pytest.mark.parametrize("outside", [0.0, 1.0, -1e6, float("nan"), float("inf")])
def test_nothing_outside_the_mask_matters_or_has_a_gradient(outside):
    depth, mask = drawn(2, 21, 17, 0.5)
    plain = detail(depth, mask)
    depth = torch.where(mask, depth, outside).requires_grad_()
    found = detail(depth, mask)
    assert torch.equal(found, plain)
    assert not found[~mask.expand_as(found)].any()
    found.square().sum().backward()
    assert torch.isfinite(depth.grad).all()
    assert depth.grad[mask].any()
    assert not depth.grad[~mask].any()


def test_gradients_are_those_of_finite_differences():
    depth, mask = drawn(2, 5, 6, 0.3)
    assert torch.autograd.gradcheck(lambda d: detail(d, mask), depth.requires_grad_(), eps=1e-7)


def test_a_step_has_a_finite_gradient_and_an_empty_mask_none():
    depth = plane(12, 12)
    depth[..., 6:] += 1
    for mask in (whole(depth), ~whole(depth)):
        depth = depth.detach().requires_grad_()
        found = detail(depth, mask)
        found.square().sum().backward()
        assert torch.isfinite(found).all()
        assert torch.isfinite(depth.grad).all()
    assert not found.any()
    assert not depth.grad.any()


def test_a_pixel_alone_has_none():
    depth = torch.full((1, 1, 11, 11), 0.7)
    mask = ~whole(depth)
    mask[..., 5, 5] = True
    assert detail(depth, mask).abs().max() < 1e-4
    assert detail(depth[..., :1, :1], whole(depth[..., :1, :1])).abs().max() < 1e-4


def inputs_of(*depths, half=False):
    """(C, H, W) what the front's first convolution is given of a depth map."""
    network = FrontNet(FrontNetConfig(8))
    seen = []
    network.encoder.register_forward_pre_hook(lambda _, given: seen.append(given[0][0]))
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=half):
        for depth in depths:
            network(torch.zeros(1, 3, *depth.shape[-2:]), depth, *(2 * [whole(depth)]))
    return seen


def test_half_precision_keeps_in_detail_what_it_loses_of_depth():
    """A thousandth of the range, a millimetre or less, reaches the front's convolutions."""
    depth = plane(32, 32)
    moved = depth.clone()
    moved[..., 16, 16] += 0.001
    # The convolutions' own cast.
    before, after = (maps.bfloat16()[:, 16, 16] for maps in inputs_of(depth, moved, half=True))
    assert after[3] == before[3]
    for channel, window in enumerate(WINDOWS, start=5):
        change = (after[channel] - before[channel]).item()
        assert change == pytest.approx(0.001 / SCALE * (1 - 1 / window**2), rel=0.01)
