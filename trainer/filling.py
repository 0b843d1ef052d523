"""Depth where a map has none: a smooth surface through what is around."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn.functional import avg_pool2d, interpolate


def filled(depth: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Depth at every pixel inside: its own, or that of its surroundings.

    Averages over cells of 2, 4, 8, ... pixels, of what they hold of the map's own, are laid over
    one another, the coarse ones first ("pull-push" of Gortler et al., The Lumigraph, SIGGRAPH
    1996): close to the map's own depth the filling follows it, farther off it flattens.

    Args:
        depth: (h, w) float32 metres, 0 = none; 0 outside.
        inside: (h, w) bool.

    Returns:
        (h, w) float32; `depth` itself where nothing is missing, or all.
    """
    missing = np.flatnonzero(inside & (depth <= 0))
    if not len(missing) or not depth.any():
        return depth
    maps = torch.from_numpy(np.stack([depth, depth > 0])[None])
    pyramid: list[torch.Tensor] = []
    while not pyramid or (max(maps.shape[-2:]) > 1 and not maps[:, 1].all()):
        maps = avg_pool2d(maps, 2, ceil_mode=True)
        pyramid.append(maps)
    found = _mean(pyramid.pop())
    for maps in reversed(pyramid):
        around = interpolate(found, scale_factor=2.0, mode="bilinear")
        around = around[..., : maps.shape[-2], : maps.shape[-1]]
        found = torch.where(maps[:, 1:] > 0, _mean(maps), around)
    whole = depth.copy()
    whole.reshape(-1)[missing] = _between(found[0, 0].numpy(), *np.divmod(missing, depth.shape[1]))
    return whole


def _mean(maps: torch.Tensor) -> torch.Tensor:
    """(1, 1, h, w): the depth of each cell from its sum and share; 0 where it holds none."""
    return maps[:, :1] / maps[:, 1:].clamp_min(1e-9)


def _between(cells: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Bilinear values at pixels of the map that is twice as large: few, so not of all of them."""
    place = []
    for index, count in zip((rows, columns), cells.shape, strict=True):
        at = np.clip((index - np.float32(0.5)) / 2, 0, count - 1, dtype=np.float32)
        low = at.astype(np.intp)
        place.append((low, np.minimum(low + 1, count - 1), at - low))
    (top, bottom, down), (left, right, across) = place
    above = cells[top, left] * (1 - across) + cells[top, right] * across
    below = cells[bottom, left] * (1 - across) + cells[bottom, right] * across
    return above * (1 - down) + below * down
