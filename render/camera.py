"""The orthographic camera: its pixel grid, its place around the subject, its frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

MAX_SIDE = 4096


class FrameError(ValueError):
    """A subject that does not fit the frame; the message names the size that would."""


@dataclass(frozen=True)
class CameraConfig:
    """The camera's grid and its distance; one orthographic camera for every view."""

    rows: int = 424
    """Height of the images in pixels (Kinect v2's depth image by default)."""
    columns: int = 512
    """Width of the images in pixels."""
    pixel_size: float | Literal["fit"] = 0.005
    """Side of a pixel in metres; `fit` chooses for each subject the smallest that holds it."""
    distance: float = 2.0
    """Metres from the camera plane to the subject's vertical axis."""

    def __post_init__(self) -> None:
        for name in ("rows", "columns"):
            if not 16 <= getattr(self, name) <= MAX_SIDE:
                raise ValueError(
                    f"camera.{name}: {getattr(self, name)} pixels; give 16 to {MAX_SIDE}"
                )
        if self.pixel_size != "fit" and not 0 < self.pixel_size < 1:
            raise ValueError(
                f"camera.pixel_size: {self.pixel_size} m; give metres per pixel, such as 0.005"
            )
        if not 0 < self.distance < 100:
            raise ValueError(f"camera.distance: {self.distance} m; give 0 to 100, such as 2.0")


@dataclass(frozen=True)
class Camera:
    """An orthographic camera that turns around the world's vertical axis.

    Camera frame (OpenGL): x right, y up, z towards the viewer. Pixel (row i, column j) of an
    H x W image has its centre at x = (j + 0.5 - W/2) p, y = (H/2 - i - 0.5) p.

    Attributes:
        rows, columns: H and W, pixels.
        pixel_size: p, metres.
        distance: metres from the camera plane to the vertical axis.
        center_height: world y of the image's centre, metres.
    """

    rows: int
    columns: int
    pixel_size: float
    distance: float
    center_height: float

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Camera:
        """The camera that a shard's `meta["camera"]` tells of."""
        rows, columns = record["size"]
        rest = (record[name] for name in ("pixel_size", "distance", "center_height"))
        return cls(rows, columns, *rest)

    def to_world(self, yaw: float, back: bool = False) -> np.ndarray:
        """(4, 4) rigid transform from camera-frame metres to the subject's world.

        A positive yaw (radians) turns the subject's face towards the camera's right (+x), so
        the camera goes round by -yaw. The back camera is the front one turned by pi about the
        vertical axis: it looks along the same lines from the other side.
        """
        angle = -yaw + (np.pi if back else 0.0)
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, 0, sin, 0], [0, 1, 0, 0], [-sin, 0, cos, 0], [0, 0, 0, 1.0]])
        place = np.eye(4)
        place[1:3, 3] = self.center_height, self.distance
        return turn @ place

    def rectangle(self, points: np.ndarray, yaw: float) -> tuple[slice, slice]:
        """Rows and columns that hold `points` ((N, 3), world) seen from the front at `yaw`.

        One pixel of margin on each side; the back view's rectangle is its mirror image.
        """
        xy = self._image_coordinates(points, yaw)
        low = np.floor(xy.min(axis=0)).astype(int) - 1
        high = np.ceil(xy.max(axis=0)).astype(int) + 1
        columns = slice(max(int(low[0]), 0), min(int(high[0]), self.columns))
        rows = slice(max(int(low[1]), 0), min(int(high[1]), self.rows))
        return rows, columns

    def _image_coordinates(self, points: np.ndarray, yaw: float) -> np.ndarray:
        """(N, 2) column and row coordinates in pixels; (0, 0) is the image's upper left corner."""
        world_to_camera = np.linalg.inv(self.to_world(yaw))
        x, y = (points @ world_to_camera[:2, :3].T + world_to_camera[:2, 3]).T / self.pixel_size
        return np.stack([x + self.columns / 2, self.rows / 2 - y], axis=1)


def outermost(points: np.ndarray) -> np.ndarray:
    """Those of `points` (N, 3), world, that bound their image at any yaw: a few in a thousand."""
    ends = [points[:, 1].argmin(), points[:, 1].argmax()]
    try:
        around = ConvexHull(points[:, [0, 2]]).vertices
    except QhullError:  # all in one vertical plane
        return points
    return points[np.concatenate([ends, around])]


def place_camera(config: CameraConfig, points: np.ndarray) -> Camera:
    """The camera that holds a surface at any yaw.

    The image's centre is level with the middle of the surface. The frame has to hold the surface
    however it is turned, so it fits the same at every yaw.

    Args:
        points: (N, 3) world, metres.

    Raises:
        FrameError: the surface is larger than the frame or reaches the camera plane.
    """
    low, high = points[:, 1].min(), points[:, 1].max()
    radius = float(np.sqrt((points[:, [0, 2]] ** 2).sum(axis=1).max()))
    # Two pixels stay free on every side: the mask never touches the border.
    needed = float(max((high - low) / (config.rows - 4), 2 * radius / (config.columns - 4), 1e-6))
    pixel_size = needed if config.pixel_size == "fit" else config.pixel_size
    if pixel_size < needed:
        raise FrameError(
            f"the subject spans {high - low:.2f} m x {2 * radius:.2f} m and the frame holds "
            f"{config.rows * pixel_size:.2f} m x {config.columns * pixel_size:.2f} m; "
            f"set camera.pixel_size to {np.ceil(needed * 1e5) / 1e5:.5f} or more, or to fit"
        )
    if radius >= config.distance:
        raise FrameError(
            f"the subject reaches {radius:.2f} m from its axis and the camera plane stands at "
            f"{config.distance:.2f} m; set camera.distance to more than {radius:.2f}"
        )
    return Camera(
        rows=config.rows,
        columns=config.columns,
        pixel_size=float(pixel_size),
        distance=config.distance,
        center_height=float((low + high) / 2),
    )
