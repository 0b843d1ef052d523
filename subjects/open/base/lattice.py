"""Grids of points as surfaces: what every trim is woven from."""

from __future__ import annotations

import numpy as np

from subjects.open.base.atlas import cell
from subjects.open.base.surface import Piece


def woven(
    points: np.ndarray, name: str, uv: np.ndarray | None = None, round_about: bool = False
) -> Piece:
    """A grid of points as a piece in an atlas cell.

    Args:
        points: (R, C, 3) metres. Seen from outside, columns run counter-clockwise from rows: with
            rows upwards, columns run to the left.
        name: the cell.
        uv: (R, C, 2) in the cell; by default columns run along u and rows along v.
        round_about: whether the last row meets the first again.
    """
    rows, columns = points.shape[:2]
    lines = rows + 1 if round_about else rows
    if uv is None:
        v, u = np.meshgrid(np.linspace(0, 1, lines), np.linspace(0, 1, columns), indexing="ij")
    else:
        u, v = np.moveaxis(uv, -1, 0)
    at = np.arange(lines * columns).reshape(lines, columns)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    corners = np.stack(
        [np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2
    ).reshape(-1, 3)
    return Piece(
        points.reshape(-1, 3),
        corners % (rows * columns),
        cell(name, np.clip(u, 0, 1).ravel(), np.clip(v, 0, 1).ravel())[corners],
    )


def normals(points: np.ndarray) -> np.ndarray:
    """(R, C, 3) outward unit normals of a grid (see `woven`)."""
    across = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    return across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)


def shell(points: np.ndarray, thickness: float, name: str) -> Piece:
    """A grid given a thickness: its outside, its inside and the rim between, closed.

    Args:
        points: (R, C, 3) the outside, as in `woven`.
        thickness: metres.
        name: the cell.
    """
    # Evened out, or the inside would turn over where the grid folds sharply.
    out = eased(normals(points), 3)
    out /= np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
    inner = points - thickness * out
    rows, columns = points.shape[:2]
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    uv = np.stack([u, v], axis=-1)
    # The border counter-clockwise seen from outside: its rim shows the border's colours.
    border = np.concatenate(
        [
            np.stack([np.arange(rows - 1), np.zeros(rows - 1, int)], axis=1),
            np.stack([np.full(columns - 1, rows - 1), np.arange(columns - 1)], axis=1),
            np.stack([np.arange(rows - 1, 0, -1), np.full(rows - 1, columns - 1)], axis=1),
            np.stack([np.zeros(columns - 1, int), np.arange(columns - 1, 0, -1)], axis=1),
        ]
    )
    i, j = border.T
    outside = woven(points, name, uv)
    inside = woven(inner[:, ::-1], name, uv[:, ::-1])
    n = rows * columns
    a = i * columns + j
    b = n + i * columns + (columns - 1 - j)
    after_a, after_b = np.roll(a, -1), np.roll(b, -1)
    rim = np.concatenate(
        [np.stack([a, b, after_b], axis=1), np.stack([a, after_b, after_a], axis=1)]
    )
    flat = cell(name, u.ravel(), v.ravel())
    both = np.concatenate([flat, flat.reshape(rows, columns, 2)[:, ::-1].reshape(-1, 2)])
    return Piece(
        np.concatenate([outside.vertices, inside.vertices]),
        np.concatenate([outside.faces, inside.faces + n, rim]),
        np.concatenate([outside.uv, inside.uv, both[rim]]),
    )


def eased(points: np.ndarray, rounds: int, round_about: bool = False) -> np.ndarray:
    """(R, C, ...) smoothed along rows and columns; the border stays, but for a closed one."""
    result = points.copy()
    for _ in range(rounds):
        if round_about:
            result = 0.5 * result + 0.25 * (np.roll(result, 1, 0) + np.roll(result, -1, 0))
        else:
            result[1:-1] = 0.5 * result[1:-1] + 0.25 * (result[:-2] + result[2:])
        result[:, 1:-1] = 0.5 * result[:, 1:-1] + 0.25 * (result[:, :-2] + result[:, 2:])
    return result
