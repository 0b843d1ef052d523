"""Bands: strips of a profile along a line on the cloth, such as plackets and neckbands."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from subjects.open.base.chart import Chart

ROW = 0.004
"""Metres on the template from one row of a vertical band to the next."""
BUST = 0.40
"""Template height above which an open front is narrowest."""


def upright(
    chart: Chart,
    middle: np.ndarray,
    across: np.ndarray,
    height: np.ndarray,
    *,
    to_right: float,
    calm: int,
) -> np.ndarray:
    """A band down the cloth: (R, C, 3), rows downwards, both of its ends sunk into the cloth.

    Args:
        middle: (R, 2) its line on the chart, from above.
        across: (C,) metres in the world from the line, towards `to_right` times the chart's x.
        height: (R, C) or (C,) metres above the cloth.
        to_right: the chart's sign of the viewer's right: 1 in front, -1 behind.
        calm: see `Chart.laid`.
    """
    scale = gaussian_filter1d(chart.scale(middle)[:, 0], 6.0, mode="nearest")
    points = np.repeat(middle[:, None], len(across), axis=1)
    points[..., 0] += to_right * across / scale[:, None]
    full = np.array(np.broadcast_to(height, points.shape[:2]))
    full[[0, -1]] = height_below(full)
    return chart.laid(points, full, calm)


def height_below(height: np.ndarray) -> float:
    """How deep a profile's edge is sunk."""
    return float(min(height.min(), 0.0))


def line(chart: Chart, x: float, upper: float, lower: float) -> np.ndarray:
    """(R, 2) from above down the chart at `x`, as far between the heights as there is cloth."""
    y = np.arange(upper, lower, -ROW)
    points = np.stack([np.full(len(y), x), y], axis=1)
    held = chart.holds(points)
    if not held.any():
        return points[:0]
    first = int(held.argmax())
    # A vee's point or the crotch may end it early.
    gone = np.flatnonzero(~held[first:])
    stop = first + int(gone[0]) if len(gone) else len(points)
    # One row more above, so that it reaches the cloth's very edge.
    return points[max(first - 1, 0) : stop]


def edge(chart: Chart, side: float, upper: float, lower: float, inward: float) -> np.ndarray:
    """(R, 2) from above, along one edge of an open front.

    Args:
        side: of the body: 1 left, -1 right.
        inward: metres on the template from the edge to the line.
    """
    x = np.arange(0.0, 0.20, 0.002)
    y = np.arange(upper, lower, -ROW)
    grid = np.stack(np.meshgrid(side * x, y), axis=-1)
    held = chart.holds(grid)
    first = x[held.argmax(axis=1)]
    open_here = held.any(axis=1) & (first > 0.01)
    if not open_here.any():
        return np.zeros((0, 2))
    # Above its narrowest the opening is the neckline.
    start = int(np.where(open_here & (y > BUST), first, np.inf).argmin())
    gone = np.flatnonzero(~open_here[start:])
    stop = start + int(gone[0]) if len(gone) else len(y)
    at = gaussian_filter1d(first[start:stop], 3.0, mode="nearest") + inward
    return np.stack([side * at, y[start:stop]], axis=1)
