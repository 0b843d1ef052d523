"""How paint is put on: mixing, soft edges, lines, stitches, and clouds of noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from subjects.open.base.ramp import ramp
from subjects.open.texture.palette import Colour


class Clouds:
    """Smooth random values in [-1, 1] over space, and grain that differs in every texel."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._lattice = generator.uniform(-1, 1, (32, 32, 32)).astype(np.float32)
        self._generator = generator

    def __call__(self, place: np.ndarray, size: float | tuple[float, ...]) -> np.ndarray:
        """(N,) values at (N, D <= 3) places; `size` is the clouds' size in the places' unit."""
        at = np.zeros((3, len(place)), dtype=np.float32)
        at[: place.shape[1]] = (place / np.asarray(size, dtype=np.float32)).T
        # Off the lattice's planes, so that flat places do not repeat every 32 clouds in step.
        at[2] += 0.37 * at[0] / 32 + 0.61 * at[1] / 32
        return map_coordinates(self._lattice, at % 32, np.float32, order=1, mode="grid-wrap")

    def grain(self, count: int) -> np.ndarray:
        """(N,) independent normal values."""
        return self._generator.standard_normal(count, dtype=np.float32)


def mix(a: np.ndarray, b: np.ndarray | Colour, share: np.ndarray) -> np.ndarray:
    """(N, 3): `a` where share (N,) is 0, `b` where it is 1."""
    clipped = np.clip(share, 0.0, 1.0).astype(np.float32)[:, None]
    return a + clipped * (np.asarray(b, dtype=np.float32) - a)


def tinted(colour: np.ndarray, b: np.ndarray | Colour, share: np.ndarray) -> None:
    """`mix` in place, only where the share is above zero: most marks are thin."""
    some = np.flatnonzero(share > 0.004)
    target = np.asarray(b, dtype=np.float32)
    colour[some] = mix(colour[some], target[some] if target.ndim == 2 else target, share[some])


def line(distance: np.ndarray, width: float = 0.0016) -> np.ndarray:
    """1 on a seam, 0 beside it."""
    return ramp(np.abs(distance), width * 1.5, width * 0.5)


def stitched(distance: np.ndarray, along: np.ndarray, pitch: float = 0.0075) -> np.ndarray:
    """A seam's thread: stitches of two thirds of `pitch` metres `along` the line."""
    thread = np.abs(along / pitch % 1.0 - 0.5)
    return line(distance, 0.0013) * (0.35 + 0.65 * ramp(thread, 0.40, 0.30))


def felled(distance: np.ndarray, along: np.ndarray, apart: float = 0.006) -> np.ndarray:
    """The two rows of thread that hold a flat felled seam or a hem."""
    return np.maximum(stitched(distance, along), stitched(distance - apart, along))


def box(
    x: np.ndarray, y: np.ndarray, centre: tuple[float, float], half: tuple[float, float]
) -> np.ndarray:
    """Signed distance to a rectangle's edge, negative inside."""
    return np.maximum(np.abs(x - centre[0]) - half[0], np.abs(y - centre[1]) - half[1])
