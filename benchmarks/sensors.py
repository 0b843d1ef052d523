"""Milliseconds a depth sensor takes for one frame, beside plain NumPy over the whole frame.

    python -m benchmarks.sensors [--repeats 50]

The frame has 424 x 512 pixels, a fifth of them foreground, and the types that a shard holds. One
core, and generators that were seeded before. The plain versions are what one would write first:
every pixel, double precision, no reuse.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from augment.sensors import SENSORS, Grid, Sensor, sensor_of
from augment.sensors.tof import FREQUENCIES, LIGHT_SPEED, PERIODS, WEIGHTS, TimeOfFlight

ROWS, COLUMNS = 424, 512
GRID = Grid(pixel_size=0.005, distance=2.0)
AIMS_MS = {"normalgan": 1.0, "kinect_v2": 5.0, "tof": 40.0}


def frame() -> dict[str, np.ndarray]:
    """An upright ellipsoid of a fifth of the frame, 0.3 m deep, with stripes."""
    i, j = np.mgrid[:ROWS, :COLUMNS]
    y, x = (ROWS / 2 - 0.5 - i) / 200, (j + 0.5 - COLUMNS / 2) / 69
    inside = 1 - x**2 - y**2
    mask = inside > 0
    bulge = np.sqrt(np.maximum(inside, 0))
    normal = np.stack([x / 69, y / 200, bulge / 60], axis=-1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    color = np.where((i // 10 % 4 == 0)[..., None], (30, 30, 40), (180, 140, 120))
    return {
        "depth": np.where(mask, 2.0 - 0.3 * bulge, 0).astype(np.float32),
        "normal": np.where(mask[..., None], normal, 0).astype(np.float16),
        "albedo": np.where(mask[..., None], color, 0).astype(np.uint8),
        "mask": mask,
    }


def plain_axial(maps: dict[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise of distance and angle over every pixel."""
    depth = maps["depth"].astype(np.float64)
    angle = np.clip(np.arccos(np.clip(maps["normal"][..., 2].astype(np.float64), -1, 1)), 0, 1.5)
    sigma = 1.5 - 0.5 * depth + 0.3 * depth**2
    sigma = sigma + 0.1 * depth**1.5 * angle**2 / (1.58 - angle) ** 2
    noisy = depth + sigma / 1000 * rng.normal(0, 1, depth.shape)
    return np.where(maps["mask"], noisy, 0).astype(np.float32)


