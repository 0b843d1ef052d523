"""One capture of a depth camera, from files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from surface.mesh import read_mesh
from surface.pinhole import Frame, Pinhole


@dataclass(frozen=True)
class FrameFiles:
    """The files of one capture, and the camera that took it."""

    rgb: str | None = None
    """Colour image, registered to the depth (PNG, JPEG)."""
    depth: str | None = None
    """Depth image of 16 bits (PNG), 0 = no reading."""
    mask: str | None = None
    """Image of the depth's size, above 0 where the person is; by default wherever depth was read,
    as if the background had been taken out.
    """
    body: str | None = None
    """Mesh of the person's bare body in the depth camera's frame: metres, x right, y up, z towards
    the viewer.
    """
    camera: Pinhole = field(default_factory=Pinhole)
    """Intrinsics of the depth camera; a Kinect v2's by default."""
    unit: float = 0.001
    """Metres of one step of the depth image."""
    pixel_size: float = 0.005
    """Metres of the pixels that the branches learned from."""

    def __post_init__(self) -> None:
        for name in ("unit", "pixel_size"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"frame.{name}: {getattr(self, name)}; give metres, such as 0.001")

    def read(self) -> Frame:
        """What the files hold.

        Raises:
            ValueError: a file is missing, unreadable or of another kind or size; one line.
        """
        if self.rgb is None or self.depth is None:
            raise ValueError("frame: give frame.rgb and frame.depth")
        depth = _image(self.depth, "frame.depth", None)
        if depth.ndim != 2 or depth.dtype == bool or depth.dtype == np.uint8:
            raise ValueError(f"{self.depth} is no depth image of 16 bits in one channel")
        rgb = _image(self.rgb, "frame.rgb", "RGB")
        mask = depth > 0
        if self.mask is not None:
            mask = _image(self.mask, "frame.mask", "L") > 0
        for path, image in ((self.rgb, rgb), (self.mask, mask)):
            if image.shape[:2] != depth.shape:
                raise ValueError(
                    f"{path} is {image.shape[0]} x {image.shape[1]} pixels, {self.depth} "
                    f"{depth.shape[0]} x {depth.shape[1]}; register it to the depth"
                )
        body = None if self.body is None else read_mesh(Path(self.body))
        return Frame(rgb, depth.astype(np.float32) * np.float32(self.unit), mask, body)


def _image(path: str, key: str, mode: str | None) -> np.ndarray:
    """An image in one of Pillow's modes, or its own."""
    try:
        with Image.open(path) as image:
            return np.asarray(image if mode is None else image.convert(mode))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise ValueError(f"{key}: {path} is no image that can be read ({error})") from None
