"""Depth filled in, against a slow pyramid, and what must hold of any filling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trainer.filling import filled


def slow(total: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Depth at every pixel, cell by cell, of sums and of how much of a cell they are."""
    if share.all() or share.size == 1:
        return total / share
    above = np.zeros((2, math.ceil(share.shape[0] / 2), math.ceil(share.shape[1] / 2)))
    for i, j in np.ndindex(*above.shape[1:]):
        for kind, values in enumerate((total, share)):
            above[kind, i, j] = values[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean()
    coarse = slow(*above)
    found = np.zeros(share.shape)
    for i, j in np.ndindex(*share.shape):
        if share[i, j] > 0:
            found[i, j] = total[i, j] / share[i, j]
        else:
            found[i, j] = _bilinear(coarse, (i - 0.5) / 2, (j - 0.5) / 2)
    return found


def _bilinear(values: np.ndarray, row: float, column: float) -> float:
    row = min(max(row, 0), values.shape[0] - 1)
    column = min(max(column, 0), values.shape[1] - 1)
    total = 0.0
    for i in {math.floor(row), math.ceil(row)}:
        for j in {math.floor(column), math.ceil(column)}:
            total += (1 - abs(row - i)) * (1 - abs(column - j)) * values[i, j]
    return total


def blob(height: int, width: int, share: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Depth with holes in a silhouette."""
    rng = np.random.default_rng(seed)
    inside = rng.random((height, width)) < 0.8
    depth = rng.uniform(1.5, 2.5, (height, width)).astype(np.float32)
    return np.where(inside & (rng.random((height, width)) < share), depth, np.float32(0)), inside


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (8, 8), (13, 6), (31, 17), (5, 64)])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
def test_it_is_the_pyramid(size: tuple[int, int], share: float) -> None:
    depth, inside = blob(*size, share)
    found = filled(depth, inside)
    assert found.dtype == np.float32
    if not depth.any():
        assert not found.any()
        return
    expected = np.where(inside, slow(depth, (depth > 0).astype(float)), 0)
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_own_depth_stays_and_nothing_lies_beyond_it(seed: int) -> None:
    depth, inside = blob(40, 30, 0.1, seed)
    given = depth.copy()
    found = filled(depth, inside)
    assert np.array_equal(depth, given)  # what is given is left alone
    assert np.array_equal(found[depth > 0], depth[depth > 0])
    assert not found[~inside].any()
    assert (found[inside] >= depth[depth > 0].min() - 1e-6).all()
    assert (found[inside] <= depth.max() + 1e-6).all()


def test_a_hole_in_a_slope_is_bridged_without_streaks() -> None:
    i, j = np.mgrid[:60, :60]
    slope = (2 + 0.002 * i + 0.003 * j).astype(np.float32)
    hole = (i - 30) ** 2 + (j - 30) ** 2 < 8**2
    found = filled(np.where(hole, np.float32(0), slope), np.ones_like(hole))
    assert np.abs(found - slope)[hole].mean() < 0.01
    # Of the row alone, or of the nearest pixel, a neighbour would jump by the hole's width.
    assert np.abs(np.diff(found, axis=0)).max() < 0.02
    assert np.abs(np.diff(found, axis=1)).max() < 0.02


def test_without_depth_or_without_holes_there_is_nothing_to_do() -> None:
    nothing, inside = np.zeros((4, 5), np.float32), np.ones((4, 5), bool)
    assert not filled(nothing, inside).any()
    whole = np.full((4, 5), 2, np.float32)
    assert np.array_equal(filled(whole, inside), whole)
