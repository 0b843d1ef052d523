"""From linear radiance to the colours of an image: the lamp's power, exposure, sRGB."""

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


def expose(radiance: np.ndarray, mask: np.ndarray, light: LightConfig) -> np.ndarray:
    """sRGB bytes of a scene under `light`.

    Direct light is linear in the lamp's power, so one radiance per watt serves every power.

    Args:
        radiance: (..., 3) linear light per watt, Rec. 709 primaries.
        mask: (...) bool; colour is 0 outside it.

    Returns:
        (..., 3) uint8: round(255 srgb(radiance x power x exposure)), clipped.
    """
    image = np.zeros(radiance.shape, dtype=np.uint8)
    scale = np.float32(light.power * light.exposure)
    image[mask] = np.rint(255 * srgb(radiance[mask] * scale))
    return image


def srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light to sRGB in [0, 1], clipped (IEC 61966-2-1)."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
