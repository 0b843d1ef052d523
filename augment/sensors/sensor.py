"""What every depth sensor offers: a true view in, a reading out."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any, ClassVar

import numpy as np

from augment.sensors.view import Grid, Reading, View


@dataclass(frozen=True)
class Sensor(ABC):
    """A depth sensor. A sensor is its own parameters (a frozen dataclass).

    Attributes:
        name: of the model, as `meta` has it.
    """

    name: ClassVar[str]

    distance: float = 2.0
    """Metres from the device to the subject's axis: orthographic maps have none of their own."""
    noise: float = 1.0
    """Factor on the published standard deviation; 0 leaves the Gaussian part out."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not _alike(value, field.default):
                raise ValueError(f"sensor.{field.name}: {value!r}; give such as {field.default}")
        if not 0 < self.distance < 100:
            raise ValueError(
                f"sensor.distance: {self.distance} m; give metres above 0, such as 2.0"
            )
        if not 0 <= self.noise <= 100:
            raise ValueError(f"sensor.noise: {self.noise}; give a factor from 0 to 100, such as 1")

    def sense(
        self,
        depth: np.ndarray,
        normal: np.ndarray,
        albedo: np.ndarray,
        mask: np.ndarray,
        grid: Grid,
        rng: np.random.Generator,
    ) -> Reading:
        """Measure the foreground; the background stays 0 to the bit.

        Args:
            depth: (H, W) float32 metres from the camera's plane, 0 = no surface.
            normal: (H, W, 3) unit, camera frame (z towards the viewer).
            albedo: (H, W) or (H, W, 3) in [0, 1], linear, or uint8 sRGB.
            mask: (H, W) bool.
            grid: of the maps.
            rng: the only source of chance: the same one gives the same reading.

        Raises:
            ValueError: shapes disagree, depth is negative or not finite, a normal is not unit,
                albedo lies beyond [0, 1], or the device does not stand before the surface.
        """
        return self.measure(View(depth, normal, albedo, mask, grid, self.distance), rng)

    @abstractmethod
    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """The reading of a view that was checked."""


def _alike(value: Any, default: Any) -> bool:
    """Whether a parameter is what its default is: true or false, a finite number, two of them."""
    if isinstance(default, bool):
        return isinstance(value, bool)
    if isinstance(default, tuple):
        same = isinstance(value, tuple | list) and len(value) == len(default)
        return same and all(map(_alike, value, default))
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
