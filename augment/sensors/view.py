"""What a depth sensor looks at: the foreground of an orthographic view, as a device sees it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from augment.srgb import linear, srgb

UNIT_TOLERANCE = 4e-3
"""On a normal's squared length; half precision rounds its three parts."""

STEEPEST_SLOPE = 10.0
"""Depth per length across that a pixel's plane may have; at the outline it would have no end."""

FARTHEST = 100.0
"""Metres from the device; what is farther was not given in metres."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""Of linear Rec. 709 red, green and blue."""

GREY = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Of coded red, green and blue (Rec. 601)."""


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
            or not self.depth.size
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
        if self.depth.dtype.kind != "f":
            raise ValueError(f"depth is of type {self.depth.dtype}; give metres as floats")
        if not (0 < self.grid.pixel_size < np.inf and np.isfinite(self.grid.distance)):
            raise ValueError(f"{self.grid} is no grid; give metres, pixel_size above 0")
        if not _sound(self.depth):
            raise ValueError("depth holds NaN, infinite or negative values; clean the map")
        if self.depth_at.min(initial=1) <= 0:
            raise ValueError("depth is 0 inside the mask; give a mask of the surface alone")
        z = self.distance_at
        if len(z) and not 0 < z.min() <= z.max() < FARTHEST:
            raise ValueError(
                f"the surface lies {z.min():g} to {z.max():g} m before the device; give depth in "
                "metres and a sensor.distance beyond the surface"
            )
        nx, ny, nz = self.normal_at
        squared = nx * nx + ny * ny + nz * nz
        least, most = squared.min(initial=1), squared.max(initial=1)
        if not (least > 1 - UNIT_TOLERANCE and most < 1 + UNIT_TOLERANCE):
            raise ValueError("a normal inside the mask is not unit; normalise the normal map")
        if self.albedo.dtype != np.uint8:
            bright = self.at(self.albedo)
            if not (bright.min(initial=0) >= 0 and bright.max(initial=1) <= 1):
                raise ValueError(
                    "albedo inside the mask is not in [0, 1]; give linear light or uint8 sRGB"
                )

    @cached_property
    def part(self) -> tuple[slice, slice]:
        """The foreground's rectangle in the maps and one pixel around it, where there is one."""
        hit = [np.flatnonzero(self.mask.any(axis=axis)) for axis in (1, 0)]
        rows, columns = (
            slice(max(at[0] - 1, 0), at[-1] + 2) if len(at) else slice(0, 1) for at in hit
        )
        return rows, columns

    @cached_property
    def inside(self) -> np.ndarray:
        """(h, w) bool: the mask in `part`."""
        return np.ascontiguousarray(self.mask[self.part])

    def at(self, image: np.ndarray) -> np.ndarray:
        """(N,) the foreground of an (H, W) map in row order, or (C, N) of an (H, W, C) one."""
        if image.ndim == 2:
            return image[self.part][self.inside]
        # A pixel's channels are taken as one item: many times as fast as an axis of them.
        item = np.dtype((np.void, image.itemsize * image.shape[2]))
        found = np.ascontiguousarray(image[self.part]).view(item)[..., 0][self.inside]
        return found.view(image.dtype).reshape(len(found), image.shape[2]).T

    def along(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(2, N) what (h,) and (w,) values of the rows and columns of `part` are at each pixel."""
        both = (rows[:, None], columns)
        return np.stack([np.broadcast_to(v, self.inside.shape)[self.inside] for v in both])

    @cached_property
    def depth_at(self) -> np.ndarray:
        """(N,) float32 depth from the camera's plane."""
        return self.at(self.depth).astype(np.float32, copy=False)

    @cached_property
    def normal_at(self) -> np.ndarray:
        """(3, N) float32."""
        found = self.at(self.normal)
        if found.dtype == np.float16:
            return _single(found)
        return found.astype(np.float32, order="C", copy=False)

    @cached_property
    def slope_at(self) -> np.ndarray:
        """(2, N) float32 depth per length downwards and to the right, of each pixel's plane."""
        nx, ny, nz = self.normal_at
        # n . (dx, dy, -d depth) = 0, with rows counted downwards.
        slope = np.stack([-ny, nx]) / np.maximum(nz, np.float32(1e-3))
        return np.clip(slope, -STEEPEST_SLOPE, STEEPEST_SLOPE)

    @cached_property
    def distance_at(self) -> np.ndarray:
        """(N,) float32 metres from the device along its axis."""
        return self.depth_at + np.float32(self.device_distance - self.grid.distance)

    @cached_property
    def cosine_at(self) -> np.ndarray:
        """(N,) float32 cosine of the angle between the normal and the ray back to the device."""
        (rows, columns), size = self.depth.shape, np.float32(self.grid.pixel_size)
        x = (np.arange(columns, dtype=np.float32) + np.float32(0.5 - columns / 2)) * size
        y = (np.float32(rows / 2 - 0.5) - np.arange(rows, dtype=np.float32)) * size
        y, x = self.along(y[self.part[0]], x[self.part[1]])
        z = self.distance_at
        nx, ny, nz = self.normal_at
        length = np.sqrt(x * x + y * y + z * z)
        return np.clip((nz * z - nx * x - ny * y) / length, -1, 1)

    @cached_property
    def luminance_at(self) -> np.ndarray:
        """(N,) float32 in [0, 1], linear."""
        found = self.at(self.albedo)
        if found.dtype == np.uint8:
            found = _LINEAR.take(found)
        bright = _weighed(LUMINANCE, found) if found.ndim == 2 else found
        return np.clip(bright.astype(np.float32, copy=False), 0, 1)

    @cached_property
    def grey_at(self) -> np.ndarray:
        """(N,) float32 grey level of the sRGB bytes, 0 to 255."""
        found = self.at(self.albedo)
        if found.dtype != np.uint8:
            found = 255 * srgb(found.astype(np.float32, copy=False))
        return np.rint(_weighed(GREY, found) if found.ndim == 2 else found)

    def filled(self, background: float) -> np.ndarray:
        """(h, w) float32 depth in `part`.

        Args:
            background: depth of what lies behind the outline, metres from the camera's plane.
        """
        seen = np.where(self.inside, self.depth[self.part], np.float32(background))
        return seen.astype(np.float32, copy=False)

    def edges(self, step: float, background: float) -> tuple[np.ndarray, np.ndarray]:
        """The foreground pixels that see two depths, and the farther one.

        Args:
            step: metres of depth between neighbours from which on they are two.
            background: depth of what lies behind the outline, metres from the camera's plane.

        Returns:
            (E,) index among the foreground pixels, in row order, and (E,) float32 depth: the
            farthest of the eight neighbours, or the background where one is none.
        """
        here = over_window(self.filled(background), np.maximum)[self.inside]
        edge = np.flatnonzero(here - self.depth_at > step)
        return edge, here[edge]

    def on_map(self, values: np.ndarray) -> np.ndarray:
        """(H, W) map of the type of `values` (N,), 0 outside of the foreground."""
        if values.dtype == bool and values.all():
            return self.mask.copy()
        whole = np.zeros(self.mask.shape, dtype=values.dtype)
        whole[self.part][self.inside] = values
        return whole


def over_window(image: np.ndarray, join: np.ufunc) -> np.ndarray:
    """(h, w): `join` over every pixel's 3x3 window; the border repeats itself.

    So the image's border is no outline: what lies beyond is not known.
    """
    padded = np.pad(image, 1, mode="edge")
    rows = join(join(padded[:-2], padded[1:-1]), padded[2:])
    joined: np.ndarray = join(join(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return joined


def _weighed(weights: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """(N,) float32 sum of (3, N) channels by (3,) weights.

    Not by `@`: the last bit of its sums depends on how many threads BLAS has in a process, so one
    beside the build that made a shard could not read it again.
    """
    red, green, blue = channels.astype(np.float32, copy=False)
    total = weights[0] * red
    total += weights[1] * green
    total += weights[2] * blue
    return total


def _sound(depth: np.ndarray) -> bool:
    """Whether every depth is finite and none is negative."""
    if depth.dtype == np.float32 and depth.view(np.uint32).max() < _INFINITY:
        return True  # in one pass: NaN, infinity and all with a sign lie above
    # Extremes are NaN where anything is.
    return bool(depth.min() >= 0 and depth.max() < np.finfo(np.float32).max)


def _single(half: np.ndarray) -> np.ndarray:
    """Float16 as float32, by its bits: six times as fast as NumPy; inf and NaN are 65536 and up.

    Sign and exponent move to where float32 has them; the exponents' biases differ by 112.
    """
    bits = half.view(np.int16).astype(np.int32, order="C")
    bits <<= 13
    bits &= ~0x70000000
    single = bits.view(np.float32)
    single *= np.float32(2.0**112)
    return single


_INFINITY = np.float32(np.inf).view(np.uint32)
"""The bits of infinity, above those of every positive number."""

_LINEAR = linear(np.arange(256) / 255).astype(np.float32)
"""(256,) linear light of sRGB bytes."""
