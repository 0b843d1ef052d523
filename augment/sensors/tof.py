"""A time-of-flight camera by its physics: phases of modulated light, summed over a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View, over_window

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
"""Under the first in any frequency, or the second in all together, a pixel is invalid. This rule
and those that follow are the device's, by libfreenect2's depth packet processor."""

CONFIDENCE, CONFIDENCE_EXPONENT = 12.887, -0.5330578
STRICTEST, LAXEST = 0.3490659, 0.6108653
"""A pixel is invalid whose three unwrapped phases lie farther, in radians, from those of any one
distance than the first times the largest amplitude to the power of the second, or than the limits
to that."""

FLYING_IR, FLYING_LEAST_IR = 0.05, 50.0
FLYING_NEAR, FLYING_FAR, FLYING_MOST = 0.050, 0.030, 0.100
"""A pixel flies where the amplitude in its 3x3 window varies by the first or more, relative to its
mean or, if that is more, to the second; and where its depth is metres more than the third from the
nearest measured there, than the fourth from the farthest, and than the fifth from either."""


@dataclass(frozen=True)
class TimeOfFlight(Sensor):
    """Light modulated at three frequencies, its phasors summed over the pixel, with noise.

    A surface at z returns A exp(i 4 pi f z / c), A proportional to albedo cos(t) / z^2. A pixel
    sums what its parts and its neighbours' near parts return, so it mixes depths at edges. Complex
    noise, the phases' unwrapping and the device's rules for valid pixels then make mixed pixels,
    lost hair and lost grazing surfaces by themselves. The device's bilateral filter is left out.

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
        phasors = self._phasors_of(view)
        clean = np.abs(phasors)
        count = len(view.depth_at)
        drawn = rng.standard_normal((2, 3, count), dtype=np.float32)
        phasors += np.complex64(self.noise * self.read_noise) * (drawn[0] + 1j * drawn[1])
        amplitude = np.abs(phasors)
        distance, missed = self._unwrapped(np.angle(phasors))
        distance += np.float32(self.offset) + np.float32(self.noise * self.jitter) * (
            rng.standard_normal(count, dtype=np.float32)
        )
        total = amplitude.sum(axis=0)
        valid = (amplitude.min(axis=0) >= LEAST_AMPLITUDE) & (total >= LEAST_SUM)
        valid &= missed <= _tolerated(amplitude.max(axis=0))
        if self.drop_flying:
            valid &= ~self._flying(view, distance, total, valid)
        valid &= (distance >= self.range[0]) & (distance <= self.range[1])
        depth = distance - np.float32(self.distance - view.grid.distance)
        depth[~valid] = 0
        # Of the weighted mean of three phases, each with an error of read noise over amplitude.
        phase = LIGHT_SPEED / (4 * np.pi * np.sqrt((FREQUENCIES**2).sum()))
        light = phase * self.read_noise / np.maximum(clean.mean(axis=0), 1e-6)
        sigma = (self.noise * np.sqrt(self.jitter**2 + light**2)).astype(np.float32)
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))

    def _phasors_of(self, view: View) -> np.ndarray:
        """(3, N) complex64: each frequency's phasor of every foreground pixel, in four parts."""
        z = view.distance_at
        quarter = np.float32(view.grid.pixel_size / 4)
        down, across = view.slope_at * quarter
        floor = np.float32(self.infrared_floor)
        bright = floor + (1 - floor) * view.luminance_at
        returned = np.float32(self.amplitude / 4) * bright
        returned = returned * np.maximum(view.cosine_at, 0) / (z * z)

        wall = self.amplitude / 4 * self.background_albedo / self.background**2
        # Over the four parts of a pixel: rows above and below, columns left and right.
        parts = np.empty((2, 2, 3, *view.inside.shape), dtype=np.complex64)
        behind = wall * np.exp(4j * np.pi * FREQUENCIES * self.background / LIGHT_SPEED)
        parts[:] = behind.astype(np.complex64)[:, None, None]
        for i, vertical in enumerate((-down, down)):
            for j, horizontal in enumerate((-across, across)):
                for k, phasor in enumerate(_phasors(z + vertical + horizontal)):
                    parts[i, j, k][view.inside] = returned * phasor
        return _gathered(parts, self.spread)[:, view.inside]

    def _unwrapped(self, phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) metres that (3, N) phases agree on, and (N,) radians by which they do not.

        Each frequency tells the next one its period.
        """
        turns = phases / np.float32(2 * np.pi)
        turns -= np.floor(turns)
        if self.wiggling:
            turns += (self.wiggling / PERIODS[:, None] * np.sin(8 * np.pi * turns)).astype(
                np.float32
            )
        known = [turns[0] * np.float32(PERIODS[0])]
        for turn, period in zip(turns[1:], PERIODS[1:], strict=True):
            whole = np.rint(known[-1] / np.float32(period) - turn)
            known.append((turn + whole) * np.float32(period))
        mean = np.zeros_like(known[0])
        for metres, weight in zip(known, WEIGHTS, strict=True):
            mean += metres * np.float32(weight)
        missed = np.zeros_like(mean)
        for metres, period in zip(known, PERIODS, strict=True):
            missed += np.square((metres - mean) * np.float32(2 * np.pi / period))
        return mean, np.sqrt(missed)

    def _flying(
        self, view: View, distance: np.ndarray, amplitude: np.ndarray, measured: np.ndarray
    ) -> np.ndarray:
        """(N,) bool: the device's edge filter, the wall where there is no foreground."""
        inside = view.inside
        wall = self.amplitude * self.background_albedo / self.background**2
        z = np.full(inside.shape, self.background, dtype=np.float32)
        ir = np.full(inside.shape, wall * len(MULTIPLES), dtype=np.float32)
        seen = np.full(inside.shape, wall >= LEAST_AMPLITUDE)
        z[inside], ir[inside], seen[inside] = distance, amplitude, measured
        nearer = z - over_window(np.where(seen, z, np.float32(np.inf)), np.minimum)
        farther = over_window(np.where(seen, z, np.float32(-np.inf)), np.maximum) - z
        mean = over_window(ir, np.add) / 9
        variance = np.maximum(over_window(ir * ir, np.add) / 9 - mean * mean, 0)
        flying: np.ndarray = variance >= (FLYING_IR * np.maximum(mean, FLYING_LEAST_IR)) ** 2
        flying &= (nearer > FLYING_NEAR) & (farther > FLYING_FAR)
        flying &= np.maximum(nearer, farther) > FLYING_MOST
        return flying[inside]


def _tolerated(amplitude: np.ndarray) -> np.ndarray:
    """Radians by which three phases may miss one distance, of the largest of their amplitudes."""
    most = CONFIDENCE * np.maximum(amplitude, np.float32(1)) ** CONFIDENCE_EXPONENT
    return np.clip(most, STRICTEST, LAXEST)


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
