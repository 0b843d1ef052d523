"""What a page shows of one subject: pictures, and depth to turn about."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from report.maps import TITLES, box_of, height_of, pictured
from report.page.measure import counts
from report.view import chosen
from shards.archive import Shard, ShardError

_OPTIONAL = ("body_depth_front", "body_depth_back", "depth_sensor")
"""What may hold nothing: a scan may have no body, and a sensor may have seen nothing."""


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
    def of(cls, subjects: int, rows: int) -> Fineness:
        """For so many on one page, in images of `rows` pixels: a hundred stay below 40 MB."""
        finer = max(1.0, rows / 424)
        if subjects <= 150:
            scale, step, quality = 1.0, 2, 80
        elif subjects <= 500:
            scale, step, quality = 0.5, 4, 70
        else:
            scale, step, quality = 0.35, 6, 60
        return cls(scale / finer, math.ceil(step * finer), quality)


def shown(path: Path, view: int | None, fineness: Fineness) -> dict[str, Any]:
    """A subject as the page's script takes it, JSON-ready.

    Args:
        path: of the shard.
        view: which; None for the one turned least.

    Returns:
        `pictures`: name of a map -> data URL; `solid`: depths on a coarser grid; `view`, `yaw_deg`;
        `height_m` of the silhouette; `size`: rows and columns of the pictures' box; `counts`: of
        the histograms; `source`, `licence`, `sensor`.

    Raises:
        ShardError: the shard is missing or torn, or keeps no contract.
        ValueError: it has no such view.
    """
    shard = Shard(path)
    with sound(path):
        if not (len(shard["yaw_deg"]) and np.isfinite(shard["yaw_deg"]).all()):
            raise ValueError("yaw_deg is empty, or holds what is no number")
    index = chosen(shard, view)
    with sound(path):
        return _shown(shard, index, fineness)


@contextmanager
def sound(path: Path) -> Iterator[None]:
    """Where a shard that keeps no contract becomes a ShardError, whatever it lacks or holds.

    Args:
        path: of the shard.
    """
    try:
        yield
    except ShardError:  # says all of this itself, and is a ValueError too
        raise
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as error:
        # A KeyError shows its message quoted; that of a member names the file itself.
        told = str(error.args[0] if isinstance(error, KeyError) and error.args else error)
        if not told.startswith(str(path)):
            lacks = "meta lacks " if isinstance(error, KeyError) else ""
            told = f"{path} cannot be shown: {lacks}{told}"
        raise ShardError(f"{told}; run verify, and build it again") from error


def _shown(shard: Shard, index: int, fineness: Fineness) -> dict[str, Any]:
    names = [name for name in TITLES if name in shard.names]
    maps = shard.view(index, ["mask", *names])
    if not maps["mask"].any():
        raise ValueError(f"view {index} shows nothing")
    if not all(np.isfinite(maps[name]).all() for name in names):
        raise ValueError(f"view {index} holds what is no number")
    if any((maps[name] < 0).any() for name in names if "depth" in name):
        raise ValueError(f"view {index} holds a depth below 0")
    pixel_size = float(shard.meta["camera"]["pixel_size"])
    box = box_of(maps)
    return {
        "counts": counts(shard, index),
        "view": index,
        "yaw_deg": round(float(shard["yaw_deg"][index]), 2),
        "height_m": round(height_of(maps["mask"], pixel_size), 3),
        "size": [side.stop - side.start for side in box],
        "pictures": {
            name: picture(pictured(maps, name, pixel_size)[box], fineness)
            for name in (*names, "thickness")
            if name not in _OPTIONAL or maps[name].any()
        },
        "solid": _solid(maps, box, pixel_size, fineness.step),
        "source": str(shard.meta["source"]),
        "licence": str(shard.meta["licence"]),
        "sensor": str(shard.meta["sensor"]["model"]),
    }


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
