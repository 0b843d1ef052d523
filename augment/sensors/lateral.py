"""Noise across the view: every pixel reads the surface a little beside itself."""

from __future__ import annotations

import numpy as np

from augment.sensors.view import View

STEEPEST_SLOPE = 10.0
"""Depth per length across that a pixel's plane may have; at the outline it would have no end."""


def displaced(view: View, sigma: np.ndarray | float, rng: np.random.Generator) -> np.ndarray:
    """(N,) float32 depth that each foreground pixel reads beside itself; 0 where that is nothing.

    A pixel's place moves by a Gaussian in each direction. It reads the plane of the pixel that it
    falls into: nothing is averaged over a depth step.

    Args:
        sigma: standard deviation in pixels of the grid, (N,) or one for all.
        rng: draws 2 N standard normals.
    """
    rows, columns = view.depth.shape
    move = rng.standard_normal((2, len(view.pixels)), dtype=np.float32) * np.float32(sigma)
    whole = np.rint(move).astype(np.int32)
    part = move - whole
    i, j = np.divmod(view.pixels.astype(np.int32), np.int32(columns))
    i, j = i + whole[0], j + whole[1]
    outside = (i < 0) | (i >= rows) | (j < 0) | (j >= columns)
    target = np.where(outside, 0, i * columns + j)
    missed = outside | ~view.mask.take(target)
    target = np.where(missed, view.pixels, target)

    nx, ny, nz = view.normal.reshape(-1, 3).take(target, axis=0).astype(np.float32).T
    nz = np.maximum(nz, np.float32(1e-3))
    # The plane through the pixel: n . (dx, dy, -d depth) = 0, with rows counted downwards.
    slope = np.clip(np.stack([-ny / nz, nx / nz]), -STEEPEST_SLOPE, STEEPEST_SLOPE)
    size = np.float32(view.grid.pixel_size)
    depth = view.depth.take(target) + (slope * part).sum(axis=0) * size
    depth[missed] = 0
    return depth.astype(np.float32, copy=False)
