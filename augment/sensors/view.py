"""What a depth sensor looks at: the foreground of an orthographic view, as a device sees it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

UNIT_TOLERANCE = 4e-3
"""On a normal's squared length; half precision rounds its three parts."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""Of linear Rec. 709 red, green and blue."""


class Grid(NamedTuple):
    """The camera of a depth map: its pixels and its plane.

    Attributes:
        pixel_size: side of a pixel, metres.
        distance: from the camera's plane to the subject's axis, metres.
    """

    pixel_size: float
    distance: float


class Reading(NamedTuple):
    """What a sensor saw.

    Attributes:
        depth: (H, W) float32 metres from the camera's plane, 0 where invalid.
        valid: (H, W) bool.
        sigma: (H, W) float32, standard deviation of the noise along the axis in metres, 0 where
            there is no surface.
    """

    depth: np.ndarray
    valid: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True, eq=False)
class View:
    """A view's maps, and its foreground as a device on the axis sees it.

    An orthographic map has neither a distance of its own nor a ray: a device is set before the
    image's centre, `device_distance` from the subject's axis, and sees every point from there. The
    maps stay in the orthographic grid.

    Attributes:
        depth: (H, W) float32 metres from the camera's plane, 0 = no surface.
        normal: (H, W, 3) unit, camera frame (z towards the viewer).
        albedo: (H, W) or (H, W, 3) in [0, 1], linear, or uint8 sRGB: how bright the surface is.
        mask: (H, W) bool.
        grid: of the maps.
        device_distance: metres from the device to the subject's axis.

    Raises:
        ValueError: the shapes disagree, or a map holds what cannot be.
    """

    depth: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    mask: np.ndarray
    grid: Grid
    device_distance: float

    def __post_init__(self) -> None:
        shape = self.depth.shape
        if (
            self.depth.ndim != 2
            or self.mask.shape != shape
            or self.normal.shape != (*shape, 3)
            or self.albedo.shape not in (shape, (*shape, 3))
        ):
            raise ValueError(
                f"shapes disagree: depth {shape}, normal {self.normal.shape}, albedo "
                f"{self.albedo.shape}, mask {self.mask.shape}; give (H, W), (H, W, 3), (H, W) or "
                "(H, W, 3), and (H, W)"
            )
        if self.mask.dtype != bool:
            raise ValueError(f"the mask is of type {self.mask.dtype}; give bool")
        # A minimum is NaN where anything is.
        foreground = self.depth_at
        if not (self.depth.min(initial=0) >= 0 and self.depth.max(initial=0) < np.inf):
            raise ValueError("depth holds NaN, infinite or negative values; clean the map")
        if len(foreground) and foreground.min() <= 0:
            raise ValueError("depth is 0 inside the mask; give a mask of the surface alone")
        squared = np.square(self.normal_at) @ np.ones(3, dtype=np.float32)
        least, most = squared.min(initial=1), squared.max(initial=1)
        if not (least > 1 - UNIT_TOLERANCE and most < 1 + UNIT_TOLERANCE):
            raise ValueError("a normal inside the mask is not unit; normalise the normal map")

    @cached_property
    def pixels(self) -> np.ndarray:
        """(N,) index of every foreground pixel in the flattened map, in row order."""
        return np.flatnonzero(self.mask)

    @cached_property
    def depth_at(self) -> np.ndarray:
        """(N,) float32 depth from the camera's plane."""
        return self.depth.take(self.pixels).astype(np.float32, copy=False)

    @cached_property
    def normal_at(self) -> np.ndarray:
        """(N, 3) float32."""
        found = self.normal.reshape(-1, 3).take(self.pixels, axis=0)
        if found.dtype == np.float16:
            # Half precision has few values: a table is faster than the conversion.
            return _SINGLE.take(found.view(np.uint16))
        return found.astype(np.float32, copy=False)

    @cached_property
    def distance_at(self) -> np.ndarray:
        """(N,) float32 metres from the device along its axis."""
        return self.depth_at + np.float32(self.device_distance - self.grid.distance)

    @cached_property
    def xy(self) -> np.ndarray:
        """(2, N) float32 metres: x and y in the camera's frame."""
        rows, columns = self.depth.shape
        i, j = np.divmod(self.pixels.astype(np.int32), np.int32(columns))
        size = np.float32(self.grid.pixel_size)
        x = (j.astype(np.float32) + np.float32(0.5 - columns / 2)) * size
        y = (np.float32(rows / 2 - 0.5) - i.astype(np.float32)) * size
        return np.stack([x, y])

    @cached_property
    def cosine_at(self) -> np.ndarray:
        """(N,) float32 cosine of the angle between the normal and the ray back to the device."""
        x, y = self.xy
        z = self.distance_at
        nx, ny, nz = self.normal_at.T
        length = np.sqrt(x * x + y * y + z * z)
        return np.clip((nz * z - nx * x - ny * y) / length, -1, 1)

    @cached_property
    def luminance_at(self) -> np.ndarray:
        """(N,) float32 in [0, 1], linear."""
        flat = self.albedo.reshape(self.depth.size, -1).take(self.pixels, axis=0)
        if flat.dtype == np.uint8:
            flat = _LINEAR.take(flat)
        flat = flat.astype(np.float32, copy=False)
        bright: np.ndarray = flat @ LUMINANCE if flat.shape[1] == 3 else flat[:, 0]
        return np.clip(bright, 0, 1)

    def edges(self, step: float, background: float) -> tuple[np.ndarray, np.ndarray]:
        """The foreground pixels that see two depths, and the farther one.

        Args:
            step: metres of depth between neighbours from which on they are two.
            background: depth of what lies behind the outline, metres from the camera's plane.

        Returns:
            (E,) index among the foreground pixels, in row order, and (E,) float32 depth: the
            farthest of the eight neighbours, or the background where one is none.
        """
        rows = np.flatnonzero(self.mask.any(axis=1))
        if not len(rows):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.float32)
        part = slice(max(rows[0] - 1, 0), rows[-1] + 2)
        mask, depth = self.mask[part], self.depth[part]
        # The image's border is no outline: what lies beyond is not known.
        whole = np.pad(np.where(mask, depth, np.float32(background)), 1, mode="edge")
        far = whole[:-2].copy()
        np.maximum(far, whole[1:-1], out=far)
        np.maximum(far, whole[2:], out=far)
        farthest = np.maximum(np.maximum(far[:, :-2], far[:, 1:-1]), far[:, 2:])
        here = farthest.astype(np.float32, copy=False)[mask]
        edge = np.flatnonzero(here - self.depth_at > step)
        return edge, here[edge]

    def on_map(self, values: np.ndarray) -> np.ndarray:
        """(H, W) map of the type of `values` (N,), 0 outside of the foreground."""
        if values.dtype == bool and values.all():
            return self.mask.copy()
        whole = np.zeros(self.depth.size, dtype=values.dtype)
        whole[self.pixels] = values
        return whole.reshape(self.depth.shape)


def _linear() -> np.ndarray:
    coded = np.arange(256) / 255
    curve = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    return curve.astype(np.float32)


_LINEAR = _linear()
"""(256,) linear light of sRGB bytes."""

_SINGLE = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
"""(65536,) every half-precision number in single precision."""
