"""Eyeballs by the texel."""

from __future__ import annotations

import numpy as np

from subjects.open.base.ramp import ramp
from subjects.open.base.template import template
from subjects.open.texture.brush import Clouds, mix, tinted
from subjects.open.texture.look import Look

PUPIL, IRIS = 11.0, 27.5
"""Degrees off the eye's axis at which they end."""


def paint_eye(look: Look, place: np.ndarray, joint: str, cloud: Clouds) -> np.ndarray:
    """(N, 3) of the eyeball around the template's `joint`."""
    forward = place - template().joints[joint]
    length = np.maximum(np.linalg.norm(forward, axis=1), 1e-9)
    off = np.degrees(np.arccos(np.clip(forward[:, 2] / length, -1, 1)))
    colour = np.empty((len(place), 3), dtype=np.float32)
    colour[:] = (0.90, 0.88, 0.86)
    # Redder towards the corners, with fine veins.
    around = np.arctan2(forward[:, 1], forward[:, 0])
    veins = ramp(np.abs(cloud(np.stack([around, off], axis=1), (0.06, 16.0))), 0.10, 0.0)
    tinted(colour, (0.82, 0.56, 0.52), 0.55 * ramp(off, 38, 85) + 0.22 * veins * ramp(off, 32, 50))
    rays = cloud(np.stack([around, off], axis=1), (0.10, 16.0))
    iris = np.array(look.eyes) * (1.0 + 0.30 * rays[:, None])
    iris = mix(iris, np.array(look.eyes) * [1.25, 1.05, 0.80], 0.55 * ramp(off, 18.0, 11.0))
    iris = iris * (1.0 - 0.60 * ramp(off, 22.5, IRIS)[:, None])
    colour = mix(colour, iris, ramp(off, IRIS + 1.0, IRIS - 1.0))
    return mix(colour, (0.025, 0.022, 0.022), ramp(off, PUPIL + 0.8, PUPIL - 0.8))
