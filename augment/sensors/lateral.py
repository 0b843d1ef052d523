"""Noise across the view: every pixel reads the surface a little beside itself."""

from __future__ import annotations

import numpy as np

from augment.sensors.view import View


def displaced(view: View, sigma: np.ndarray | float, rng: np.random.Generator) -> np.ndarray:
    """(N,) float32 depth that each foreground pixel reads beside itself; 0 where that is nothing.

    A pixel's place moves by a Gaussian in each direction. It reads the plane of the pixel that it
    falls into: nothing is averaged over a depth step.

    Args:
        sigma: standard deviation in pixels of the grid, (N,) or one for all.
        rng: draws 2 N standard normals.
    """
    count, (rows, columns) = len(view.depth_at), view.inside.shape
    move = rng.standard_normal((2, count), dtype=np.float32) * np.float32(sigma)
    whole = np.rint(move)
    part = move - whole
    # Which foreground pixel lies where, and -1 where none does, as all around `view.part`.
    order = np.full((rows + 2, columns + 2), -1)
    order[1:-1, 1:-1][view.inside] = own = np.arange(count)
    place = view.along(*(np.arange(1, n + 1, dtype=np.int32) for n in view.inside.shape))
    i, j = place + whole.astype(np.int32)
    i, j = np.clip(i, 0, rows + 1), np.clip(j, 0, columns + 1)
    target = order.take(i * (columns + 2) + j)
    missed = target < 0
    target = np.where(missed, own, target)
    down, right = (slope.take(target) for slope in view.slope_at)
    beside = (down * part[0] + right * part[1]) * np.float32(view.grid.pixel_size)
    depth = view.depth_at.take(target) + beside
    depth[missed] = 0
    return depth
