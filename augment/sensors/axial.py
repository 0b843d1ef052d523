"""Noise along a time-of-flight camera's axis, as it was measured for the Kinect v2."""

from __future__ import annotations

import math

import numpy as np

CONSTANT, LINEAR, QUADRATIC, SLANT = 1.5, -0.5, 0.3, 0.1
"""Of Fankhauser et al., "Kinect v2 for mobile robot navigation", ICAR 2015
(doi 10.1109/ICAR.2015.7251485): millimetres, distance in metres."""

STEEPEST = math.cos(1.5)
"""Cosine of the largest angle that counts, 1.5 radians as NormalGAN has it; the model has a pole
at pi/2."""


def axial_sigma(
    distance: np.ndarray, cosine: np.ndarray, right_angle: float = np.pi / 2
) -> np.ndarray:
    """Standard deviation of depth, metres, in the shape and type of the arguments.

    sigma[mm] = 1.5 - 0.5 z + 0.3 z^2 + 0.1 z^1.5 t^2 / (pi/2 - t)^2, z in metres, t in radians
    (Fankhauser et al. 2015), t at most 1.5.

    Args:
        distance: z, metres from the device along its axis.
        cosine: of t, the angle between the surface's normal and the ray back to the device.
        right_angle: what stands for pi/2.
    """
    slant = np.arccos(np.clip(cosine, STEEPEST, 1))
    ratio = slant / (right_angle - slant)
    upright = CONSTANT + distance * (LINEAR + QUADRATIC * distance)
    return (upright + SLANT * distance * np.sqrt(distance) * ratio * ratio) * 1e-3
