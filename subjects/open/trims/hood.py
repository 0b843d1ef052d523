"""A hood that lies on the back, and its cords."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from subjects.open.base import lattice, surface
from subjects.open.base.chart import Chart
from subjects.open.base.ramp import ramp
from subjects.open.base.surface import Piece, Solid
from subjects.open.clothes.worn import Worn
from subjects.open.trims import band
from subjects.open.trims.collar import down, upwards

ROUND = 168
ALONG = 34
START = 0.03
"""Radians from the middle of the front to the hood's ends."""
# The section of the hood: share of its length from the neckline along the back, metres off it.
# From inside the neck over the lining's hollow to the rim, and down the outside of the pouch.
BEHIND = np.array(
    [
        (0.00, -0.004),
        (0.01, 0.020),
        (0.04, 0.030),
        (0.10, 0.029),
        (0.17, 0.023),
        (0.23, 0.030),
        (0.28, 0.044),
        (0.35, 0.050),
        (0.48, 0.047),
        (0.66, 0.042),
        (0.84, 0.035),
        (0.96, 0.020),
        (0.995, 0.006),
        (0.98, -0.004),
    ]
)
BESIDE = np.array(
    [
        (0.00, -0.004),
        (0.01, 0.018),
        (0.06, 0.030),
        (0.14, 0.036),
        (0.24, 0.038),
        (0.34, 0.039),
        (0.44, 0.038),
        (0.54, 0.035),
        (0.66, 0.031),
        (0.77, 0.025),
        (0.88, 0.017),
        (0.96, 0.009),
        (1.00, 0.003),
        (0.98, -0.004),
    ]
)
LENGTH_ANGLE = np.array([0.0, 0.35, 0.9, 1.57, 1.95, 2.25, 2.6, np.pi])
LENGTH = np.array([0.028, 0.034, 0.046, 0.062, 0.085, 0.135, 0.180, 0.200])
"""Metres from the neckline to the hood's lower edge, by the angle from the front."""
CORD = 0.17


def hood(worn: Worn, chart: Chart, around: Solid) -> Piece:
    """The hood as it lies when it is not worn on the head."""
    angle = np.linspace(START, 2 * np.pi - START, ROUND)
    front = np.minimum(angle, 2 * np.pi - angle)
    length = CubicSpline(LENGTH_ANGLE, LENGTH, bc_type=((1, 0.0), (1, 0.0)))(front)

    knot = np.linspace(0, 1, len(BEHIND))
    along = np.linspace(0, 1, ALONG)
    behind, beside = (CubicSpline(knot, section)(along) for section in (BEHIND, BESIDE))
    back = ramp(front, 1.5, 2.5)[:, None, None]
    section = back * behind + (1 - back) * beside
    distance = np.clip(section[..., 0], 0, None) * length[:, None]
    # Towards its ends in front the hood thins out.
    end = 0.45 + 0.55 * ramp(front, START, 1.1)
    height = np.where(section[..., 1] > 0, section[..., 1] * end[:, None], section[..., 1])
    # The pouch sags in soft folds that run down from the neck.
    low = ramp(section[..., 0], 0.35, 0.6) * (1 - ramp(section[..., 0], 0.85, 1.0))
    fold = 0.6 * np.cos(7.0 * angle + 0.8) + 0.4 * np.cos(11.0 * angle - 0.5)
    height = height + 0.004 * fold[:, None] * low * back[..., 0]
    height[[0, -1]] = -0.004

    points = down(chart, angle, distance)
    where, out = chart.at(points)
    axis = upwards(where[:, 0], around)
    # By the neck the cloth stands up rather than off the shoulder.
    stand = 0.7 * (1 - ramp(distance, 0.0, 0.05))[..., None]
    away = (1 - stand) * out + stand * axis
    away = lattice.eased(away, 6)
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    calm = gaussian_filter1d(gaussian_filter1d(where, 4.0, axis=0), 2.0, axis=1)
    above = height > 0
    lift = np.maximum(((calm - where) * out).sum(axis=-1), 0.0) * above
    shape = where + lift[..., None] * out + height[..., None] * away

    place = replace(chart, vertices=worn.place).at(points)[0].reshape(-1, 3)
    cloth = Solid(worn.vertices, chart.normals, worn.place)
    room = np.where(above, 0.003, -0.01).ravel()
    for _ in range(3):
        flat = shape.reshape(-1, 3)
        flat = surface.pushed_out(flat, place, np.where(above, 0.004, -0.01).ravel(), around)
        flat = surface.pushed_out(flat, place, room, cloth)
        shape = lattice.eased(flat.reshape(shape.shape), 2)
    return lattice.woven(shape[:, ::-1], "hood")


def cords(front: Chart, upper: float) -> list[Piece]:
    """The two cords that hang from the hood's ends."""
    turn = np.linspace(-0.15, 1.15, 8) * np.pi
    across, height = -0.0028 * np.cos(turn), 0.0022 + 0.0028 * np.sin(turn)
    pieces = []
    for side, length in ((-1.0, CORD), (1.0, 0.93 * CORD)):
        middle = band.line(front, side * 0.024, upper, upper - length)
        if len(middle) < 8:
            continue
        middle[:, 0] += side * 0.006 * np.linspace(0, 1, len(middle))
        # A knot holds its end.
        knot = 1 + 0.9 * np.exp(-((np.arange(len(middle)) - (len(middle) - 4)) ** 2) / 4.0)
        cord = band.upright(front, middle, across, np.outer(knot, height), to_right=1.0, calm=16)
        pieces.append(lattice.woven(cord, "lace"))
    return pieces
