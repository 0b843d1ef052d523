"""A smooth step: how far a value has come from one level to another."""

from __future__ import annotations

import numpy as np


def ramp(value: np.ndarray, start: float, end: float) -> np.ndarray:
    """Smooth 0 to 1 from `start` to `end`, which may be the lower: 3t² - 2t³ of the share t."""
    t = np.clip((value - start) / (end - start), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
