"""A time-of-flight camera by its physics: phases of modulated light, summed over a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View

LIGHT_SPEED = 299_792_458.0

BASE = 8e6
"""Hz: the largest frequency of which the device's three are multiples."""

MULTIPLES = (2, 10, 15)
"""16, 80 and 120 MHz over `BASE`: the Kinect v2's (OpenKinect, libfreenect2)."""

FREQUENCIES = BASE * np.array(MULTIPLES)

PERIODS = LIGHT_SPEED / (2 * FREQUENCIES)
"""Metres after which each frequency's phase comes again; all three agree after 18.75 m."""

WEIGHTS = FREQUENCIES**2 / (FREQUENCIES**2).sum()
"""Of the three distances in their mean: by the inverse of their variances."""

LEAST_AMPLITUDE, LEAST_SUM = 3.0, 10.0
"""Under the first in any frequency, or the second in all together, a pixel is invalid
(libfreenect2's depth packet processor)."""

FLYING_IR, FLYING_NEAR, FLYING_FAR = 0.05, 0.050, 0.030
"""A pixel flies where the amplitude in its 3x3 window varies by more than the first, relative to
its mean, and its depth is metres more than the second from the nearest there and than the third
from the farthest (libfreenect2's edge filter)."""

STEEPEST_SLOPE = 10.0
"""Depth per length across within a pixel; at the outline it would have no end."""


