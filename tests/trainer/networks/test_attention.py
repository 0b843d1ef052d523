"""Cross-attention: Eq. 1 and 2 by a slow loop, and what it must not depend on."""

import math

import pytest
import torch

from trainer.networks.attention import CrossAttention
from trainer.networks.blocks import initialise


@pytest.fixture
def attention():
    torch.manual_seed(0)
    module = CrossAttention(deep=8, finer=3).double()
    initialise(module)
    return module


def features(height, width, finer_height, finer_width, batch=2):
    torch.manual_seed(1)
    deep = torch.randn(batch, 8, height, width, dtype=torch.float64)
    return deep, torch.randn(batch, 3, finer_height, finer_width, dtype=torch.float64)


@pytest.mark.parametrize("finer_size", [(4, 6), (3, 6), (4, 5), (3, 5)])
def test_it_is_equations_1_and_2(attention, finer_size):
    deep, finer = features(2, 3, *finer_size)
    result = attention(deep, finer)
    assert result.shape == (2, attention.channels, 2, 3) == (2, 12, 2, 3)
    torch.testing.assert_close(result[:, 4:], deep)
    places = [(i, j) for i in range(2) for j in range(3)]
    bottom, right = finer_size[0] - 1, finer_size[1] - 1
    for sample in range(2):
        for i, j in places:
            total = torch.zeros(4, dtype=torch.float64)
            for k, m in places:
                query = attention.query(deep[sample, :, i, j]).tolist()
                key = attention.key(deep[sample, :, k, m]).tolist()
                score = sum(a * b for a, b in zip(query, key, strict=True))
                weight = 1 / (1 + math.exp(-(score / math.sqrt(2) - math.log(6))))
                cell = torch.stack(
                    [
                        finer[sample, :, min(2 * k + down, bottom), min(2 * m + across, right)]
                        for down in (0, 1)
                        for across in (0, 1)
                    ],
                    dim=1,
                ).flatten()
                total += weight * attention.value(cell)
            torch.testing.assert_close(result[sample, :4, i, j], total)


def test_scores_are_of_the_deep_features_alone(attention):
    deep, finer = features(2, 3, 4, 6)
    weights = attention.weights(deep)
    assert weights.shape == (2, 6, 6)
    assert ((weights > 0) & (weights < 1)).all()
    attended = (weights @ attention.value(_cells(finer))).transpose(1, 2).reshape(2, 4, 2, 3)
    torch.testing.assert_close(attention(deep, finer)[:, :4], attended)


def _cells(finer):
    """(B, N, 4 C): the four pixels of every cell, written out."""
    batch, _, height, width = finer.shape
    cells = [
        finer[:, :, 2 * i : 2 * i + 2, 2 * j : 2 * j + 2].reshape(batch, -1)
        for i in range(height // 2)
        for j in range(width // 2)
    ]
    return torch.stack(cells, dim=1)


@pytest.mark.parametrize("side", [4, 16])
def test_weights_sum_to_about_one_at_any_number_of_tokens(attention, side):
    deep, _ = features(side, side, 1, 1)
    total = attention.weights(0.1 * deep).sum(2)
    assert 0.8 < total.min() <= total.max() < 1.25


def test_one_token_can_be_picked_out(attention):
    """A weight is bounded by one, not by one over the number of tokens."""
    deep, _ = features(8, 8, 1, 1)
    assert attention.weights(30 * deep).max() > 0.99


def test_tokens_may_be_shuffled_together(attention):
    deep, finer = features(1, 4, 2, 8)
    order = [2, 0, 3, 1]
    cells = finer.unflatten(3, (4, 2))[..., order, :].flatten(3)
    shuffled = attention(deep[..., order], cells)
    torch.testing.assert_close(shuffled, attention(deep, finer)[..., order])


def test_the_pixels_of_a_cell_are_told_apart(attention):
    deep, finer = features(2, 2, 4, 4)
    swapped = finer.clone()
    swapped[..., 0, 0], swapped[..., 0, 1] = finer[..., 0, 1], finer[..., 0, 0]
    difference = attention(deep, swapped) - attention(deep, finer)
    assert difference[:, :4].abs().max() > 1e-3


def test_gradients_are_right(attention):
    deep, finer = features(1, 2, 2, 3, batch=1)
    assert torch.autograd.gradcheck(
        attention, (deep.requires_grad_(), finer.requires_grad_()), atol=1e-6
    )


def test_grids_that_do_not_meet_are_refused(attention):
    with pytest.raises(ValueError, match=r"^finer features \(2, 3, 6, 6\) are not twice .*\Z"):
        attention(*features(2, 3, 6, 6))


def test_half_precision_attends_to_a_whole_person_as_single_does():
    """416 x 256 pixels are 26 x 16 tokens, whose weights are near 1 / 416."""
    torch.manual_seed(0)
    module = CrossAttention(deep=128, finer=64)
    initialise(module)
    deep, finer = torch.randn(1, 128, 26, 16), torch.randn(1, 64, 52, 32)
    with torch.no_grad():
        exact = module(deep, finer)[:, 128:].float(), module.weights(deep)
        with torch.autocast("cpu", torch.bfloat16):
            half = module(deep, finer)[:, 128:].float(), module.weights(deep)
    for ours, theirs in zip(half, exact, strict=True):
        assert ours.dtype == torch.float32
        assert (ours - theirs).norm() < 0.02 * theirs.norm()
