"""Where lines along z meet a mesh, in double precision.

Faces that share an edge share the test of which side a line passes it on, so what a line goes
through is counted exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

_CHUNK = 1 << 20
"""Pairs of a line and a triangle that are looked at at once."""

_ENTRIES = 1 << 24
"""Pairs of a cell and a triangle that the grid may hold."""


class Crossings(NamedTuple):
    """Where lines along z meet triangles.

    Attributes:
        line: (K,) int, ascending.
        face: (K,) int.
        weights: (K, 3) float64 of the face's corners, between 0 and 1.
        z: (K,) float64.
        sign: (K,) +1 where the face looks towards +z, else -1.
    """

    line: np.ndarray
    face: np.ndarray
    weights: np.ndarray
    z: np.ndarray
    sign: np.ndarray


def crossings(xy: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> Crossings:
    """Where the lines along z through `xy` (P, 2) meet the triangles.

    No line slips between two faces that share an edge by their vertices' numbers, or meets both.
    """
    found = [
        _met(xy[lines], lines, candidates, vertices, faces)
        for lines, candidates in _candidates(xy, vertices[faces][..., :2])
    ]
    parts = (np.concatenate(part) for part in zip(*found, strict=True))
    return Crossings(*parts)


def _met(
    xy: np.ndarray, line: np.ndarray, face: np.ndarray, vertices: np.ndarray, faces: np.ndarray
) -> Crossings:
    """Those of the pairs of a line (K,), at `xy` (K, 2), and a face (K,) that do meet."""
    corner = faces[face]
    doubled, left = np.empty((len(face), 3)), np.empty((len(face), 3), dtype=bool)
    for k in range(3):
        a, b = corner[:, (k + 1) % 3], corner[:, (k + 2) % 3]
        turned = a > b
        a, b = np.where(turned, b, a), np.where(turned, a, b)
        along, to = vertices[b, :2] - vertices[a, :2], xy - vertices[a, :2]
        cross = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
        # On the edge itself, the line is taken to pass a hair to the right, and less upwards.
        hair = (along[:, 1] < 0) | ((along[:, 1] == 0) & (along[:, 0] > 0))
        left[:, k] = ((cross > 0) | ((cross == 0) & hair)) ^ turned
        doubled[:, k] = np.abs(cross)
    hit = (left[:, 0] == left[:, 1]) & (left[:, 1] == left[:, 2])
    weights = doubled[hit] / np.maximum(doubled[hit].sum(axis=1, keepdims=True), 1e-300)
    z = (weights * vertices[corner[hit], 2]).sum(axis=1)
    return Crossings(line[hit], face[hit], weights, z, np.where(left[hit, 0], 1, -1))


def _candidates(xy: np.ndarray, corners: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pairs (line, face), in chunks: the faces whose box touches the cell that the line is in."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    boxes = corners.max(axis=1) - corners.min(axis=1)
    cells = max(int(np.sqrt(len(corners))), 1)
    # Large faces lie in many cells each.
    while (
        cells > 1 and (boxes * cells / np.maximum(high - low, 1e-12) + 1).prod(1).sum() > _ENTRIES
    ):
        cells //= 2
    side = np.maximum((high - low) / cells, 1e-12)
    inside = np.flatnonzero(((xy >= low) & (xy <= high)).all(axis=1))

    def cell(at: np.ndarray) -> np.ndarray:
        return np.clip(((at - low) / side).astype(np.int64), 0, cells - 1)

    first, last = cell(corners.min(axis=1)), cell(corners.max(axis=1))
    width, height = (last - first + 1).T
    face, step = _spread(width * height)
    at = first[face] + np.stack([step % width[face], step // width[face]], axis=1)
    code = at[:, 1] * cells + at[:, 0]
    face = face[np.argsort(code, kind="stable")]
    count = np.bincount(code, minlength=cells * cells)
    start = np.cumsum(count) - count

    column, row = cell(xy[inside]).T
    home = row * cells + column
    chunk = np.cumsum(count[home]) // _CHUNK
    for part in np.split(np.arange(len(home)), np.flatnonzero(np.diff(chunk)) + 1):
        line, step = _spread(count[home[part]])
        line = part[line]
        yield inside[line], face[start[home[line]] + step]


def _spread(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts (2, 0, 3): items (0, 0, 2, 2, 2) and their steps (0, 1, 0, 1, 2)."""
    item = np.repeat(np.arange(len(count)), count)
    return item, np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)


def extents(
    xy: np.ndarray, vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) highest and lowest z where the lines through `xy` (P, 2) meet the mesh; else NaN."""
    met = crossings(xy, vertices, faces)
    highest, lowest = np.full(len(xy), -np.inf), np.full(len(xy), np.inf)
    np.maximum.at(highest, met.line, met.z)
    np.minimum.at(lowest, met.line, met.z)
    missed = highest < lowest
    highest[missed] = lowest[missed] = np.nan
    return highest, lowest
