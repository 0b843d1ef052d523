"""A belt with a buckle."""

from __future__ import annotations

import numpy as np

from subjects.open.base import lattice
from subjects.open.base.chart import Chart
from subjects.open.base.surface import Piece
from subjects.open.trims.zips import plate

WIDTH = 0.034
THICKNESS = 0.0030
SUNK = 0.002
LOOP = 0.0015
"""Metres that a belt loop stands off the belt."""
BELOW = 0.023
"""Template metres from the waistband's upper edge to the belt's middle."""
ROUND = 256
LOOPS = (0.42, 1.45, 2.55, -2.55, -1.45, -0.42)
"""Radians around the waist."""


def belt(chart: Chart) -> list[Piece]:
    """A belt all around, its buckle in front, and the loops that hold it.

    Args:
        chart: around the waist.
    """
    angle = np.linspace(-np.pi, np.pi, ROUND, endpoint=False)
    half = WIDTH / 2
    across = half * np.array([-1.0, -0.96, -0.85, -0.4, 0.0, 0.4, 0.85, 0.96, 1.0])
    rise = THICKNESS * np.array([0.0, 0.75, 1.0, 1.0, 1.0, 1.0, 1.0, 0.75, 0.0])
    rise[[0, -1]] = -SUNK
    points = _points(angle, across, chart)
    strip = _stiff(chart, points, rise)
    uv_line = np.linspace(0, 1, ROUND + 1)
    uv = np.stack(np.meshgrid(uv_line, (across + half) / WIDTH, indexing="ij"), axis=-1)
    pieces = [lattice.woven(strip, "belt", uv, round_about=True)]

    pieces += [_loop(chart, strip, round(ROUND * (0.5 + at / (2 * np.pi)))) for at in LOOPS]
    return pieces + _buckle(strip)


def _points(angle: np.ndarray, across: np.ndarray, chart: Chart) -> np.ndarray:
    """(R, C, 2) on the chart, `across` (C,) metres above the belt's middle."""
    middle = np.stack([angle, np.full(len(angle), -BELOW)], axis=1)
    scale = float(np.median(chart.scale(middle)[:, 1]))
    points = np.repeat(middle[:, None], len(across), axis=1)
    points[..., 1] += across / scale
    return points


def _stiff(chart: Chart, points: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """Leather spans what the waistband folds into."""
    where, out = chart.at(points)
    smooth = lattice.eased(where, 24, round_about=True)
    smooth[:, [0, -1]] = smooth[:, [1, -2]] + (where[:, [0, -1]] - where[:, [1, -2]])
    lift = np.maximum(((smooth - where) * out).sum(axis=-1), 0.0) * (rise > 0)
    return where + (rise + lift)[..., None] * out


def _loop(chart: Chart, strip: np.ndarray, row: int) -> Piece:
    """A narrow loop of cloth over the belt, sewn on above and below it."""
    rows = np.arange(row - 1, row + 2)
    angle = -np.pi + 2 * np.pi * rows / ROUND
    ends = WIDTH / 2 + np.array([0.003, 0.007])
    foot = chart.laid(_points(angle, np.concatenate([-ends[::-1], ends]), chart), np.zeros((3, 4)))
    over = np.concatenate([foot[:, :2], strip[rows, 1:-1], foot[:, 2:]], axis=1)
    lift = np.full(over.shape[:2], LOOP)
    lift[:, [0, -1]] = -SUNK
    high = over + lift[..., None] * lattice.normals(over)
    low = over - SUNK * lattice.normals(over)
    return lattice.woven(np.concatenate([low[:1], high, low[-1:]]), "belt")


def _buckle(strip: np.ndarray) -> list[Piece]:
    """A frame of bent wire around the belt's front, and its prong."""
    rows = len(strip)
    middle = strip[rows // 2, strip.shape[1] // 2]
    front = strip[rows // 2 - 6 : rows // 2 + 7, 2:-2]
    out = lattice.normals(front).mean(axis=(0, 1))
    out /= np.linalg.norm(out)
    up = strip[rows // 2, -2] - strip[rows // 2, 1]
    up -= (up @ out) * out
    up /= np.linalg.norm(up)
    across = np.cross(up, out)
    # The frame is flat, the belly is not: it rests on its highest point.
    rest = float(((front - middle) @ out).max())
    middle = middle + rest * out
    turn = np.linspace(0, 2 * np.pi, 41)[:-1]
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rim = np.sign(rim) * np.abs(rim) ** 0.4
    path = middle + 0.024 * rim[:, :1] * across + 0.022 * rim[:, 1:] * up + 0.0015 * out
    away = rim[:, :1] * across + rim[:, 1:] * up
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    section = np.linspace(0, 2 * np.pi, 9)
    wire = path[:, None] + 0.0026 * (
        np.cos(section)[:, None] * out - np.sin(section)[:, None] * away[:, None]
    )
    frame = lattice.woven(wire, "metal", round_about=True)
    prong = plate(middle + 0.001 * across + 0.0025 * out, across, up, out, (0.025, 0.0022), 0.002)
    return [frame, prong]
