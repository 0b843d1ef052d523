"""From a depth camera's perspective to the orthographic frame, and back.

Section 3.2 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images" takes a
Kinect's depth map as it is for an orthographic one: what perspective changes about a person is
small. Said as a map of space: a point at depth Z goes to

    (X, Y, Z)  ->  (X m / Z, Y m / Z, Z)

where m is the depth of the person's middle, the body's. Lines of sight become parallel, depth
stays. What is made in the orthographic frame goes back the other way, so the surface is metric in
the camera's own frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from shards.raycast import Surface
from surface.cloud import lines_of_sight
from surface.mesh import SurfaceError, TriangleMesh

BEHIND = (
    "the body reaches behind the camera; give it in the camera's frame, in metres, x right, y up, "
    "z towards the viewer"
)

HALF_THICKNESS = 0.1
"""Metres from a person's front to the middle, where no body tells."""


@dataclass(frozen=True)
class Pinhole:
    """The intrinsics of a depth camera, in pixels; the defaults are a Kinect v2's.

    Attributes:
        fx, fy: focal lengths.
        cx, cy: column and row, counted from 0 at a pixel's centre, where the axis passes.
    """

    fx: float = 365.5
    fy: float = 365.5
    cx: float = 255.0
    cy: float = 205.0

    def __post_init__(self) -> None:
        if not (0 < self.fx < np.inf and 0 < self.fy < np.inf):
            raise ValueError(f"fx, fy: {self.fx}, {self.fy}; give the focal lengths in pixels")
        if not (np.isfinite(self.cx) and np.isfinite(self.cy)):
            raise ValueError(f"cx, cy: {self.cx}, {self.cy}; give the axis's column and row")


class Frame(NamedTuple):
    """One capture of a depth camera; all maps are of its own grid.

    Attributes:
        rgb: (h, w, 3) uint8 sRGB, registered to the depth.
        depth: (h, w) float metres along the axis, 0 = no reading.
        mask: (h, w) bool, the person.
        body: the person's body in the camera's frame (x right, y up, z towards the viewer), metres,
            or None.
    """

    rgb: np.ndarray
    depth: np.ndarray
    mask: np.ndarray
    body: TriangleMesh | None


class Orthographic(NamedTuple):
    """A capture in the orthographic frame.

    Attributes:
        rgb, depth, mask: (H, W, ...) as of `Frame`.
        body_back: (H, W) float32 metres, the body's farthest surface, 0 where it is not.
        pixel_size: metres.
        place: how it got there.
    """

    rgb: np.ndarray
    depth: np.ndarray
    mask: np.ndarray
    body_back: np.ndarray
    pixel_size: float
    place: Place


@dataclass(frozen=True)
class Place:
    """Where the orthographic grid lies in the camera's frame.

    Attributes:
        middle: m, metres from the camera.
        shown: metres from the orthographic camera's plane at which m stands.
        center: x and y of the grid's middle at depth m, metres.
    """

    middle: float
    shown: float
    center: tuple[float, float]

    def to_orthographic(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) from the camera's frame.

        Raises:
            SurfaceError: a point does not lie before the camera.
        """
        depth = -points[:, 2]
        if not (depth > 0).all():
            raise SurfaceError(BEHIND)
        across = points[:, :2] * (self.middle / depth)[:, None] - self.center
        return np.column_stack([across, -(depth - self.middle + self.shown)])

    def from_orthographic(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) into the camera's frame."""
        depth = -points[:, 2] + self.middle - self.shown
        across = (points[:, :2] + self.center) * (depth / self.middle)[:, None]
        return np.column_stack([across, -depth])


def orthographic(
    frame: Frame, camera: Pinhole, shape: tuple[int, int], pixel_size: float, shown: float
) -> Orthographic:
    """A capture brought to the orthographic frame.

    Args:
        frame: the capture.
        camera: that took it.
        shape: rows H and columns W of the grid wanted.
        pixel_size: metres, of that grid.
        shown: metres from the orthographic camera's plane to the person's middle.

    Raises:
        SurfaceError: maps disagree in size, the person is not seen or does not fit the grid, or the
            body lies elsewhere.
    """
    rgb, depth, mask, body = frame
    if not (depth.ndim == 2 and mask.shape == depth.shape and rgb.shape == (*depth.shape, 3)):
        raise SurfaceError(
            f"colour is {rgb.shape}, depth {depth.shape} and mask {mask.shape}; give (h, w, 3) and "
            "twice (h, w), the colour registered to the depth"
        )
    read = depth[mask & (depth > 0)]
    if not len(read):
        raise SurfaceError("the depth camera read nothing of the person")
    if body is None:
        middle = float(np.median(read)) + HALF_THICKNESS
    else:
        middle = float(np.median(-body.vertices[:, 2]))
    if not middle > 0:
        raise SurfaceError(BEHIND)
    rows, columns = np.nonzero(mask)
    x = (columns - camera.cx) * middle / camera.fx
    y = (camera.cy - rows) * middle / camera.fy
    spans = float(np.ptp(y)), float(np.ptp(x))
    room = tuple((side - 4) * pixel_size for side in shape)
    if spans[0] > room[0] or spans[1] > room[1]:
        raise SurfaceError(
            f"the person spans {spans[0]:.2f} m x {spans[1]:.2f} m, the grid holds {room[0]:.2f} m "
            f"x {room[1]:.2f} m; mask the background, or check fx and fy"
        )
    place = Place(middle, shown, (float(x.min() + x.max()) / 2, float(y.min() + y.max()) / 2))
    across, up = lines_of_sight(shape, pixel_size)
    source = np.stack(
        [
            camera.cy - (up + place.center[1]) * camera.fy / middle,
            camera.cx + (across + place.center[0]) * camera.fx / middle,
        ]
    )

    def nearest(values: np.ndarray) -> np.ndarray:
        return map_coordinates(values, source, order=0, cval=0)

    inside = nearest(mask.astype(np.uint8)) > 0
    at = nearest(depth.astype(np.float32))
    moved = np.where(inside & (at > 0), at - middle + shown, 0).astype(np.float32)
    color = np.stack(
        [map_coordinates(rgb[..., c].astype(np.float32), source, order=1) for c in range(3)], axis=2
    )
    color = np.where(inside[..., None], np.rint(color).clip(0, 255), 0).astype(np.uint8)
    body_back = np.zeros(shape, np.float32)
    if body is not None:
        placed = replace(body, vertices=place.to_orthographic(body.vertices))
        xy = np.stack([across.ravel(), up.ravel()], axis=1)
        hits = Surface(placed.vertices, placed.faces).cast(xy, np.eye(4), 1)
        body_back = np.nan_to_num(-hits.z).reshape(shape).astype(np.float32)
        if not (body_back[inside] > 0).any():
            raise SurfaceError(
                "the body does not lie where the person is seen; give it in the depth camera's "
                "frame, in metres, x right, y up, z towards the viewer"
            )
    return Orthographic(color, moved, inside, body_back, pixel_size, place)
