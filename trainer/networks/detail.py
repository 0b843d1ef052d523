"""What a depth map has beyond its surroundings' means: noise, folds and edges."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

WINDOWS = (3, 5, 9)
"""Pixels across the surroundings."""


def detail(depth: Tensor, mask: Tensor) -> Tensor:
    """Depth less the mean of its surroundings inside the mask, for each window; 0 outside.

    Args:
        depth: (B, 1, H, W), any unit; values outside the mask do not matter.
        mask: (B, 1, H, W) bool.

    Returns:
        (B, len(WINDOWS), H, W), in the unit of `depth`.
    """
    depth = torch.where(mask, depth, 0)
    inside = mask.to(depth.dtype)
    found = []
    for window in WINDOWS:
        sums, shares = (avg_pool2d(maps, window, 1, window // 2) for maps in (depth, inside))
        found.append((depth - sums / shares.clamp_min(1e-6)) * inside)
    return torch.cat(found, dim=1)
