"""A depth sensor of one's own: a stereo camera, whose noise grows with distance squared.

python pipeline.py build --config configs/open.yaml --sensor examples.new_sensor.Stereo \
    --sensor.baseline 0.12 --output out/stereo
RECTOVERSO_SENSORS=examples.new_sensor python pipeline.py report out/stereo
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors import SENSORS, Reading, Sensor
from augment.sensors.view import View


@dataclass(frozen=True)
class Stereo(Sensor):
    """Depth from disparity: z = f b / d, so that a disparity's noise s_d is a depth's
    s_z = z^2 s_d / (f b), and depth comes in steps of whole sub-pixels of disparity."""

    name: ClassVar[str] = "stereo"

    focal: float = 900.0
    """Of the device, in its pixels."""
    baseline: float = 0.05
    """Metres between its two cameras."""
    disparity_noise: float = 0.1
    """Standard deviation of a disparity, pixels."""
    steps: int = 16
    """Disparities that are told apart in a pixel."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.focal, self.baseline, self.steps) <= 0:
            raise ValueError("sensor.focal, baseline and steps: give numbers above 0")

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`: of the foreground's pixels alone, in row order."""
        reach = np.float32(self.focal * self.baseline)
        disparity = reach / view.distance_at
        spread = np.float32(self.noise * self.disparity_noise)
        disparity += spread * rng.standard_normal(len(disparity), dtype=np.float32)
        disparity = np.rint(disparity * self.steps) / np.float32(self.steps)
        valid = disparity > 0
        distance = reach / np.where(valid, disparity, 1)
        # From the device's distances back to the camera's plane.
        depth = distance + np.float32(view.grid.distance - self.distance)
        valid &= depth > 0
        depth[~valid] = 0
        sigma = (view.distance_at**2 * spread / reach).astype(np.float32)
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))


# By its name in a shard's meta it is found from here on.
SENSORS[Stereo.name] = Stereo
