"""A baseball cap and a beanie, made to fit a head."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter

from subjects.open.base.atlas import cell
from subjects.open.base.ramp import ramp
from subjects.open.base.surface import Piece, normals
from subjects.open.hair.head import MIDDLE, Head

ROUND, ROWS = 144, 22
THICKNESS = 0.0025
CROWN = 0.25
"""Share of the cell that the brim has, below the crown's."""
BRIM, BRIM_HALF = 0.072, np.radians(62.0)
"""Metres that a brim stands out in front, and the angle to where it ends at either side."""

Edge = Callable[[np.ndarray], np.ndarray]


def azimuth(direction: np.ndarray) -> np.ndarray:
    """(N,) radians around the head, 0 in front, to its left positive."""
    return np.arctan2(direction[..., 0], direction[..., 2])


def elevation(direction: np.ndarray) -> np.ndarray:
    """(N,) radians above the skull's middle."""
    return np.arcsin(np.clip(direction[..., 1], -1.0, 1.0))


def put_on(kind: str, head: Head) -> tuple[list[Piece], Edge]:
    """A hat's pieces, and the elevation of its lower edge over the azimuth, radians.

    Args:
        kind: none, cap or beanie.
    """
    if kind == "cap":
        crown = _dome(head, _cap_edge, 0.006, _cap_relief, 1.0)
        return [crown, _brim(head), _top_button(head)], _cap_edge
    if kind == "beanie":
        return [_dome(head, _beanie_edge, 0.005, _knit_relief, 1.06)], _beanie_edge
    return [], lambda around: np.full_like(around, np.pi)


def _cap_edge(around: np.ndarray) -> np.ndarray:
    return np.radians(4.0 + 17.0 * np.cos(around))


def _beanie_edge(around: np.ndarray) -> np.ndarray:
    return np.radians(0.0 + 19.0 * np.cos(around) - 4.0 * np.cos(2 * around))


