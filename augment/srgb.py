"""The sRGB curve (IEC 61966-2-1) and its inverse, in the type of float that is given."""

from __future__ import annotations

import numpy as np


def srgb(light: np.ndarray) -> np.ndarray:
    """Linear light to sRGB in [0, 1], clipped."""
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def linear(coded: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] to linear light."""
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