@dataclass(frozen=True)
class TimeOfFlight(Sensor):
    """Light modulated at three frequencies, its phasors summed over the pixel, with noise.

    A surface at z returns A exp(i 4 pi f z / c), A proportional to albedo cos(t) / z^2. A pixel
    sums what its parts and its neighbours' near parts return, so it mixes depths at edges. Complex
    noise, the phases' unwrapping and the device's rules for valid pixels then make mixed pixels,
    lost hair and lost grazing surfaces by themselves.

    With the default `read_noise`, `amplitude` and `jitter` the standard deviation on a white
    surface that faces the device is that of Fankhauser et al. 2015 within 5 % from 0.8 to 4 m.
    """

    name: ClassVar[str] = "tof"

    amplitude: float = 1000.0
    """What a white surface returns that faces the device at 1 m, in the device's numbers."""
    read_noise: float = 1.5607
    """Standard deviation of either part of each phasor, in the same numbers."""
    jitter: float = 0.001275
    """Metres: standard deviation of distance that does not depend on the light."""
    infrared_floor: float = 0.08
    """Infrared brightness of what is black to the eye: most dyes are not, so cloth that looks
    black returns some light (assumed; white is 1 in both)."""
    spread: float = 0.5
    """Weight of the neighbours' near parts in a pixel's sum: 0 is a pixel of its own."""
    background: float = 3.5
    """Metres from the device to the wall behind the person, which mixes with the outline."""
    background_albedo: float = 0.5
    """How bright that wall is; 0 is none."""
    wiggling: float = 0.0
    """Metres: error of each frequency's distance that goes round four times in its period."""
    offset: float = 0.0
    """Metres that the device reads too far."""
    drop_flying: bool = True
    """Drop flying pixels by the device's rule."""
    range: tuple[float, float] = (0.5, 4.5)
    """Metres from the device within which it measures."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checks = {
            "amplitude": self.amplitude > 0,
            "read_noise": self.read_noise >= 0,
            "jitter": self.jitter >= 0,
            "infrared_floor": 0 <= self.infrared_floor <= 1,
            "spread": 0 <= self.spread <= 1,
            "background": self.background > 0,
            "background_albedo": 0 <= self.background_albedo <= 1,
            "wiggling": abs(self.wiggling) < 1,
            "offset": abs(self.offset) < 1,
            "range": 0 <= self.range[0] < self.range[1],
        }
        for key, right in checks.items():
            if not right:
                raise ValueError(
                    f"sensor.{key}: {getattr(self, key)} is out of bounds; see its --help"
                )

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`: 6 N normals for the phasors, then N for the jitter."""
        phasors = _Pixels(self, view).sums()
        clean = np.abs(phasors)
        count = len(view.pixels)
        drawn = rng.standard_normal((2, 3, count), dtype=np.float32)
        phasors += np.complex64(self.noise * self.read_noise) * (drawn[0] + 1j * drawn[1])
        amplitude = np.abs(phasors)
        distance = self._unwrapped(np.angle(phasors))
        distance += np.float32(self.offset) + np.float32(self.noise * self.jitter) * (
            rng.standard_normal(count, dtype=np.float32)
        )
        valid = (amplitude.min(axis=0) >= LEAST_AMPLITUDE) & (amplitude.sum(axis=0) >= LEAST_SUM)
        valid &= (distance >= self.range[0]) & (distance <= self.range[1])
        if self.drop_flying:
            valid &= ~self._flying(view, distance, amplitude.sum(axis=0))
        depth = distance - np.float32(self.distance - view.grid.distance)
        depth[~valid] = 0
        # Of the weighted mean of three phases, each with an error of read noise over amplitude.
        phase = LIGHT_SPEED / (4 * np.pi * np.sqrt((FREQUENCIES**2).sum()))
        light = phase * self.read_noise / np.maximum(clean.mean(axis=0), 1e-6)
        sigma = (self.noise * np.sqrt(self.jitter**2 + light**2)).astype(np.float32)
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))

    def _unwrapped(self, phases: np.ndarray) -> np.ndarray:
        """(N,) metres from (3, N) phases: each frequency tells the next one its period."""
        turns = phases / np.float32(2 * np.pi)
        turns -= np.floor(turns)
        if self.wiggling:
            turns += (self.wiggling / PERIODS[:, None] * np.sin(8 * np.pi * turns)).astype(
                np.float32
            )
        known = turns[0] * np.float32(PERIODS[0])
        mean = known * np.float32(WEIGHTS[0])
        for turn, period, weight in zip(turns[1:], PERIODS[1:], WEIGHTS[1:], strict=True):
            whole = np.rint(known / np.float32(period) - turn)
            known = (turn + whole) * np.float32(period)
            mean += known * np.float32(weight)
        return mean

    def _flying(self, view: View, distance: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
        """(N,) bool: the device's edge filter, the wall where there is no foreground."""
        wall = self.amplitude * self.background_albedo / self.background**2 * len(MULTIPLES)
        rows = np.flatnonzero(view.mask.any(axis=1))
        if not len(rows):
            return np.zeros(0, dtype=bool)
        part = slice(max(rows[0] - 1, 0), rows[-1] + 2)
        mask = view.mask[part]
        z, ir = (np.full(mask.shape, value, dtype=np.float32) for value in (self.background, wall))
        z[mask], ir[mask] = distance, amplitude
        low, high = _window(z, np.minimum), _window(z, np.maximum)
        mean = _window(ir, np.add) / 9
        variance = np.maximum(_window(ir * ir, np.add) / 9 - mean * mean, 0)
        uneven = variance >= (FLYING_IR * mean) ** 2
        flying: np.ndarray = uneven & (z - low > FLYING_NEAR) & (high - z > FLYING_FAR)
        return flying[mask]


def _window(image: np.ndarray, join: np.ufunc) -> np.ndarray:
    """(H, W): `join` over every pixel's 3x3 window; the border repeats itself."""
    padded = np.pad(image, 1, mode="edge")
    rows = join(join(padded[:-2], padded[1:-1]), padded[2:])
    joined: np.ndarray = join(join(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return joined


class _Pixels:
    """What every pixel of the foreground's rectangle returns, in four parts."""

    def __init__(self, sensor: TimeOfFlight, view: View) -> None:
        self._sensor, self._view = sensor, view
        rows, columns = (np.flatnonzero(view.mask.any(axis=axis)) for axis in (1, 0))
        if len(rows):
            last = np.array(view.mask.shape)
            low = np.maximum([rows[0] - 1, columns[0] - 1], 0)
            high = np.minimum([rows[-1] + 2, columns[-1] + 2], last)
        else:
            low = high = np.zeros(2, dtype=int)
        self._part = (slice(low[0], high[0]), slice(low[1], high[1]))

    @cached_property
    def _inside(self) -> np.ndarray:
        return self._view.mask[self._part]

    def sums(self) -> np.ndarray:
        """(3, N) complex64: each frequency's phasor of every foreground pixel."""
        view, sensor = self._view, self._sensor
        z = view.distance_at
        if not len(z):
            return np.zeros((3, 0), dtype=np.complex64)
        nx, ny, nz = view.normal_at.T
        nz = np.maximum(nz, np.float32(1e-3))
        quarter = np.float32(view.grid.pixel_size / 4)
        across = np.clip(nx / nz, -STEEPEST_SLOPE, STEEPEST_SLOPE) * quarter
        down = np.clip(-ny / nz, -STEEPEST_SLOPE, STEEPEST_SLOPE) * quarter
        floor = np.float32(sensor.infrared_floor)
        bright = floor + (1 - floor) * view.luminance_at
        returned = np.float32(sensor.amplitude / 4) * bright
        returned = returned * np.maximum(view.cosine_at, 0) / (z * z)

        wall = sensor.amplitude / 4 * sensor.background_albedo / sensor.background**2
        # Over the four parts of a pixel: rows above and below, columns left and right.
        parts = np.empty((2, 2, 3, *self._inside.shape), dtype=np.complex64)
        behind = wall * np.exp(4j * np.pi * FREQUENCIES * sensor.background / LIGHT_SPEED)
        parts[:] = behind.astype(np.complex64)[:, None, None]
        for i, vertical in enumerate((-down, down)):
            for j, horizontal in enumerate((-across, across)):
                for k, phasor in enumerate(_phasors(z + vertical + horizontal)):
                    parts[i, j, k][self._inside] = returned * phasor
        return _gathered(parts, sensor.spread)[:, self._inside]


def _phasors(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """exp(i 4 pi f z / c) of the three frequencies: powers of that of `BASE`."""
    phase = np.float32(4 * np.pi * BASE / LIGHT_SPEED) * distance
    one = np.empty(len(distance), dtype=np.complex64)
    one.real, one.imag = np.cos(phase), np.sin(phase)
    two = one * one
    five = two * two * one
    ten = five * five
    return two, ten, ten * five


def _gathered(parts: np.ndarray, spread: float) -> np.ndarray:
    """(3, H, W) sums over a pixel's parts and, by `spread`, the parts that lie next to it.

    Args:
        parts: (2, 2, 3, H, W), the upper and lower, left and right parts of every pixel.
    """
    weight = np.complex64(1 / (1 + spread))

    def joined(first: np.ndarray, second: np.ndarray, axis: int) -> np.ndarray:
        """First and second parts along an axis, with the neighbours' second and first."""
        total = first + second
        if spread:
            here, there = [slice(None)] * 3, [slice(None)] * 3
            here[axis], there[axis] = slice(1, None), slice(None, -1)
            total[tuple(here)] += np.complex64(spread) * second[tuple(there)]
            total[tuple(there)] += np.complex64(spread) * first[tuple(here)]
            total *= weight
        return total

    upper, lower = (joined(row[0], row[1], axis=2) for row in parts)
    return joined(upper, lower, axis=1)
