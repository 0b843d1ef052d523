"""A view's maps as pictures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

PAPER = 250
"""Grey where there is no surface."""

TITLES = {
    "rgb_front": "RGB front",
    "rgb_back": "RGB back",
    "depth_front": "depth front",
    "depth_back": "depth back",
    "normal_front": "normals front",
    "normal_back": "normals back",
    "depth_sensor": "sensor depth, shaded",
    "body_depth_front": "body, front",
    "body_depth_back": "body, back",
    "thickness": "thickness",
}
"""What can be shown, in words."""

THICKEST = 0.5
"""Metres from front to back that are shown brightest; more is as bright."""


def pictured(view: Mapping[str, np.ndarray], name: str, pixel_size: float) -> np.ndarray:
    """(H, W, 3) uint8 of one map, paper where there is no surface.

    Args:
        view: a shard's view, with `mask`, both depths and what is shown.
        name: of `TITLES`.
        pixel_size: metres.
    """
    array = view["depth_back"] - view["depth_front"] if name == "thickness" else view[name]
    inside = view["mask"]
    if name.startswith("normal"):
        # z towards the viewer of each side reads blue in both.
        shown = array.astype(np.float32) * [1, 1, -1 if name.endswith("back") else 1]
        image = np.rint((shown + 1) * 127.5)
    elif name == "depth_sensor":
        inside = array > 0
        image = _grey(_relief(array, inside, pixel_size))
    elif name == "thickness":
        image = _grey(20 + 215 * np.clip(array / THICKEST, 0, 1))
    elif "depth" in name:
        inside = array > 0
        near, far = _depth_range(view)
        share = np.clip((far - array) / (far - near), 0, 1)
        # Near is bright from the front; from the back, what is far from the front camera is near.
        share = 1 - share if name.endswith("back") else share
        image = _grey(20 + 215 * share)
    else:
        image = array
    return np.where(inside[..., None], image, PAPER).astype(np.uint8)


def box_of(view: Mapping[str, np.ndarray]) -> tuple[slice, slice]:
    """Rows and columns that hold the subject, and its body, which may leave the silhouette.

    Args:
        view: a shard's view, with `mask`, not empty, and `body_depth_back`.
    """
    seen = view["mask"] | (view["body_depth_back"] > 0)
    return _extent(seen.any(axis=1)), _extent(seen.any(axis=0))


def height_of(mask: np.ndarray, pixel_size: float) -> float:
    """Metres of a silhouette that is not empty, raised hands included."""
    rows = _extent(mask.any(axis=1))
    return (rows.stop - rows.start) * pixel_size


def _extent(used: np.ndarray) -> slice:
    """From the first that is used to the last."""
    places = np.flatnonzero(used)
    return slice(int(places[0]), int(places[-1]) + 1)


def _grey(image: np.ndarray) -> np.ndarray:
    return np.repeat(image[..., None], 3, axis=-1)


def _relief(depth: np.ndarray, inside: np.ndarray, pixel_size: float) -> np.ndarray:
    """(H, W) grey of a depth map lit from the upper left: noise of a millimetre shows."""
    down, right = np.gradient(np.where(inside, depth, np.nan), pixel_size)
    # The surface's normal is (dz/dx, dz/dy, 1) of the depth, y upwards; the light is (-1, 1, 2).
    lit = (-right - down + 2) / np.sqrt(6 * (right**2 + down**2 + 1))
    return 235 * np.clip(np.nan_to_num(lit, nan=0.0), 0, 1)


def _depth_range(view: Mapping[str, np.ndarray]) -> tuple[float, float]:
    mask = view["mask"]
    return float(view["depth_front"][mask].min()), float(view["depth_back"][mask].max())
