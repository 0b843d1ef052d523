"""The Azure Kinect: time of flight, as BlenderProc models it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors.lateral import displaced
from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View

CONSTANT, NEAR, PER_METRE = 0.0005, 0.5, 0.001
"""sigma = 0.5 mm up to half a metre, and 1 mm more for every metre beyond."""

SHIFT = 0.25
"""Standard deviation of a pixel's place, pixels."""


@dataclass(frozen=True)
class AzureKinect(Sensor):
    """Gaussian noise that grows with distance, and pixels that read beside themselves.

    sigma[m] = 0.0005 + 0.001 max(z - 0.5, 0), z in metres; places move by N(0, 0.25 pixels).

    Source: BlenderProc, add_kinect_azure_noise (Denninger et al., "BlenderProc2", JOSS 2023).
    """

    name: ClassVar[str] = "azure"

    shift: float = SHIFT
    """Standard deviation in pixels of the place that a pixel reads; 0 leaves it out."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.shift <= 10:
            raise ValueError(f"sensor.shift: {self.shift} pixels; give 0 to 10, such as 0.25")

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`: 2 N normals across where pixels shift, then N along."""
        depth = displaced(view, self.shift, rng) if self.shift else view.depth_at
        sigma = CONSTANT + PER_METRE * np.maximum(view.distance_at - NEAR, 0)
        sigma = (self.noise * sigma).astype(np.float32)
        valid = depth > 0
        depth = depth + sigma * rng.standard_normal(len(sigma), dtype=np.float32)
        valid &= depth > 0
        depth[~valid] = 0
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))
