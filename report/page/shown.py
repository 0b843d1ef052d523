"""What a page shows of one subject: pictures, depth to turn about, and what its maps measure."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from augment import sensors
from report.maps import TITLES, pictured
from report.view import chosen
from shards.archive import Shard
from shards.dataset import Dataset

SAMPLED = 4
"""Views of each subject whose depths are measured, spread over all; the first is the one shown."""

DEPTH_MM, THICKNESS_MM, RESIDUAL = 10, 5, 0.1
"""Widths of the histograms' bins: millimetres, and standard deviations of the sensor's noise."""

_MOST_DEPTH, _MOST_THICKNESS, _MOST_RESIDUAL = 8000, 1500, 6.0
"""What goes into the last bin, in the same units."""


@dataclass(frozen=True)
class Fineness:
    """How much of a subject goes into a page.

    Attributes:
        scale: of its pictures, in pixels of the page a pixel of the maps.
        step: pixels of the maps between two vertices of what can be turned.
        quality: of its pictures, of 100.
    """

    scale: float
    step: int
    quality: int

    @classmethod
    def of(cls, subjects: int) -> Fineness:
        """For so many on one page, which stays below 40 MB for a hundred and usable for more."""
        if subjects <= 150:
            return cls(1.0, 2, 80)
        return cls(0.5, 4, 70) if subjects <= 500 else cls(0.35, 6, 60)


def shown(folder: Path, subject: str, view: int | None, fineness: Fineness) -> dict[str, Any]:
    """A subject as the page's script takes it, JSON-ready.

    Args:
        folder: of the dataset.
        view: which; None for the one turned least.

    Returns:
        `pictures`: name of a map -> data URL; `solid`: depths on a coarser grid; `view`, `yaw_deg`;
        `height_m` of the silhouette; `size`: rows and columns of the pictures' box; `counts`: of
        the histograms; `source`, `licence`, `sensor`.
    """
    dataset = Dataset(folder)
    shard = dataset.shard(subject)
    index = chosen(shard, view)
    names = [name for name in TITLES if name in shard.names]
    maps = shard.view(index, ["mask", *names])
    pixel_size = float(shard.meta["camera"]["pixel_size"])
    box = box_of(maps)
    rows = np.flatnonzero(maps["mask"].any(axis=1))
    return {
        "view": index,
        "yaw_deg": round(float(shard["yaw_deg"][index]), 2),
        "height_m": round(float(rows[-1] + 1 - rows[0]) * pixel_size, 3),
        "size": [side.stop - side.start for side in box],
        "pictures": {
            name: picture(pictured(maps, name, pixel_size)[box], fineness)
            for name in (*names, "thickness")
            if name == "thickness" or maps[name].any()  # a scan may have no body
        },
        "solid": _solid(maps, box, pixel_size, fineness.step),
        "counts": counts(shard, index),
        "source": shard.meta["source"],
        "licence": shard.meta["licence"],
        "sensor": shard.meta["sensor"]["model"],
    }


def box_of(maps: dict[str, np.ndarray]) -> tuple[slice, slice]:
    """Rows and columns that hold the subject, and its body, which may leave the silhouette."""
    seen = maps["mask"] | (maps["body_depth_back"] > 0)
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    return (
        slice(int(rows[0]), int(rows[-1]) + 1),
        slice(int(columns[0]), int(columns[-1]) + 1),
    )


def picture(image: np.ndarray, fineness: Fineness) -> str:
    """A data URL of WebP."""
    drawn = Image.fromarray(image)
    if fineness.scale != 1:
        size = [max(1, round(side * fineness.scale)) for side in drawn.size]
        drawn = drawn.resize((size[0], size[1]), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    drawn.save(file, "WEBP", quality=fineness.quality, method=2)
    return f"data:image/webp;base64,{base64.b64encode(file.getvalue()).decode()}"


def _solid(
    maps: dict[str, np.ndarray], box: tuple[slice, slice], pixel_size: float, step: int
) -> dict[str, Any]:
    """Depths of every `step`-th pixel of the box: 16-bit tenths of a millimetre behind `near`."""
    depths = {
        name: maps[member][box][::step, ::step]
        for name, member in {
            "front": "depth_front",
            "back": "depth_back",
            "sensor": "depth_sensor",
            "body_front": "body_depth_front",
            "body_back": "body_depth_back",
        }.items()
        if maps[member].any()
    }
    near = min(float(depth[depth > 0].min()) for depth in depths.values() if depth.any())
    packed = {}
    for name, depth in depths.items():
        # 0 is no surface, as in a shard.
        tenths = np.where(depth > 0, np.clip(np.rint((depth - near) * 1e4) + 1, 1, 65535), 0)
        packed[name] = base64.b64encode(tenths.astype("<u2").tobytes()).decode()
    rows, columns = next(iter(depths.values())).shape
    return {
        "rows": rows,
        "columns": columns,
        "spacing": step * pixel_size,
        "near": near,
        "depths": packed,
    }


def counts(shard: Shard, first: int) -> dict[str, Any]:
    """Histograms of a shard: of depth, thickness and the sensor's residual in `SAMPLED` views, that
    of `first` among them; yaw and the share of pixels that the subject covers, of all views.

    The residual is what the sensor read less the truth, over the standard deviation that its model
    states for the pixel, so that it has unit variance where the reading follows its model.
    """
    others = [i for i in range(len(shard)) if i != first]
    some = (
        [others[round(k)] for k in np.linspace(0, len(others) - 1, SAMPLED - 1)] if others else []
    )
    depth = np.zeros(_MOST_DEPTH // DEPTH_MM, dtype=np.int64)
    thickness = np.zeros(_MOST_THICKNESS // THICKNESS_MM, dtype=np.int64)
    residual = np.zeros(round(2 * _MOST_RESIDUAL / RESIDUAL), dtype=np.int64)
    lost = read = 0
    squares = 0.0
    base = shard.base or shard
    for i in sorted(some):
        view = base.view(
            i, ["mask", "depth_front", "depth_back", "depth_sensor", "normal_front", "rgb_front"]
        )
        mask = view["mask"]
        front, back = view["depth_front"][mask], view["depth_back"][mask]
        depth += _binned(np.concatenate([front, back]) * 1000 / DEPTH_MM, len(depth))
        thickness += _binned((back - front) * 1000 / THICKNESS_MM, len(thickness))
        sigma = _sigma(view, base.meta, i)
        valid = (view["depth_sensor"] > 0) & mask & (sigma > 0)
        z = (view["depth_sensor"] - view["depth_front"])[valid] / sigma[valid]
        residual += _binned((z + _MOST_RESIDUAL) / RESIDUAL, len(residual))
        lost += int((mask & ~valid).sum())
        read += int(valid.sum())
        squares += float(np.square(np.clip(z, -_MOST_RESIDUAL, _MOST_RESIDUAL)).sum())
    mask = shard["mask"]
    return {
        "depth": depth.tolist(),
        "thickness": thickness.tolist(),
        "residual": residual.tolist(),
        "read": read,
        "lost": lost,
        "squares": squares,
        "yaw_deg": np.round(shard["yaw_deg"].astype(float), 2).tolist(),
        "coverage": np.round(mask.mean(axis=(1, 2)), 4).tolist(),
    }


def _sigma(view: dict[str, np.ndarray], meta: dict[str, Any], index: int) -> np.ndarray:
    """(H, W) what the sensor's model states of a pixel; 0 where this version has no such model."""
    try:
        return sensors.read(view, meta, index).sigma
    except ValueError:
        return np.zeros_like(view["depth_front"])


def _binned(bins: np.ndarray, count: int) -> np.ndarray:
    """How many of `bins` (fractions of bins from the first) are in each; the ends take the rest."""
    return np.bincount(np.clip(bins, 0, count - 1).astype(np.int64), minlength=count)
