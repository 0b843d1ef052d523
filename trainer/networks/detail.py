"""What a depth map has beyond its surroundings' means: noise, folds and edges.

A U-Net that is to take something away from a depth map, a sensor's noise or the relief of a bare
body, would have to repeat it first, which convolutions learn slowly. It is given these differences
instead, and predicts how much of each is to go.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

SCALE = 0.02
"""Normalised depth, some 15 mm, that is 1 to a network where it sees detail: a sensor's
noise is a few tenths of it, the relief of a back one or two. In half precision the depth beside it
could not hold that: at 0.5 its steps are 0.004."""

LIMIT = 3.0
"""Of detail as a network sees it: an arm before the trunk is a step of twenty."""


def detail(depth: Tensor, mask: Tensor, windows: Sequence[int]) -> Tensor:
    """Depth less the mean of its surroundings inside the mask, for each window; 0 outside.

    Args:
        depth: (B, 1, H, W), any unit; values outside the mask do not matter.
        mask: (B, 1, H, W) bool.
        windows: pixels across the surroundings, odd.

    Returns:
        (B, len(windows), H, W), in the unit of `depth`.
    """
    depth = torch.where(mask, depth, 0)
    inside = mask.to(depth.dtype)
    maps = torch.cat([depth, inside], dim=1)
    found = []
    for window in windows:
        margin = window // 2
        down = avg_pool2d(maps, (window, 1), 1, (margin, 0))
        sums, shares = avg_pool2d(down, (1, window), 1, (0, margin)).split(1, dim=1)
        found.append((depth - sums / shares.clamp_min(1e-6)) * inside)
    return torch.cat(found, dim=1)


def visible(differences: Tensor) -> Tensor:
    """Detail as a network is given it."""
    return (differences / SCALE).clamp(-LIMIT, LIMIT)
