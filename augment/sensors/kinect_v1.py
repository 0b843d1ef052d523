"""The first Kinect: structured light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors.lateral import displaced
from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View

FOCAL_LENGTH = 585.0
"""Pixels, of the device's depth camera: what a pixel of its lateral noise is across."""

STEEPEST = np.radians(85.0)
"""Largest angle that counts; the model was measured up to 82 degrees and has a pole at 90."""


@dataclass(frozen=True)
class KinectV1(Sensor):
    """Axial and lateral noise of the first Kinect.

    sigma_z[m] = 0.0012 + 0.0019 (z - 0.4)^2 + 0.0001 / sqrt(z) t^2 / (pi/2 - t)^2,
    sigma_L[px] = 0.8 + 0.035 t / (pi/2 - t), z in metres, t the angle of incidence in radians.

    Source: Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction
    and tracking", 3DIMPVT 2012.
    """

    name: ClassVar[str] = "kinect_v1"

    lateral: float = 1.0
    """Factor on the published lateral noise; 0 leaves it out."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.lateral <= 100:
            raise ValueError(f"sensor.lateral: {self.lateral}; give a factor from 0 to 100")

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`: 2 N normals across where there is lateral noise, then N along."""
        distance, slant = view.distance_at, np.minimum(np.arccos(view.cosine_at), STEEPEST)
        ratio = slant / (np.pi / 2 - slant)
        depth = view.depth_at
        if self.lateral:
            pixels = self.lateral * (0.8 + 0.035 * ratio)
            depth = displaced(view, pixels * distance / (FOCAL_LENGTH * view.grid.pixel_size), rng)
        sigma = 0.0012 + 0.0019 * (distance - 0.4) ** 2 + 0.0001 / np.sqrt(distance) * ratio**2
        sigma = (self.noise * sigma).astype(np.float32)
        valid = depth > 0
        depth = depth + sigma * rng.standard_normal(len(sigma), dtype=np.float32)
        valid &= depth > 0
        depth[~valid] = 0
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))