def plain_kinect_v2(maps: dict[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """The parts of `KinectV2` over every pixel."""
    depth, mask = maps["depth"].astype(np.float64), maps["mask"]
    normal = maps["normal"].astype(np.float64)
    i, j = np.mgrid[:ROWS, :COLUMNS]
    di, dj = rng.normal(0, 0.32, (2, ROWS, COLUMNS))
    ti = np.clip(np.rint(i + di).astype(int), 0, ROWS - 1)
    tj = np.clip(np.rint(j + dj).astype(int), 0, COLUMNS - 1)
    slope = np.clip(normal[ti, tj, :2] / np.maximum(normal[ti, tj, 2:], 1e-3), -10, 10)
    part = (dj - np.rint(dj)) * slope[..., 0] - (di - np.rint(di)) * slope[..., 1]
    moved = depth[ti, tj] + part * GRID.pixel_size
    read = mask[ti, tj]
    x = (j + 0.5 - COLUMNS / 2) * GRID.pixel_size
    y = (ROWS / 2 - 0.5 - i) * GRID.pixel_size
    length = np.sqrt(x**2 + y**2 + depth**2)
    cosine = (normal[..., 2] * depth - normal[..., 0] * x - normal[..., 1] * y) / length
    angle = np.clip(np.arccos(np.clip(cosine, -1, 1)), 0, 1.5)
    sigma = 1.5 - 0.5 * depth + 0.3 * depth**2
    sigma = sigma + 0.1 * depth**1.5 * angle**2 / (np.pi / 2 - angle) ** 2
    noisy = moved + sigma / 1000 * rng.normal(0, 1, depth.shape)
    behind = np.where(mask, depth, 3.5)
    far = np.max([np.roll(behind, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1)], axis=0)
    chance, share = rng.random((2, ROWS, COLUMNS))
    mixed = (far - depth > 0.05) & (chance < 0.3)
    noisy = np.where(mixed, noisy + share * (far - noisy), noisy)
    coded = maps["albedo"] / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    bright = linear @ [0.2126, 0.7152, 0.0722]
    begin, end = np.cos(np.radians([70, 88]))
    kept = np.clip((cosine - end) / (begin - end), 0, 1) * np.clip(bright / 0.02, 0, 1)
    valid = mask & (read | mixed) & (rng.random(depth.shape) < kept)
    valid &= (noisy > 0.5) & (noisy < 4.5)
    return np.where(valid, np.rint(noisy * 1000) / 1000, 0).astype(np.float32)


def plain_tof(maps: dict[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Phasors of a frame of twice the pixels each way, summed over windows, unwrapped."""
    sensor = TimeOfFlight()
    mask = maps["mask"].repeat(2, 0).repeat(2, 1)
    normal = maps["normal"].astype(np.float64)
    slope = np.clip(normal[..., :2] / np.maximum(normal[..., 2:], 1e-3), -10, 10)
    slope = slope.repeat(2, 0).repeat(2, 1) * GRID.pixel_size / 4
    down, right = np.where(np.mgrid[: 2 * ROWS, : 2 * COLUMNS] % 2, 1, -1)
    depth = maps["depth"].astype(np.float64).repeat(2, 0).repeat(2, 1)
    near = depth + right * slope[..., 0] - down * slope[..., 1]
    z = np.where(mask, near, sensor.background)
    coded = maps["albedo"] / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    bright = 0.08 + 0.92 * (linear @ [0.2126, 0.7152, 0.0722])
    bright = (bright * normal[..., 2]).repeat(2, 0).repeat(2, 1)
    strength = sensor.amplitude / 4 * np.where(mask, bright, sensor.background_albedo) / z**2
    sums = []
    for frequency in FREQUENCIES:
        fine = strength * np.exp(4j * np.pi * frequency * z / LIGHT_SPEED)
        padded = np.pad(fine, 1, mode="edge")
        rows = padded[1:-1:2] + padded[2::2] + 0.5 * (padded[:-2:2] + padded[3::2])
        both = rows[:, 1:-1:2] + rows[:, 2::2] + 0.5 * (rows[:, :-2:2] + rows[:, 3::2])
        noise = rng.normal(0, sensor.read_noise, (2, ROWS, COLUMNS))
        sums.append(both / 2.25 + noise[0] + 1j * noise[1])
    known = mean = np.zeros((ROWS, COLUMNS))
    for value, period, weight in zip(sums, PERIODS, WEIGHTS, strict=True):
        own = np.angle(value) / (2 * np.pi) % 1 * period
        known = own + np.rint((known - own) / period) * period if mean.any() else own
        mean = mean + weight * known
    amplitude = np.abs(sums)
    distance = mean + rng.normal(0, sensor.jitter, mean.shape)
    valid = maps["mask"] & (amplitude.min(0) >= 3) & (amplitude.sum(0) >= 10)
    return np.where(valid & (distance > 0.5) & (distance < 4.5), distance, 0).astype(np.float32)


PLAIN: dict[str, Callable[[dict[str, np.ndarray], np.random.Generator], np.ndarray]] = {
    "normalgan": plain_axial,
    "kinect_v2": plain_kinect_v2,
    "tof": plain_tof,
}


def milliseconds(work: Callable[[np.random.Generator], object]) -> float:
    rng = np.random.default_rng(0)
    start = time.perf_counter()
    work(rng)
    return 1000 * (time.perf_counter() - start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=50)
    repeats = parser.parse_args().repeats
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    maps = frame()
    print(f"{maps['mask'].mean():.1%} of {ROWS} x {COLUMNS} pixels are foreground; best and median")

    def ours(sensor: Sensor, rng: np.random.Generator) -> object:
        return sensor.sense(**maps, grid=GRID, rng=rng)

    for name in SENSORS:
        sensor = sensor_of(name)
        runs: dict[str, list[float]] = {"ours": [], "plain": []}
        for _ in range(repeats):  # in turn, as a machine's speed changes
            runs["ours"].append(milliseconds(partial(ours, sensor)))
            if name in PLAIN:
                runs["plain"].append(milliseconds(partial(PLAIN[name], maps)))
        line = f"{name:10}{min(runs['ours']):7.2f}{np.median(runs['ours']):7.2f} ms"
        if name in AIMS_MS:
            line += f"  (aim {AIMS_MS[name]:g})"
        if runs["plain"]:
            ratio = np.median(runs["plain"]) / np.median(runs["ours"])
            line += f"   plain {min(runs['plain']):7.2f}{np.median(runs['plain']):8.2f} ms"
            line += f"   {ratio:.1f} times as fast"
        print(line)


if __name__ == "__main__":
    main()
