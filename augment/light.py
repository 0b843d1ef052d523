"""The lamp: its power, its place, and how much of its light reaches the colour sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LightConfig:
    """The point light that goes with the camera, and how its light becomes an image."""

    power: float = 2000.0
    """Radiant power in watts."""
    position: tuple[float, float, float] = (0.3, 0.5, 0.0)
    """Place of the light in the frame of the camera that looks (x right, y up, z back), metres."""
    exposure: float = 0.06
    """Factor on linear radiance before the sRGB curve; 0.06 keeps white at 1.8 m under 2000 W."""

    def __post_init__(self) -> None:
        if not 0 < self.power < 1e9:
            raise ValueError(f"light.power: {self.power} W; give watts above 0, such as 2000")
        if not 0 < self.exposure < 1e9:
            raise ValueError(
                f"light.exposure: {self.exposure}; give a factor above 0, such as 0.06"
            )
        if not np.isfinite(self.position).all():
            raise ValueError(f"light.position: {self.position}; give three finite metres")


def expose(radiance: np.ndarray, light: LightConfig) -> np.ndarray:
    """Light on the colour sensor, 1 where it saturates: radiance x power x exposure.

    Direct light is linear in the lamp's power, so one radiance per watt serves every power.

    Args:
        radiance: (..., 3) float32 linear light per watt, Rec. 709 primaries.
    """
    exposed: np.ndarray = radiance * np.float32(light.power * light.exposure)
    return exposed
