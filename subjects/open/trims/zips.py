"""Zips: a ribbed band with a puller."""

from __future__ import annotations

import numpy as np

from subjects.open.base import lattice
from subjects.open.base.chart import Chart
from subjects.open.base.surface import Piece
from subjects.open.trims import band

HEIGHT = 0.002
TAPE = 0.0006
SUNK = 0.0015
TOOTH = 2
"""Rows from one tooth to the next."""


def teeth(
    chart: Chart, middle: np.ndarray, width: float, tape_width: float, cell: str
) -> list[Piece]:
    """Tape and teeth along `middle` (R, 2), and the puller at its upper end."""
    half = width / 2
    side = 0.5 * tape_width
    tape = np.array([-side, -side + 0.0006, -1.2 * half, 0.0, 1.2 * half, side - 0.0006, side])
    flat = np.array([-SUNK, TAPE, TAPE, TAPE, TAPE, TAPE, -SUNK])
    base = band.upright(chart, middle, tape, flat, to_right=1.0, calm=9)

    fine = np.stack(
        [
            np.interp(np.arange(2 * len(middle) - 1) / 2, np.arange(len(middle)), m)
            for m in middle.T
        ],
        axis=1,
    )
    across = half * np.array([-1.0, -0.9, -0.5, -0.05, 0.05, 0.5, 0.9, 1.0])
    # Teeth of the two sides take turns.
    turn = (np.arange(len(fine)) // TOOTH) % 2
    left = np.where(turn == 0, HEIGHT, 0.55 * HEIGHT)[:, None] * [1.0, 1.0, 1.0]
    right = np.where(turn == 1, HEIGHT, 0.55 * HEIGHT)[:, None] * [1.0, 1.0, 1.0]
    sunk = np.full((len(fine), 1), -SUNK)
    height = np.concatenate([sunk, left, right, sunk], axis=1)
    chain = band.upright(chart, fine, across, height, to_right=1.0, calm=36)
    return [lattice.woven(base, cell), lattice.woven(chain, "metal"), *_puller(chain)]


def _puller(chain: np.ndarray) -> list[Piece]:
    """A slider on the chain and the tab that hangs from it."""
    out = lattice.normals(chain)[6:16, 2:6].mean(axis=(0, 1))
    out /= np.linalg.norm(out)
    top = chain[4, 3:5].mean(axis=0)
    down = chain[14, 3:5].mean(axis=0) - top
    down -= (down @ out) * out
    down /= np.linalg.norm(down)
    across = np.cross(out, down)
    slider = plate(top + 0.007 * down, down, across, out, (0.0075, 0.0055), 0.004)
    tab = plate(top + 0.022 * down + 0.0015 * out, down, across, out, (0.013, 0.0038), 0.0025)
    return [slider, tab]


def plate(
    at: np.ndarray,
    down: np.ndarray,
    across: np.ndarray,
    out: np.ndarray,
    half: tuple[float, float],
    height: float,
) -> Piece:
    """A rounded plate in the plane of `down` and `across`, `half` its lengths along them."""
    turn = np.linspace(0, 2 * np.pi, 21)[:-1]
    # A superellipse: a rectangle with round corners.
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rim = np.sign(rim) * np.abs(rim) ** 0.55
    share = np.array([1.0, 1.0, 0.88, 0.5, 0.0])
    high = np.array([-0.9, 0.6, 1.0, 1.0, 1.0]) * height
    spread = rim[:, None, 0, None] * half[0] * down + rim[:, None, 1, None] * half[1] * across
    points = at + share[:, None] * spread + high[:, None] * out
    return lattice.woven(points, "metal", round_about=True)
