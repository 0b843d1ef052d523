"""What each depth sensor does: its noise beside its formula, and one view as it reads it.

    python -m report.sensors DIR --output docs/sensors.png

DIR is a dataset; one of its subjects is read. The dots are measured by reading planes that stand
at a distance and at an angle; the lines are the formulas of the papers that the models come from.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from augment.sensors import SENSORS, Grid, Sensor, sensor_of
from report import command
from report.view import chosen
from shards.dataset import Dataset

GRID = Grid(pixel_size=0.005, distance=2.0)
DISTANCES = np.array([0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0])
ANGLES = np.array([0, 15, 30, 45, 60, 70, 75, 80])
TICKS = (2, 3, 5, 10, 20)
SIDE = 120
"""Pixels of a measured plane's side."""

GAUSSIAN_PART: dict[str, dict[str, Any]] = {
    "kinect_v2": {"lateral": 0.0, "mixed": 0.0, "millimetres": False, "graze_deg": (90.0, 90.0)},
    "kinect_v1": {"lateral": 0.0},
    "azure": {"shift": 0.0},
    "tof": {"spread": 0.0, "drop_flying": False},
}
"""What is switched off so that the noise along the axis is measured alone."""


def published(name: str, z: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Standard deviation in millimetres by the formula of a model's paper; of `tof` the Kinect's.

    Args:
        z: metres.
        angle: of incidence, radians.
    """
    right = 1.58 if name == "normalgan" else math.pi / 2
    ratio = (angle / (right - angle)) ** 2
    if name == "kinect_v1":
        return 1.2 + 1.9 * (z - 0.4) ** 2 + 0.1 / np.sqrt(z) * ratio
    if name == "azure":
        return 0.5 + np.maximum(z - 0.5, 0) + 0 * angle
    return 1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * ratio


def measured(sensor: Sensor, z: float, angle: float) -> float:
    """Standard deviation in millimetres of a white plane's depth, as the sensor reads it.

    Args:
        z: metres.
        angle: at which every ray meets the plane, radians.
    """
    i, j = np.mgrid[:SIDE, :SIDE]
    back = np.stack(
        [
            (SIDE / 2 - 0.5 - j) * GRID.pixel_size,
            (i + 0.5 - SIDE / 2) * GRID.pixel_size,
            np.full((SIDE, SIDE), z),
        ],
        axis=-1,
    )
    if sensor.name == "normalgan":  # its rays are parallel
        back[..., :2] = 0
    back /= np.linalg.norm(back, axis=-1, keepdims=True)
    across = np.cross(back, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    depth = np.full((SIDE, SIDE), z, dtype=np.float32)
    reading = sensor.sense(
        depth,
        math.cos(angle) * back + math.sin(angle) * across,
        np.ones((SIDE, SIDE), dtype=np.float32),
        depth > 0,
        GRID,
        np.random.default_rng(0),
    )
    error = (reading.depth.astype(np.float64) - depth)[reading.valid]
    return 1000 * float(error.std()) if len(error) > SIDE else math.nan


def figure(folder: Path, subject: str | None, view: int | None) -> Figure:
    """Two charts of noise over a strip of one subject: depth and normals, true and as read.

    Raises:
        ValueError: there is no such subject or view.
    """
    dataset = Dataset(folder)
    names = dataset.subjects()
    if not names:
        raise ValueError(f"{folder} holds no finished subject; build it first")
    shard = dataset.shard(subject or names[0])
    maps = shard.view(chosen(shard, view), ["depth_front", "normal_front", "rgb_front", "mask"])
    camera = shard.meta["camera"]
    mpl.rcParams["font.size"] = 8
    whole = Figure(figsize=(12, 11.6), dpi=130, layout="constrained")
    parts = whole.subfigures(2, 1, height_ratios=(1, 2.2), squeeze=False)
    charts, strip = parts.ravel()
    by_distance, by_angle = charts.subplots(1, 2)
    _curves(by_distance, DISTANCES, lambda x: (x, 0 * x))
    by_distance.set(xlabel="distance, m (facing the device)", ylabel="standard deviation, mm")
    by_distance.legend(title="line: published, dot: measured", frameon=False)
    _curves(by_angle, ANGLES, lambda x: (0 * x + 2.0, np.radians(x)))
    by_angle.set(xlabel="angle of incidence, degrees (at 2 m)", yscale="log")
    by_angle.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    by_angle.minorticks_off()
    axes = strip.subplots(2, len(SENSORS) + 1)
    grid = Grid(camera["pixel_size"], camera["distance"])
    rows, columns = (np.flatnonzero(maps["mask"].any(axis=axis)) for axis in (1, 0))
    part = (slice(rows[0] - 4, rows[-1] + 5), slice(columns[0] - 4, columns[-1] + 5))
    depths = {"true": maps["depth_front"]}
    for name in SENSORS:
        reading = sensor_of(name).sense(
            maps["depth_front"],
            maps["normal_front"],
            maps["rgb_front"],
            maps["mask"],
            grid,
            np.random.default_rng(0),
        )
        depths[name] = reading.depth
    true = maps["depth_front"]
    for (above, below), (name, depth) in zip(axes.T, depths.items(), strict=True):
        read = maps["mask"] & (depth > 0)
        off = 1000 * np.abs(depth - true)[read]
        above.imshow(greys(depth, true[maps["mask"]])[part], "gray", vmin=0, vmax=255)
        below.imshow(normals(depth, grid.pixel_size)[part], interpolation="nearest")
        figures = "" if name == "true" else f"\n{np.median(off):.1f} mm off, median"
        above.set_title(f"{name}\n{read.sum() / maps['mask'].sum():.0%} valid{figures}")
        for axis in (above, below):
            axis.set_axis_off()
    return whole


def greys(depth: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(H, W) uint8 of a depth map, near is bright, white where there is no depth.

    Args:
        depth: (H, W) metres, 0 = none.
        shown: depths whose span the greys cover.
    """
    near, far = shown.min(), shown.max()
    bright = 220 - 190 * np.clip((depth - near) / max(far - near, 1e-6), 0, 1)
    return np.where(depth > 0, bright, 255).astype(np.uint8)


def normals(depth: np.ndarray, pixel_size: float) -> np.ndarray:
    """(H, W, 3) uint8 colours of a depth map's normals, white where there is no depth.

    Args:
        depth: (H, W) metres, 0 = none.
        pixel_size: metres.
    """
    down, right = np.gradient(depth.astype(np.float64), pixel_size)
    normal = np.stack([right, -down, np.ones_like(right)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    colours: np.ndarray = np.where((depth > 0)[..., None], 127.5 * (normal + 1), 255)
    return colours.astype(np.uint8)


def _curves(
    axes: Axes, at: np.ndarray, scene: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
) -> None:
    """Every sensor's published line and measured dots over `at`; `scene` gives z and angle."""
    fine = np.linspace(at[0], at[-1], 200)
    for k, name in enumerate(SENSORS):
        sensor = sensor_of(name, **GAUSSIAN_PART.get(name, {}))
        found = [
            measured(sensor, z, angle) for z, angle in zip(*scene(at.astype(float)), strict=True)
        ]
        if name != "tof":
            axes.plot(fine, published(name, *scene(fine)), color=f"C{k}", linewidth=1)
        axes.plot(at, found, ".", color=f"C{k}", label=name)
    axes.spines[["top", "right"]].set_visible(False)


def main() -> int:
    """Draw the figure; 2 where the call or the dataset is wrong."""
    options = command.parser(__doc__)
    options.add_argument("--output", type=Path, required=True, help="PNG to write")
    options.add_argument("--subject", help="whom to show (default: the first)")
    options.add_argument("--view", type=int, help="which view (default: the one turned least)")
    given = options.parse_args()

    def draw(output: Path) -> None:
        figure(given.data, given.subject, given.view).savefig(output)

    return command.write(draw, given.output)


if __name__ == "__main__":
    raise SystemExit(main())
