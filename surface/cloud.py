"""Back-projection: from a depth map to points.

Eq. 3 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", for the
orthographic camera of docs/conventions.md.
"""

from __future__ import annotations

import numpy as np


def lines_of_sight(shape: tuple[int, ...], pixel_size: float) -> tuple[np.ndarray, np.ndarray]:
    """Where the pixels' centres lie across the view.

    Args:
        shape: rows H and columns W.
        pixel_size: metres.

    Returns:
        (H, W) x to the right and (H, W) y upwards, camera frame, metres.
    """
    height, width = shape
    x = (np.arange(width) + 0.5 - width / 2) * pixel_size
    y = (height / 2 - np.arange(height) - 0.5) * pixel_size
    return tuple(np.meshgrid(x, y))  # type: ignore[return-value]


def back_project(depth: np.ndarray, mask: np.ndarray, pixel_size: float) -> np.ndarray:
    """The cloud of a depth map, Eq. 3.

    Args:
        depth: (H, W) metres from the front camera's plane, of the front or of the back.
        mask: (H, W) bool, the pixels wanted.
        pixel_size: metres.

    Returns:
        (N, 3) float64 points of the mask's pixels in the order of rows, front camera's frame.
    """
    x, y = lines_of_sight(depth.shape, pixel_size)
    return np.stack([x[mask], y[mask], -depth[mask].astype(np.float64)], axis=1)
