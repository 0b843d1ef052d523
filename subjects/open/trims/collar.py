"""What goes around the neck: ribbed neckbands and folded collars."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from subjects.open.base import lattice, surface
from subjects.open.base.chart import Chart
from subjects.open.base.ramp import ramp
from subjects.open.base.surface import Piece, Solid
from subjects.open.clothes.worn import Worn

BAND_WIDTH = 0.020
BAND_HEIGHT = 0.0022
SUNK = 0.0015
WRAP = 0.004
"""Metres that a neckband goes inside the neckline."""
ROUND = 120
REACH = 0.32
"""How far below the neckline trims go, in the neckline's field."""


@dataclass(frozen=True)
class Cut:
    """A folded collar, metres."""

    stand: float
    """Height of the band behind the neck."""
    stand_front: float
    back: float
    """How far below the neckline the fall ends behind and at the sides."""
    point: float
    """How far below it its points are."""
    spread: float
    """Radians around the neck from the front edge's upper end to the point."""
    thickness: float
    roll: float
    """How far the fall stands off the band where it folds."""
    lean: float
    """How far the band leans outwards, per metre of its height."""
    clearance: float
    """How far its upper edge keeps from the skin."""


SHIRT = Cut(0.030, 0.022, 0.014, 0.046, 0.36, 0.0018, 0.005, -0.12, 0.003)
UNDER_JACKET = Cut(0.032, 0.022, 0.0, 0.042, 0.24, 0.0018, 0.004, -0.15, 0.003)
JACKET = Cut(0.025, 0.020, 0.032, 0.075, 0.42, 0.0030, 0.007, 0.35, 0.014)


def half_turn(angle: np.ndarray) -> np.ndarray:
    """The same angles within half a turn of 0."""
    return np.mod(angle + np.pi, 2 * np.pi) - np.pi


