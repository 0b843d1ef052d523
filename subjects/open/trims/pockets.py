"""Patch pockets: flat pieces of cloth sewn on along all but their upper edge."""

from __future__ import annotations

import numpy as np

from subjects.open.base import lattice
from subjects.open.base.chart import Chart
from subjects.open.base.surface import Piece

SUNK = 0.0015
MESH = 0.005


def patch(
    chart: Chart,
    centre: tuple[float, float],
    outline: np.ndarray,
    height: float,
    gape: float,
    cell: str,
    to_right: float,
) -> Piece:
    """A pocket of a given outline.

    Args:
        centre: on the chart, the middle of its upper edge.
        outline: (K, 3) from above: metres below the upper edge, half width to the viewer's left
            and to the right.
        height: metres that it stands off the cloth.
        gape: metres that its mouth, the upper edge, stands off more.
        to_right: the chart's sign of the viewer's right.
    """
    deep = outline[-1, 0]
    rows = max(round(deep / MESH), 4)
    inner = np.linspace(0, deep, rows)
    down = np.concatenate([[0.0], inner, [deep]])
    left, right = (np.interp(down, outline[:, 0], outline[:, k]) for k in (1, 2))
    columns = max(round(float((left + right).max() / MESH)), 4)
    across = np.linspace(0.0, 1.0, columns)
    across = np.concatenate([[0.0], across, [1.0]])
    offset = -left[:, None] + (left + right)[:, None] * across
    scale = chart.scale(np.array([centre]))[0]
    points = np.stack(
        [
            centre[0] + to_right * offset / scale[0],
            np.broadcast_to(centre[1] - down[:, None] / scale[1], offset.shape),
        ],
        axis=-1,
    )
    edge = np.minimum.outer(
        np.minimum(np.arange(rows + 2), np.arange(rows + 2)[::-1]),
        np.minimum(np.arange(columns + 2), np.arange(columns + 2)[::-1]),
    )
    high = np.where(edge == 0, -SUNK, np.where(edge == 1, 0.75 * height, height))
    # The mouth hangs open most in its middle; a hem runs along it.
    mouth = np.exp(-down / 0.012)[:, None] * (4 * across * (1 - across))
    hem = (down < 0.018)[:, None] * 0.0005
    high = np.where(edge == 0, high, high + gape * mouth + hem)
    surface = chart.laid(points, high, calm=9)
    uv = np.stack(
        [
            np.broadcast_to(across, high.shape),
            np.broadcast_to(1 - down[:, None] / deep, high.shape),
        ],
        axis=-1,
    )
    return lattice.woven(surface, cell, uv)


def square(width: float, deep: float, point: float = 0.0) -> np.ndarray:
    """Outline of a pocket with round lower corners, or one that runs out in a point."""
    half = width / 2
    if point:
        return np.array([(0.0, half, half), (deep - point, half, half), (deep, 0.006, 0.006)])
    bend = np.linspace(0, np.pi / 2, 6)
    radius = 0.012
    low = deep - radius + radius * np.sin(bend)
    side = half - radius + radius * np.cos(bend)
    return np.concatenate([[(0.0, half, half)], np.stack([low, side, side], axis=1)])


def kangaroo(chart: Chart, centre: tuple[float, float], cell: str) -> Piece:
    """The pouch of a hoodie: hands go in at its slanted sides."""
    scale = chart.scale(np.array([centre]))[0]
    deep, wide, narrow = 0.180, 0.155, 0.095
    slant, straight = 0.115, 0.02
    knots = np.array([0.0, straight, straight + slant, deep])
    half = np.array([narrow, narrow + 0.006, wide, wide])
    rows, columns = 36, 62
    down = np.concatenate([[0.0], np.linspace(0, deep, rows), [deep]])
    across = np.concatenate([[-1.0], np.linspace(-1, 1, columns), [1.0]])
    reach = np.interp(down, knots, half)
    offset = reach[:, None] * across
    points = np.stack(
        [
            centre[0] + offset / scale[0],
            np.broadcast_to(centre[1] - down[:, None] / scale[1], offset.shape),
        ],
        axis=-1,
    )
    edge = np.zeros(offset.shape)
    edge[1:-1, 1:-1] = 1.0
    opening = np.interp(
        down, [straight, straight + 0.02, straight + slant - 0.01, straight + slant], [0, 1, 1, 0]
    )
    aside = reach[:, None] * (1 - np.abs(across))
    # The slanted mouths stand open; things in the pouch make it belly out a little.
    mouth = 0.006 * opening[:, None] * np.exp(-aside / 0.015)
    hem = 0.0008 * ((aside < 0.022) & (opening[:, None] > 0))
    belly = 0.006 * np.sin(np.pi * down / deep)[:, None] ** 2 * (1 - across**2)
    high = np.where(edge > 0, 0.003 + mouth + hem + belly, -SUNK)
    surface = chart.laid(points, high, calm=16)
    uv = np.stack(
        [0.5 + 0.5 * offset / wide, np.broadcast_to(1 - down[:, None] / deep, offset.shape)],
        axis=-1,
    )
    return lattice.woven(surface, cell, uv)
