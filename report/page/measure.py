"""What the maps of a shard measure, as counts that add up over a dataset."""

from __future__ import annotations

from typing import Any

import numpy as np

from augment import sensors
from shards.archive import Shard

SAMPLED = 4
"""Views of each subject whose depths are measured, spread over all; the first is the one shown."""

DEPTH_MM, THICKNESS_MM, RESIDUAL = 10, 5, 0.1
"""Widths of the histograms' bins: millimetres, and standard deviations of the sensor's noise."""

_MOST_DEPTH, _MOST_THICKNESS, MOST_RESIDUAL = 8000, 1500, 6.0
"""What goes into the outermost bins, in the same units."""


def counts(shard: Shard, first: int) -> dict[str, Any]:
    """Histograms of a shard: of depth, thickness and the sensor's residual in `SAMPLED` views, that
    of `first` among them; yaw and the share of pixels that the subject covers, of all views.

    `read` and `lost` count the subject's pixels that the sensor saw and did not see. A residual is
    what was read less the truth, over the standard deviation that the sensor's model states for the
    pixel; `measured` counts them, and `beyond` those past the last edges, which the outermost bins
    hold too.

    Raises:
        ValueError: a map that is measured holds what is no number.
    """
    others = [i for i in range(len(shard)) if i != first]
    some = {first}
    if others:
        some |= {others[round(k)] for k in np.linspace(0, len(others) - 1, SAMPLED - 1)}
    depth = np.zeros(_MOST_DEPTH // DEPTH_MM, dtype=np.int64)
    thickness = np.zeros(_MOST_THICKNESS // THICKNESS_MM, dtype=np.int64)
    residual = np.zeros(round(2 * MOST_RESIDUAL / RESIDUAL), dtype=np.int64)
    lost = read = measured = beyond = 0
    base = shard.base or shard
    for i in sorted(some):
        view = base.view(
            i, ["mask", "depth_front", "depth_back", "depth_sensor", "normal_front", "rgb_front"]
        )
        if not all(np.isfinite(array).all() for array in view.values()):
            raise ValueError(f"view {i} holds what is no number")
        mask = view["mask"]
        front, back = view["depth_front"][mask], view["depth_back"][mask]
        depth += _binned(np.concatenate([front, back]) * 1000 / DEPTH_MM, len(depth))
        thickness += _binned((back - front) * 1000 / THICKNESS_MM, len(thickness))
        sigma = _sigma(view, base.meta, i)
        seen = (view["depth_sensor"] > 0) & mask
        stated = seen & (sigma > 0)
        z = (view["depth_sensor"] - view["depth_front"])[stated] / sigma[stated]
        residual += _binned((z + MOST_RESIDUAL) / RESIDUAL, len(residual))
        lost += int((mask & ~seen).sum())
        read += int(seen.sum())
        measured += int(stated.sum())
        beyond += int((np.abs(z) > MOST_RESIDUAL).sum())
    mask = shard["mask"]
    return {
        "depth": depth.tolist(),
        "thickness": thickness.tolist(),
        "residual": residual.tolist(),
        "read": read,
        "lost": lost,
        "measured": measured,
        "beyond": beyond,
        "yaw_deg": turned(shard["yaw_deg"]),
        "coverage": np.round(mask.mean(axis=(1, 2)), 4).tolist(),
    }


def turned(yaw_deg: np.ndarray) -> list[float]:
    """Degrees from -180 to 180: a turn of 270 is one of -90."""
    return np.round((yaw_deg.astype(float) + 180) % 360 - 180, 2).tolist()


def _sigma(view: dict[str, np.ndarray], meta: dict[str, Any], index: int) -> np.ndarray:
    """(H, W) what the sensor's model states of a pixel; 0 where this version has no such model."""
    try:
        return sensors.read(view, meta, index).sigma
    except ValueError:
        return np.zeros_like(view["depth_front"])


def _binned(bins: np.ndarray, count: int) -> np.ndarray:
    """How many of `bins` (fractions of bins from the first) are in each; the ends take the rest."""
    return np.bincount(np.clip(bins, 0, count - 1).astype(np.int64), minlength=count)
