"""Scenes of known depth, and every sensor again: slow, pixel by pixel, and obvious."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from augment.sensors import Grid, Sensor

GRID = Grid(pixel_size=0.005, distance=2.0)
LIGHT_SPEED = 299_792_458.0


class Scene:
    """Maps of one view.

    Args:
        depth: (H, W) metres; 0 is background.
        normal: (H, W, 3) unit where there is depth.
        albedo: (H, W) linear.
    """

    def __init__(self, depth: np.ndarray, normal: np.ndarray, albedo: np.ndarray) -> None:
        self.depth = depth.astype(np.float32)
        self.mask = self.depth > 0
        self.normal = np.where(self.mask[..., None], normal, 0).astype(np.float32)
        self.albedo = np.where(self.mask, albedo, 0).astype(np.float32)

    def part(self, rows: slice, columns: slice) -> Scene:
        """What is left of a scene that is cut, as the picture's new centre sees it."""
        return Scene(*(m[rows, columns] for m in (self.depth, self.normal, self.albedo)))

    def sense(self, sensor: Sensor, seed: int = 0) -> Any:
        rng = np.random.default_rng(seed)
        return sensor.sense(self.depth, self.normal, self.albedo, self.mask, GRID, rng)


def rays(shape: tuple[int, int], depth: np.ndarray) -> np.ndarray:
    """(H, W, 3) unit vectors from every point back to the device, which stands at the origin."""
    i, j = np.mgrid[: shape[0], : shape[1]]
    x = (j + 0.5 - shape[1] / 2) * GRID.pixel_size
    y = (shape[0] / 2 - 0.5 - i) * GRID.pixel_size
    back = np.stack([-x, -y, depth], axis=-1)
    return back / np.linalg.norm(back, axis=-1, keepdims=True)


