"""Depth as a sensor measures it: noise whose spread grows with distance and slant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

MODEL = "normalgan"
"""The model's name in a shard: axial Gaussian noise of distance and angle, as NormalGAN's."""


@dataclass(frozen=True)
class SensorConfig:
    """How noisy the depth sensor is that looks at the front."""

    noise: float = 1.0
    """Factor on the published standard deviation; 0 gives the true depth."""

    def __post_init__(self) -> None:
        if not 0 <= self.noise <= 100:
            raise ValueError(f"sensor.noise: {self.noise}; give a factor from 0 to 100, such as 1")


class Reading(NamedTuple):
    """What a sensor saw.

    depth: (H, W) float32 metres, 0 where invalid. valid: (H, W) bool. sigma: (H, W) float32,
    the noise's standard deviation in metres, 0 where there is no surface.
    """

    depth: np.ndarray
    valid: np.ndarray
    sigma: np.ndarray


# Coefficients of the axial model in millimetres, distance in metres: Fankhauser et al., "Kinect
# v2 for mobile robot navigation", ICAR 2015 (doi 10.1109/ICAR.2015.7251485).
_CONSTANT, _LINEAR, _QUADRATIC, _SLANT = 1.5, -0.5, 0.3, 0.1
# NormalGAN's constants: its right angle, which keeps the slant term finite, and its steepest angle.
_RIGHT_ANGLE = 1.58
_STEEPEST = 1.5


def axial_sigma(distance: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Standard deviation of depth noise, metres, in the shape of the arguments.

    sigma[mm] = 1.5 - 0.5 z + 0.3 z^2 + 0.1 z^1.5 t^2 / (pi/2 - t)^2, z in metres, t in radians
    (Fankhauser et al. 2015), with 1.58 for pi/2 and t at most 1.5, as NormalGAN applies it.

    Args:
        distance: z, metres along the viewing ray.
        cosine: of t, the angle between the surface's normal and the ray back to the sensor.
    """
    slant = np.minimum(np.arccos(np.clip(cosine, -1.0, 1.0)), _STEEPEST)
    ratio = slant / (_RIGHT_ANGLE - slant)
    upright = _CONSTANT + distance * (_LINEAR + _QUADRATIC * distance)
    return (upright + _SLANT * distance * np.sqrt(distance) * ratio * ratio) * 1e-3


def sense(
    depth: np.ndarray,
    normal: np.ndarray,
    mask: np.ndarray,
    config: SensorConfig,
    rng: np.random.Generator,
) -> Reading:
    """Perturb the depth of the foreground; the background stays 0 to the bit.

    Orthographic rays are parallel to the camera's z, so the angle of incidence is the normal's
    with that axis, and the sensor stands in the camera plane.

    Args:
        depth: (H, W) metres, 0 = no surface.
        normal: (H, W, 3) unit, camera frame (z towards the viewer).
        mask: (H, W) bool.
        rng: draws one standard normal per foreground pixel, in row order.

    Raises:
        ValueError: shapes disagree, depth is negative or not finite, or a normal is not unit.
    """
    _check(depth, normal, mask)
    distance = depth[mask].astype(np.float64)
    sigma = config.noise * axial_sigma(distance, normal[mask][:, 2].astype(np.float64))
    noisy = distance + sigma * rng.standard_normal(len(distance))

    reading = Reading(
        depth=np.zeros(depth.shape, dtype=np.float32),
        valid=mask.copy(),
        sigma=np.zeros(depth.shape, dtype=np.float32),
    )
    reading.depth[mask] = noisy
    reading.sigma[mask] = sigma
    reading.valid[mask] = noisy > 0
    reading.depth[~reading.valid] = 0
    return reading


def _check(depth: np.ndarray, normal: np.ndarray, mask: np.ndarray) -> None:
    if depth.ndim != 2 or mask.shape != depth.shape or normal.shape != (*depth.shape, 3):
        raise ValueError(
            f"shapes disagree: depth {depth.shape}, normal {normal.shape}, mask {mask.shape}; "
            "give (H, W), (H, W, 3) and (H, W)"
        )
    foreground = depth[mask]
    if not np.isfinite(depth).all() or (depth < 0).any() or (foreground == 0).any():
        raise ValueError("depth holds NaN, infinite or negative values, or 0 inside the mask")
    squared = np.square(normal[mask], dtype=np.float64).sum(axis=-1)
    # Half-precision normals are unit to 1e-3.
    if len(squared) and not np.abs(squared - 1).max() < 4e-3:
        raise ValueError("a normal inside the mask is not unit; normalise the normal map")
