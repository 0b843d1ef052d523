"""Where lines along z meet a mesh."""

from __future__ import annotations

import tracemalloc

import numpy as np

from subjects.crossings import crossings, extents


def sheets(count: int) -> tuple[np.ndarray, np.ndarray]:
    """`count` large triangles, one above the other, over the unit square."""
    corners = np.array([[-1, -1], [3, -1], [-1, 3]])
    height = np.repeat(np.arange(count), 3)[:, None]
    vertices = np.hstack([np.tile(corners, (count, 1)), height]).astype(np.float64)
    return vertices, np.arange(3 * count).reshape(-1, 3)


def test_every_sheet_is_met_once() -> None:
    xy = np.random.default_rng(0).random((50, 2))
    met = crossings(xy, *sheets(20))
    assert np.array_equal(met.line, np.repeat(np.arange(50), 20))
    np.testing.assert_allclose(np.sort(met.z.reshape(50, 20)), np.tile(np.arange(20), (50, 1)))
    highest, lowest = extents(xy, *sheets(20))
    np.testing.assert_allclose(highest, 19)
    np.testing.assert_allclose(lowest, 0)


def test_lines_that_meet_nothing() -> None:
    highest, lowest = extents(np.array([[9.0, 9.0], [0.0, 0.0]]), *sheets(2))
    assert np.isnan(highest[0])
    assert np.isnan(lowest[0])
    np.testing.assert_allclose((highest[1], lowest[1]), (1, 0))


def test_large_triangles_do_not_fill_the_memory() -> None:
    """Each lies in all cells of the grid: 9 million entries of the smallest, 81 of the finest."""
    vertices, faces = sheets(9000)
    tracemalloc.start()
    highest, _ = extents(np.random.default_rng(0).random((20, 2)), vertices, faces)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_allclose(highest, 8999)
    assert peak < 2e9