def down(chart: Chart, angle: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(R, C, 2) on the chart around the neck: points a distance below the neckline.

    Args:
        angle: (R,) radians around the neck.
        distance: (R, C) metres, measured along the cloth.
    """
    level = np.linspace(0.0, -REACH, 81)
    around = half_turn(angle)[:, None]
    ray = np.stack(np.broadcast_arrays(around, level), axis=-1)
    where = gaussian_filter1d(chart.at(ray)[0], 2.0, axis=0, mode="nearest")
    step = np.linalg.norm(np.diff(where, axis=1), axis=-1)
    run = np.concatenate([np.zeros((len(angle), 1)), np.cumsum(step, axis=1)], axis=1)
    found = np.array([np.interp(d, r, level) for d, r in zip(distance, run, strict=True)])
    return np.stack(np.broadcast_arrays(around, found), axis=-1)


def neckband(chart: Chart, cell: str) -> Piece:
    """A ribbed band along a closed neckline, turned in over its edge."""
    angle = np.linspace(-np.pi, np.pi, ROUND, endpoint=False)
    below = BAND_WIDTH * np.array([1.0, 0.96, 0.86, 0.6, 0.35, 0.12, 0.03, 0.0])
    height = BAND_HEIGHT * np.array([0.0, 0.7, 1.0, 1.0, 1.0, 1.0, 0.6, 0.0])
    height[0], height[-1] = -SUNK, -WRAP
    points = down(chart, angle, np.broadcast_to(below, (ROUND, len(below))))
    where = chart.laid(points, np.broadcast_to(height, points.shape[:2]), calm=4)
    u, v = np.meshgrid(np.linspace(0, 1, ROUND + 1), 1 - below / BAND_WIDTH, indexing="ij")
    return lattice.woven(where, cell, np.stack([u, v], axis=-1), round_about=True)


def opening(chart: Chart) -> float:
    """Radians around the neck at which the cloth begins; 0 where the front is closed."""
    angle = np.arange(0.0, 1.2, 0.01)
    held = [
        chart.holds(np.stack([side * angle, np.full(len(angle), -0.012)], axis=-1))
        for side in (-1.0, 1.0)
    ]
    both = held[0] & held[1]
    return float(angle[both.argmax()]) if both.any() else 0.0


def collar(worn: Worn, chart: Chart, around: Solid, cut: Cut, cell: str) -> Piece:
    """A collar folded over its standing band, with two points in front."""
    start = opening(chart) + 0.01
    angle = np.linspace(start, 2 * np.pi - start, ROUND)
    front = np.minimum(angle, 2 * np.pi - angle) - start
    near = 1.0 - ramp(front, 0.0, 1.1)
    side = np.where(angle < np.pi, 1.0, -1.0)

    edge = down(chart, angle, np.full((ROUND, 1), 0.002))
    root, out = chart.at(edge)
    root = _eased(root[:, 0])
    out = _eased(out[:, 0])
    place = replace(chart, vertices=worn.place)
    axis = upwards(root, around)
    radial = out - (out @ axis)[:, None] * axis
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    up = axis + cut.lean * radial
    stand = cut.stand + (cut.stand_front - cut.stand) * near
    top = root + stand[:, None] * up

    # The fall's lower edge, drawn out to the points.
    leaning = angle + side * cut.spread * near
    length = cut.back + (cut.point - cut.back) * near**2
    end_at = down(chart, leaning, length[:, None])
    end, end_out = (v[:, 0] for v in chart.at(end_at))
    end = _eased(end) + (0.003 + cut.thickness) * end_out

    fold = top + cut.roll * radial
    bulge = 0.5 * (fold + end) + 0.004 * radial
    t = np.linspace(0, 1, 9)[:, None, None]
    fall = (1 - t) ** 2 * end + 2 * t * (1 - t) * bulge + t**2 * fold
    turn = np.linspace(0.25, 1, 4)[:, None, None] * np.pi
    half = 0.5 * cut.roll
    bend = (top + half * radial) + half * (np.cos(turn) * radial + 1.2 * np.sin(turn) * up)
    t = np.linspace(0.25, 1, 4)[:, None, None]
    band = (1 - t) * top + t * (root - 0.004 * up - 0.001 * radial)
    points = np.concatenate([fall, bend, band]).transpose(1, 0, 2)

    outer = slice(0, len(fall))
    here = np.repeat(place.at(edge)[0], points.shape[1], axis=1)
    here[:, outer] = place.at(edge + np.linspace(1, 0, len(fall))[None, :, None] * (end_at - edge))[
        0
    ]
    cloth = Solid(worn.vertices, chart.normals, worn.place)
    gap = np.full(ROUND, 0.0025 + cut.thickness)
    skin = np.full(points.shape[1], cut.clearance)
    skin[-len(band) :] = np.linspace(cut.clearance, 0.003, len(band))
    skin[: len(fall)] = np.linspace(0.003, cut.clearance, len(fall))
    for _ in range(2):
        points = _clear(points, here, around, skin)
        flat = points[:, outer].reshape(-1, 3)
        flat = surface.pushed_out(
            flat, here[:, outer].reshape(-1, 3), np.repeat(gap, len(fall)), cloth
        )
        points[:, outer] = flat.reshape(ROUND, -1, 3)
        points = lattice.eased(points, 2)
    return lattice.shell(points, cut.thickness, cell)


def upwards(root: np.ndarray, around: Solid) -> np.ndarray:
    """(3,) unit vector from the middle of a neckline to the head."""
    head = around.vertices[around.place[:, 1] > 0.68].mean(axis=0)
    axis = head - root.mean(axis=0)
    return axis / np.linalg.norm(axis)


def _clear(points: np.ndarray, place: np.ndarray, around: Solid, gap: np.ndarray) -> np.ndarray:
    room = np.broadcast_to(gap, points.shape[:2]).ravel()
    flat = surface.pushed_out(points.reshape(-1, 3), place.reshape(-1, 3), room, around)
    return flat.reshape(points.shape)


def _eased(line: np.ndarray) -> np.ndarray:
    """A line (R, 3) smoothed; it keeps its length."""
    longer = np.pad(line, ((9, 9), (0, 0)), mode="reflect", reflect_type="odd")
    return gaussian_filter1d(longer, 3.0, axis=0, truncate=3.0)[9:-9]
