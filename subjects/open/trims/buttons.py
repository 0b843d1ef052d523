"""Buttons on a placket."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from subjects.open.base import lattice
from subjects.open.base.chart import Chart
from subjects.open.base.surface import Piece
from subjects.open.trims import band

SPACING = 0.072
"""Template metres from button to button."""
BELOW_END = 0.012
SUNK = 0.0015
PLACKET = 0.0015
THICKNESS = 0.0025
SECTORS = 20
# A button's section from under its rim to the middle: share of the radius, of the thickness.
SECTION = np.array(
    [(1.0, -0.5), (1.0, 0.55), (0.95, 0.85), (0.84, 1.0), (0.70, 0.92), (0.55, 0.66), (0.0, 0.62)]
)


def placket(
    chart: Chart, middle: np.ndarray, width: float, cell: str
) -> tuple[Piece, np.ndarray, np.ndarray]:
    """A second layer of cloth along `middle` (R, 2); its middle line and normals, (R, 3) each."""
    half = width / 2
    across = np.array([-half, -half + 0.0008, -half + 0.003, -half / 2, 0.0])
    across = np.concatenate([across, -across[-2::-1]])
    # Edges are pressed, and a seam runs along them.
    height = np.array([-SUNK, 0.7 * PLACKET, PLACKET, PLACKET, PLACKET])
    height = np.concatenate([height, height[-2::-1]])
    points = band.upright(chart, middle, across, height, to_right=1.0, calm=9)
    centre = points[:, len(across) // 2]
    out = gaussian_filter1d(lattice.normals(points)[:, len(across) // 2], 3.0, axis=0)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return lattice.woven(points, cell), centre, out


def buttons(centre: np.ndarray, out: np.ndarray, diameter: float) -> list[Piece]:
    """Buttons down a line of points (R, 3) with normals, `band.ROW` apart on the template."""
    start, step = round(BELOW_END / band.ROW), round(SPACING / band.ROW)
    return [
        button(centre[k], out[k], centre[k] - centre[k - 1], diameter)
        for k in range(start, len(centre) - start, step)
    ]


def button(at: np.ndarray, out: np.ndarray, down: np.ndarray, diameter: float) -> Piece:
    """One round button with a rim, on its back at `at` (3,)."""
    across = np.cross(down, out)
    across /= np.linalg.norm(across)
    up = np.cross(out, across)
    angle = np.linspace(0, 2 * np.pi, SECTORS + 1)
    turn = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * up
    radius, high = SECTION.T
    points = at + 0.5 * diameter * radius[:, None] * turn[:-1, None]
    points = points + THICKNESS * high[:, None] * out
    flat = 0.5 + 0.5 * radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)[:, None]
    return lattice.woven(points, "button", flat, round_about=True)
