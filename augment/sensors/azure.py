"""The Azure Kinect: time of flight, as BlenderProc models it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View, over_window

CONSTANT, NEAR, PER_METRE = 0.0005, 0.5, 0.001
"""sigma = 0.5 mm up to half a metre, and 1 mm more for every metre beyond."""

SHIFT, STEP, DARK = 0.25, 0.8, 15.0
"""Standard deviation of a pixel's place in pixels, metres of a step, sRGB grey level."""


@dataclass(frozen=True)
class AzureKinect(Sensor):
    """Gaussian noise that grows with distance, pixels that read beside themselves, and loss.

    Places move by N(0, 0.25 pixels) and read between pixels, sigma[m] = 0.0005 +
    0.001 max(z - 0.5, 0), z in metres as read; lost are pixels whose 3x3 window spans more than
    0.8 m, and those of a grey level under 15. Behind the outline stands a wall.

    Source: BlenderProc, add_kinect_azure_noise (Denninger et al., "BlenderProc2", JOSS 2023).
    """

    name: ClassVar[str] = "azure"

    shift: float = SHIFT
    """Standard deviation in pixels of the place that a pixel reads; 0 leaves it out."""
    step: float = STEP
    """Metres of depth over which a pixel's 3x3 window may span; 0 loses none."""
    background: float = 3.5
    """Metres from the device to the wall behind the person."""
    dark: float = DARK
    """Grey level (sRGB, 0 to 255) under which a pixel is lost; 0 loses none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checks = {
            "shift": 0 <= self.shift <= 10,
            "step": self.step >= 0,
            "background": self.background > 0,
            "dark": 0 <= self.dark <= 255,
        }
        for key, right in checks.items():
            if not right:
                raise ValueError(
                    f"sensor.{key}: {getattr(self, key)} is out of bounds; see its --help"
                )

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`: 2 N normals across where pixels shift, then N along."""
        offset = np.float32(self.distance - view.grid.distance)
        seen = view.filled(self.background - float(offset))
        depth = self._between(view, seen, rng) if self.shift else view.depth_at
        sigma = CONSTANT + PER_METRE * np.maximum(depth + offset - NEAR, 0)
        sigma = (self.noise * sigma).astype(np.float32)
        depth = depth + sigma * rng.standard_normal(len(sigma), dtype=np.float32)
        valid = depth > 0
        if self.step:
            seen[view.inside] = depth
            span = over_window(seen, np.maximum) - over_window(seen, np.minimum)
            valid &= span[view.inside] <= self.step
        if self.dark:
            valid &= view.grey_at >= self.dark
        depth[~valid] = 0
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))

    def _between(self, view: View, seen: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(N,) float32 depth beside each pixel, linear between the four pixels around the place."""
        rows, columns = view.inside.shape
        seen = np.pad(seen, 1, mode="edge")
        place = view.along(*(np.arange(1, n + 1, dtype=np.float32) for n in (rows, columns)))
        place += np.float32(self.shift) * rng.standard_normal(place.shape, dtype=np.float32)
        y, x = np.clip(place[0], 0, rows + 1), np.clip(place[1], 0, columns + 1)
        i, j = np.minimum(np.floor(y), rows), np.minimum(np.floor(x), columns)
        down, right = y - i, x - j
        corner = i.astype(np.int32) * (columns + 2) + j.astype(np.int32)
        above, below = (
            seen.take(at) * (1 - right) + seen.take(at + 1) * right
            for at in (corner, corner + columns + 2)
        )
        between: np.ndarray = above * (1 - down) + below * down
        return between