def _cap_relief(around: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Six panels, each a little full between its seams."""
    panel = (around / (2 * np.pi) * 6.0 + 0.5) % 1.0 - 0.5
    seam = np.exp(-((np.abs(panel) / 0.035) ** 2))
    return 0.0012 * np.cos(np.pi * panel) - 0.0012 * seam


def _knit_relief(around: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Ribs, and a cuff turned up over the lower third."""
    cuff = 0.006 * ramp(share, 0.335, 0.315)
    return cuff + 0.0011 * np.cos(36.0 * around)


def _directions(around: np.ndarray, up: np.ndarray) -> np.ndarray:
    level = np.cos(up)
    return np.stack([level * np.sin(around), np.sin(up), level * np.cos(around)], axis=-1)


def _fit(head: Head, around: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Smooth template metres from the middle to what a hat must clear, (R, C)."""
    direction = _directions(around, up)
    reach = head.reach(direction.reshape(-1, 3)).reshape(up.shape)
    # A hat spans hollows: the larger of the fit and its smooth form.
    smooth = gaussian_filter(reach, (2.0, 5.0), mode=("nearest", "wrap"))
    return gaussian_filter(np.maximum(reach, smooth), (1.0, 3.0), mode=("nearest", "wrap"))


def _dome(
    head: Head,
    edge: Edge,
    gap: float,
    relief: Callable[[np.ndarray, np.ndarray], np.ndarray],
    high: float,
) -> Piece:
    around = np.linspace(-np.pi, np.pi, ROUND, endpoint=False)
    share = np.linspace(0.0, 0.985, ROWS)
    around, share = np.meshgrid(around, share)
    up = edge(around) + share * (np.pi / 2 - edge(around))
    reach = _fit(head, around, up) + gap + relief(around, share) * ramp(share, 1.0, 0.8)
    shape = _directions(around, up) * reach[..., None] * [1.0, high, 1.0]
    grid = head.world(MIDDLE + shape)
    u = np.concatenate([around, np.full((ROWS, 1), np.pi)], axis=1) / (2 * np.pi) + 0.5
    v = CROWN + (1 - CROWN) * np.concatenate([share, share[:, :1]], axis=1)
    return _closed(grid, u, v)


def _closed(grid: np.ndarray, u: np.ndarray, v: np.ndarray) -> Piece:
    """A grid (R, C, 3) of rows upwards that go all around, as a bowl with a thickness."""
    rows, columns = grid.shape[:2]
    outer = np.concatenate([grid.reshape(-1, 3), grid[-1].mean(axis=0)[None]])
    at = np.arange(rows * columns).reshape(rows, columns)
    at = np.concatenate([at, at[:, :1]], axis=1)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    flat = np.arange(rows * (columns + 1)).reshape(rows, columns + 1)
    p, q, r, s = flat[:-1, :-1], flat[:-1, 1:], flat[1:, 1:], flat[1:, :-1]
    top, n = rows * columns, rows * columns + 1
    faces = [np.stack([a, b, c], -1), np.stack([a, c, d], -1)]
    chart = [np.stack([p, q, r], -1), np.stack([p, r, s], -1)]
    faces = [f.reshape(-1, 3) for f in faces]
    chart = [f.reshape(-1, 3) for f in chart]
    faces.append(np.stack([at[-1, :-1], at[-1, 1:], np.full(columns, top)], -1))
    chart.append(np.stack([flat[-1, :-1], flat[-1, 1:], flat[-1, :-1]], -1))
    face, corner = np.concatenate(faces), np.concatenate(chart)
    inner = outer - THICKNESS * normals(outer, face)
    low, rim = at[0, :-1], at[0, 1:]
    lip = np.concatenate([np.stack([low, low + n, rim + n], -1), np.stack([low, rim + n, rim], -1)])
    lip_chart = np.concatenate(
        [
            np.stack([flat[0, :-1], flat[0, :-1], flat[0, 1:]], -1),
            np.stack([flat[0, :-1], flat[0, 1:], flat[0, 1:]], -1),
        ]
    )
    uv = cell("cap", u.ravel(), v.ravel())
    return Piece(
        np.concatenate([outer, inner]),
        np.concatenate([face, face[:, ::-1] + n, lip]),
        np.concatenate([uv[corner], uv[corner[:, ::-1]], uv[lip_chart]]),
    )


def _brim(head: Head) -> Piece:
    """A stiff peak, curved over the brow."""
    rows, columns = 10, 49
    side = np.linspace(-1.0, 1.0, columns)
    around = side * BRIM_HALF
    up = _cap_edge(around) + 0.03
    start = _directions(around, up) * (_brim_fit(head, around) + 0.004)[:, None]
    reach = BRIM * np.sqrt(np.maximum(1.0 - np.abs(side) ** 2.6, 0.0)) + 0.001
    out = np.linspace(0.0, 1.0, rows)[:, None]
    forward = np.stack([0.30 * np.sin(around), np.full(columns, -0.13), np.ones(columns)], axis=-1)
    grid = start + out[..., None] * (reach[:, None] * forward)
    # The sides droop, as a brim bent in the hands does.
    grid[..., 1] -= out * (0.012 * np.abs(side) ** 2 + 0.006 * out)
    upper = head.world(MIDDLE + grid).reshape(-1, 3)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    face = np.concatenate(
        [np.stack([a, d, c], -1).reshape(-1, 3), np.stack([a, c, b], -1).reshape(-1, 3)]
    )
    n = len(upper)
    lower = upper - 0.003 * normals(upper, face)
    border = np.concatenate([at[0, ::-1], at[1:, 0], at[-1, 1:], at[-2:0:-1, -1]])
    after = np.roll(border, -1)
    rim = np.concatenate(
        [np.stack([border, border + n, after + n], -1), np.stack([border, after + n, after], -1)]
    )
    u = np.broadcast_to(0.5 + 0.24 * side, (rows, columns))
    uv = cell("cap", u.ravel(), np.repeat(0.96 * CROWN * (1 - out), columns, axis=1).ravel())
    uv = np.concatenate([uv, uv])
    faces = np.concatenate([face, face[:, ::-1] + n, rim])
    return Piece(np.concatenate([upper, lower]), faces, uv[faces])


def _brim_fit(head: Head, around: np.ndarray) -> np.ndarray:
    whole = np.linspace(-np.pi, np.pi, ROUND, endpoint=False)
    level = _cap_edge(whole) + 0.03
    levels = np.stack([level - 0.02, level, level + 0.02])
    fit = _fit(head, np.broadcast_to(whole, levels.shape), levels)[1]
    return np.interp(around, whole, fit)


def _top_button(head: Head) -> Piece:
    """The cloth-covered button where the panels meet."""
    top = head.reach(np.array([[0.0, 1.0, 0.0]]))[0] + 0.0065
    rows, columns = 6, 20
    around = np.linspace(-np.pi, np.pi, columns, endpoint=False)
    up = np.linspace(-0.4, 1.45, rows)
    around, up = np.meshgrid(around, up)
    grid = _directions(around, up) * [0.0080, 0.0055, 0.0080] + [0.0, top, 0.0]
    u = np.full((rows, columns + 1), 0.30)
    return _closed(head.world(MIDDLE + grid), u, np.full((rows, columns + 1), 0.6))