@pytest.fixture
def plane() -> Callable[..., Scene]:
    """plane(z, angle_deg): a target that every ray meets at one angle, all at one depth."""

    def plane(
        z: float, angle_deg: float, *, parallel: bool = False, shape: tuple[int, int] = (250, 400)
    ) -> Scene:
        depth = np.full(shape, z)
        back = rays(shape, depth)
        if parallel:
            back = np.broadcast_to([0.0, 0.0, 1.0], back.shape)
        across = np.cross(back, [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        angle = math.radians(angle_deg)
        return Scene(depth, math.cos(angle) * back + math.sin(angle) * across, np.ones(shape))

    return plane


@pytest.fixture
def scene() -> Scene:
    """A ball before a slanted board, with a dark stripe: outline, depth step, grazing, dark."""
    shape = (36, 44)
    i, j = np.mgrid[: shape[0], : shape[1]]
    x, y = (j - 21.5) / 20, (17.5 - i) / 17
    ball = 0.5**2 - (x - 0.15) ** 2 - y**2
    board = (np.abs(x) < 0.8) & (np.abs(y) < 0.9)
    depth = np.where(board, 2.05 + 0.02 * x, 0.0)
    slope = 0.02 / (20 * GRID.pixel_size)  # of depth, per metre to the right
    normal = np.broadcast_to(
        np.array([slope, 0.0, 1.0]) / math.hypot(slope, 1.0), (*shape, 3)
    ).copy()
    on = ball > 0
    depth[on] = 1.9 - 0.1 * np.sqrt(ball[on])
    round_ = np.stack([x - 0.15, y, np.sqrt(np.maximum(ball, 0))], axis=-1)
    normal[on] = round_[on] / np.linalg.norm(round_[on], axis=-1, keepdims=True)
    normal[18, 5:9] = (1, 0, 0), (-0.6, 0.8, 0), (0, 1, 0), (0, -0.8, 0.6)  # edge-on, and steep
    albedo = np.where(j % 9 == 0, 0.004, 0.6)
    return Scene(depth, normal, albedo)


# --- the references: one pixel at a time, in row order, with the same draws ---


def pixels(scene: Scene) -> list[tuple[int, int]]:
    return [(int(i), int(j)) for i, j in np.argwhere(scene.mask)]


def cosine(scene: Scene, i: int, j: int) -> float:
    """Of the angle of incidence, the device at the origin."""
    height, width = scene.mask.shape
    x = (j + 0.5 - width / 2) * GRID.pixel_size
    y = (height / 2 - 0.5 - i) * GRID.pixel_size
    z = float(scene.depth[i, j])
    length = math.sqrt(x * x + y * y + z * z)
    nx, ny, nz = (float(n) for n in scene.normal[i, j])
    return (-nx * x - ny * y + nz * z) / length


def slope(scene: Scene, i: int, j: int) -> tuple[float, float]:
    """Change of depth per metre downwards and to the right, of a pixel's plane."""
    nx, ny, nz = (float(n) for n in scene.normal[i, j])
    nz = max(nz, 1e-3)
    return min(max(-ny / nz, -10.0), 10.0), min(max(nx / nz, -10.0), 10.0)


def displaced(scene: Scene, sigma: list[float], rng: np.random.Generator) -> list[float]:
    """Depth that each pixel reads beside itself, 0 where there is nothing."""
    places = pixels(scene)
    if not any(sigma):
        return [float(scene.depth[p]) for p in places]
    move = rng.standard_normal((2, len(places)), dtype=np.float32)
    read = []
    for k, (i, j) in enumerate(places):
        di = float(move[0, k] * np.float32(sigma[k]))
        dj = float(move[1, k] * np.float32(sigma[k]))
        ti, tj = i + round(di), j + round(dj)
        height, width = scene.mask.shape
        if not (0 <= ti < height and 0 <= tj < width and scene.mask[ti, tj]):
            read.append(0.0)
            continue
        down, right = slope(scene, ti, tj)
        beside = (di - round(di)) * down + (dj - round(dj)) * right
        read.append(float(scene.depth[ti, tj]) + beside * GRID.pixel_size)
    return read


def fankhauser(z: float, cos: float, right_angle: float) -> float:
    """Metres."""
    angle = min(math.acos(min(max(cos, -1.0), 1.0)), 1.5)
    slant = 0.1 * z**1.5 * angle**2 / (right_angle - angle) ** 2
    return (1.5 - 0.5 * z + 0.3 * z**2 + slant) / 1000


def by_normalgan(scene: Scene, sensor: Any, rng: np.random.Generator) -> dict:
    drawn = rng.standard_normal(len(pixels(scene)), dtype=np.float32)
    found = {}
    for k, (i, j) in enumerate(pixels(scene)):
        z = float(scene.depth[i, j])
        sigma = sensor.noise * fankhauser(z, float(scene.normal[i, j, 2]), 1.58)
        noisy = z + sigma * float(drawn[k])
        found[i, j] = (math.floor(noisy * 1000) / 1000 if sensor.truncate else noisy, sigma)
    if sensor.contour_jitter:
        contour = [
            (i, j)
            for i, j in pixels(scene)
            if not all(scene.mask[p] for p in cross(i, j) if p in window(scene, i, j))
        ]
        count = int(sensor.contour_jitter * len(contour))
        for k in rng.integers(0, len(contour), count)[::2]:
            for p in cross(*contour[k]):
                if p in found:
                    found[p] = (0.0, found[p][1])
    return found


def cross(i: int, j: int) -> list[tuple[int, int]]:
    return [(i, j), (i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)]


def by_kinect_v1(scene: Scene, sensor: Any, rng: np.random.Generator) -> dict:
    places = pixels(scene)
    ratios, across = [], []
    for i, j in places:
        angle = min(math.acos(min(max(cosine(scene, i, j), -1), 1)), math.radians(85))
        ratios.append(angle / (math.pi / 2 - angle))
        own = (0.8 + 0.035 * ratios[-1]) * float(scene.depth[i, j]) / 585
        across.append(sensor.lateral * own / GRID.pixel_size)
    read = displaced(scene, across, rng)
    drawn = rng.standard_normal(len(places), dtype=np.float32)
    found = {}
    for k, (i, j) in enumerate(places):
        z = float(scene.depth[i, j])
        sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2 + 0.0001 / math.sqrt(z) * ratios[k] ** 2
        sigma *= sensor.noise
        found[i, j] = (read[k] + sigma * float(drawn[k]) if read[k] else 0.0, sigma)
    return found


def window(scene: Scene, i: int, j: int) -> list[tuple[int, int]]:
    """A pixel and its eight neighbours, the picture's border repeated."""
    height, width = scene.mask.shape
    return [
        (min(max(a, 0), height - 1), min(max(b, 0), width - 1))
        for a in (i - 1, i, i + 1)
        for b in (j - 1, j, j + 1)
    ]


def by_azure(scene: Scene, sensor: Any, rng: np.random.Generator) -> dict:
    places = pixels(scene)
    height, width = scene.mask.shape
    move: Any = np.zeros((2, len(places)))
    if sensor.shift:
        move = rng.standard_normal(move.shape, dtype=np.float32)
    drawn = rng.standard_normal(len(places), dtype=np.float32)

    def true(i: int, j: int) -> float:
        return float(scene.depth[i, j]) if scene.mask[i, j] else sensor.background

    noisy, sigmas = {}, {}
    for k, (i, j) in enumerate(places):
        y = min(max(i + sensor.shift * float(move[0, k]), 0), height - 1)
        x = min(max(j + sensor.shift * float(move[1, k]), 0), width - 1)
        z = 0.0
        for a in (math.floor(y), math.floor(y) + 1):
            for b in (math.floor(x), math.floor(x) + 1):
                weight = max(1 - abs(y - a), 0) * max(1 - abs(x - b), 0)
                z += weight * true(a, b) if weight else 0
        sigmas[i, j] = sensor.noise * (0.0005 + 0.001 * max(z - 0.5, 0))
        noisy[i, j] = z + sigmas[i, j] * float(drawn[k])
    found = {}
    for i, j in places:
        seen = [noisy[p] if scene.mask[p] else sensor.background for p in window(scene, i, j)]
        good = grey(scene, i, j) >= sensor.dark
        good = good and (not sensor.step or max(seen) - min(seen) <= sensor.step)
        found[i, j] = (noisy[i, j] if good else 0.0, sigmas[i, j])
    return found


def grey(scene: Scene, i: int, j: int) -> int:
    """Of the sRGB byte."""
    linear = float(scene.albedo[i, j])
    coded = 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055
    return round(255 * coded)


def farthest(scene: Scene, i: int, j: int, background: float) -> float:
    """Of a pixel and its eight neighbours in the picture."""
    seen = window(scene, i, j)
    return max(float(scene.depth[p]) if scene.mask[p] else background for p in seen)


def by_kinect_v2(scene: Scene, sensor: Any, rng: np.random.Generator) -> dict:
    places = pixels(scene)
    read = displaced(scene, [sensor.lateral / GRID.pixel_size] * len(places), rng)
    drawn = rng.standard_normal(len(places), dtype=np.float32)
    sigmas = [
        sensor.noise * fankhauser(float(scene.depth[p]), cosine(scene, *p), math.pi / 2)
        for p in places
    ]
    depth = [z + s * float(d) for z, s, d in zip(read, sigmas, drawn, strict=True)]
    valid = [z > 0 for z in read]
    for k, p in enumerate(places):
        if not valid[k]:
            depth[k] = float(scene.depth[p]) + sigmas[k] * float(drawn[k])
    if sensor.mixed:
        far = [farthest(scene, *p, sensor.background) for p in places]
        edge = [k for k, p in enumerate(places) if far[k] - float(scene.depth[p]) > sensor.step]
        chance, share = rng.random((2, len(edge)), dtype=np.float32)
        for k, odds, part in zip(edge, chance, share, strict=True):
            if odds < np.float32(sensor.mixed):
                depth[k] += float(part) * (far[k] - depth[k])
                valid[k] = True
    begin, end = (math.cos(math.radians(a)) for a in sensor.graze_deg)
    kept = [1.0] * len(places)
    for k, p in enumerate(places):
        if sensor.graze_deg[0] < 90:
            kept[k] *= min(max((cosine(scene, *p) - end) / (begin - end), 0), 1)
        if sensor.dark:
            kept[k] *= min(float(scene.albedo[p]) / sensor.dark, 1)
    if sensor.graze_deg[0] < 90 or sensor.dark:
        loss = rng.random(len(places), dtype=np.float32)
        valid = [v and u >= 1 - odds for v, u, odds in zip(valid, loss, kept, strict=True)]
    found = {}
    for k, p in enumerate(places):
        good = valid[k] and sensor.range[0] <= depth[k] <= sensor.range[1]
        whole = round(depth[k] * 1000) / 1000 if sensor.millimetres else depth[k]
        found[p] = (whole if good else 0.0, sigmas[k])
    return found


def by_tof(scene: Scene, sensor: Any, rng: np.random.Generator) -> dict:
    places = pixels(scene)
    height, width = scene.mask.shape
    frequencies = (16e6, 80e6, 120e6)

    def part(i: int, j: int, a: int, b: int, f: float) -> complex:
        """What the part of a pixel in row a, column b of two by two returns."""
        if not (0 <= i < height and 0 <= j < width):
            return 0
        strength, z = sensor.background_albedo / sensor.background**2, sensor.background
        if scene.mask[i, j]:
            down, right = slope(scene, i, j)
            own = float(scene.depth[i, j])
            bright = sensor.infrared_floor + (1 - sensor.infrared_floor) * float(scene.albedo[i, j])
            strength = bright * max(cosine(scene, i, j), 0) / own**2
            z = own + ((a - 0.5) * down + (b - 0.5) * right) * GRID.pixel_size / 2
        return sensor.amplitude / 4 * strength * cmath.exp(4j * math.pi * f * z / LIGHT_SPEED)

    def summed(i: int, j: int, f: float) -> complex:
        """A pixel's four parts, and by their weight the parts that lie next to it."""
        total = 0j
        for a, (row, own_row, weight_row) in enumerate(
            [(i - 1, 1, sensor.spread), (i, 0, 1), (i, 1, 1), (i + 1, 0, sensor.spread)]
        ):
            del a
            for column, own_column, weight_column in [
                (j - 1, 1, sensor.spread), (j, 0, 1), (j, 1, 1), (j + 1, 0, sensor.spread)
            ]:  # fmt: skip
                total += weight_row * weight_column * part(row, column, own_row, own_column, f)
        return total / (1 + sensor.spread) ** 2

    noise = rng.standard_normal((2, 3, len(places)), dtype=np.float32)
    jitter = rng.standard_normal(len(places), dtype=np.float32)
    depths, strengths, measured, sigmas = {}, {}, {}, {}
    for k, p in enumerate(places):
        clean = [summed(*p, f) for f in frequencies]
        noisy = [
            value + sensor.noise * sensor.read_noise * complex(noise[0, n, k], noise[1, n, k])
            for n, value in enumerate(clean)
        ]
        known: list[float] = []
        for value, f in zip(noisy, frequencies, strict=True):
            period = LIGHT_SPEED / (2 * f)
            turn = cmath.phase(value) / (2 * math.pi) % 1.0
            own = turn * period + sensor.wiggling * math.sin(8 * math.pi * turn)
            known.append(own + round((known[-1] - own) / period) * period if known else own)
        weights = [f**2 / sum(g**2 for g in frequencies) for f in frequencies]
        mean = sum(w * z for w, z in zip(weights, known, strict=True))
        # The three phases' distance from the line on which all agree.
        missed = math.hypot(
            *(
                4 * math.pi * f / LIGHT_SPEED * (z - mean)
                for f, z in zip(frequencies, known, strict=True)
            )
        )
        each = [abs(value) for value in noisy]
        # As libfreenect2 writes it, natural logarithms and all.
        trust = math.exp((math.log(max(each)) * -0.5330578 * 0.301030 + 0.7694894) * 3.321928)
        trusted = missed <= min(max(trust, 0.3490659), 0.6108653)
        depths[p] = mean + sensor.offset + sensor.noise * sensor.jitter * float(jitter[k])
        strengths[p] = sum(each)
        measured[p] = min(each) >= 3 and sum(each) >= 10 and trusted
        light = LIGHT_SPEED / (4 * math.pi * math.sqrt(sum(g**2 for g in frequencies)))
        light *= sensor.read_noise / max(sum(abs(c) for c in clean) / 3, 1e-6)
        sigmas[p] = sensor.noise * math.hypot(sensor.jitter, light)

    wall = sensor.amplitude * sensor.background_albedo / sensor.background**2

    def flies(i: int, j: int) -> bool:
        seen = window(scene, i, j)
        light = [strengths.get(p, 3 * wall) for p in seen]
        mean = sum(light) / 9
        varied = math.sqrt(max(sum(v**2 for v in light) / 9 - mean**2, 0))
        near_by = [depths.get(p, sensor.background) for p in seen if measured.get(p, wall >= 3)]
        nearer = depths[i, j] - min(near_by)
        farther = max(near_by) - depths[i, j]
        uneven = varied / max(mean, 50) >= 0.05
        return uneven and nearer > 0.05 and farther > 0.03 and max(nearer, farther) > 0.1

    found = {}
    for p in places:
        good = measured[p] and not (sensor.drop_flying and flies(*p))
        good = good and sensor.range[0] <= depths[p] <= sensor.range[1]
        found[p] = (depths[p] if good else 0.0, sigmas[p])
    return found


REFERENCES: dict[str, Callable[[Scene, Any, np.random.Generator], dict]] = {
    "normalgan": by_normalgan,
    "kinect_v1": by_kinect_v1,
    "kinect_v2": by_kinect_v2,
    "azure": by_azure,
    "tof": by_tof,
}


@pytest.fixture
def reference() -> Callable[[str, Scene, Sensor, int], dict]:
    """reference(name, scene, sensor, seed): (i, j) -> (depth, sigma) of every pixel."""

    def reference(name: str, scene: Scene, sensor: Sensor, seed: int) -> dict:
        # From where the device stands, and back.
        offset = sensor.distance - GRID.distance
        moved = Scene(scene.depth + offset * scene.mask, scene.normal, scene.albedo)
        found = REFERENCES[name](moved, sensor, np.random.default_rng(seed))
        return {p: (z and z - offset, sigma) for p, (z, sigma) in found.items()}

    return reference
