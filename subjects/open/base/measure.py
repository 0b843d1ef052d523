"""What is measured on a dressed human: cloth inside the body, and folds.

Both measures follow lines along z in double precision. Faces that share an edge share the test of
which side a line passes it on, so the count of what a line goes through is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from subjects.open.base import surface
from subjects.open.base.surface import Piece

_CHUNK = 1 << 20
"""Pairs of a line and a triangle that are looked at at once."""


@dataclass(frozen=True)
class Fold:
    """How far a garment's surface turns away from the body's.

    Attributes:
        angle_deg: mean angle between the normals of the two; 0 is a second skin.
        pixels: how many it is the mean of.
    """

    angle_deg: float
    pixels: int


class _Crossings(NamedTuple):
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


def through_share(
    garment_vertices: np.ndarray,
    garment_faces: np.ndarray,
    solid_vertices: np.ndarray,
    solid_faces: np.ndarray,
) -> float:
    """Share of a garment's area that lies inside a solid; a triangle lies where its centroid does.

    Args:
        garment_vertices: (N, 3) metres.
        garment_faces: (F, 3) int; of the cloth alone: a hem's lining may reach into the body.
        solid_vertices: (M, 3) metres.
        solid_faces: (G, 3) int, closed, counter-clockwise seen from outside. Parts of the solid
            may overlap: what is inside any of them is inside.

    Raises:
        ValueError: the solid is not closed, or the garment has no area.
    """
    corners = garment_vertices[garment_faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    if not area.sum() > 0:
        raise ValueError("the garment has no area")
    centroids = corners.mean(axis=1)
    inside = winding_numbers(centroids, solid_vertices, solid_faces) > 0
    return float(area[inside].sum() / area.sum())


def winding_numbers(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(P,) int: how often a closed mesh winds around each of `points`, 0 outside.

    It is the number of outward crossings above a point along z less that of the inward ones.

    Args:
        points: (P, 3).
        vertices: (N, 3).
        faces: (F, 3) int, counter-clockwise seen from outside.

    Raises:
        ValueError: the mesh is not closed.
    """
    size = np.int64(len(vertices))
    start, end = faces.astype(np.int64).ravel(), np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    if not np.array_equal(np.sort(start * size + end), np.sort(end * size + start)):
        raise ValueError("the solid is not closed: an edge lacks a face that runs the other way")
    result = np.zeros(len(points), dtype=np.int64)
    low, high = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
    near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    met = _crossings(points[near, :2], vertices, faces)
    above = met.z > points[near, 2][met.line]
    np.add.at(result, near[met.line[above]], met.sign[above])
    return result


def fold_angles(
    pieces: Mapping[str, Piece],
    body_vertices: np.ndarray,
    body_faces: np.ndarray,
    pixel: float = 0.005,
) -> dict[str, Fold]:
    """How far each piece of a dressed human turns away from the bare body under it.

    Both are seen orthographically from the front and from the back; a pixel counts for the piece
    that its centre shows first, if the body is there as well. Normals are interpolated between
    the vertices, and those of a face seen from behind are turned round.

    Args:
        pieces: name -> piece: all of the surface, since one hides another.
        body_vertices: (N, 3) metres, y up, facing +z, in the pieces' frame.
        body_faces: (F, 3) int.
        pixel: side of a pixel, metres.

    Returns:
        name -> Fold, of the pieces that are seen before the body.
    """
    names = list(pieces)
    label = np.repeat(np.arange(len(names)), [len(pieces[name].faces) for name in names])
    whole = surface.joined([pieces[name] for name in names])
    low, high = body_vertices[:, :2].min(axis=0), body_vertices[:, :2].max(axis=0)
    # Edges of pixels lie at whole multiples of their side, so a wider body keeps the same grid.
    first, last = np.floor(low / pixel), np.ceil(high / pixel)
    x, y = ((np.arange(first[k], last[k]) + 0.5) * pixel for k in range(2))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    bare = _crossings(grid, body_vertices, body_faces)
    covered = np.unique(bare.line)
    worn = _crossings(grid[covered], whole.vertices, whole.faces)
    bare_normals = surface.normals(body_vertices, body_faces)
    worn_normals = surface.normals(whole.vertices, whole.faces)

    angle_sum, count = np.zeros(len(names)), np.zeros(len(names), dtype=np.int64)
    for towards in (1, -1):
        below, over = _first(bare, towards), _first(worn, towards)
        below = below[np.searchsorted(bare.line[below], covered[worn.line[over]])]
        cosine = (
            _normals_at(bare, below, body_faces, bare_normals, towards)
            * _normals_at(worn, over, whole.faces, worn_normals, towards)
        ).sum(axis=1)
        of = label[worn.face[over]]
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        angle_sum += np.bincount(of, weights=angle, minlength=len(names))
        count += np.bincount(of, minlength=len(names))
    return {
        name: Fold(float(angle_sum[k] / count[k]), int(count[k]))
        for k, name in enumerate(names)
        if count[k]
    }


def _first(met: _Crossings, towards: int) -> np.ndarray:
    """Of each line that meets anything, the crossing with the largest `towards` * z."""
    order = np.lexsort((-towards * met.z, met.line))
    return order[np.unique(met.line[order], return_index=True)[1]]


def _normals_at(
    met: _Crossings, chosen: np.ndarray, faces: np.ndarray, normals: np.ndarray, towards: int
) -> np.ndarray:
    """(K, 3) unit normals at the `chosen` crossings, on the side that is seen."""
    mixed = (normals[faces[met.face[chosen]]] * met.weights[chosen][..., None]).sum(axis=1)
    mixed *= (towards * met.sign[chosen])[:, None]
    unit: np.ndarray = mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12)
    return unit


def _crossings(xy: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> _Crossings:
    """Where the lines along z through `xy` (P, 2) meet the triangles.

    No line slips between two faces that share an edge by their vertices' numbers, or meets both.
    """
    found = [
        _met(xy[lines], lines, candidates, vertices, faces)
        for lines, candidates in _candidates(xy, vertices[faces][..., :2])
    ]
    parts = (np.concatenate(part) for part in zip(*found, strict=True))
    return _Crossings(*parts)


def _met(
    xy: np.ndarray, line: np.ndarray, face: np.ndarray, vertices: np.ndarray, faces: np.ndarray
) -> _Crossings:
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
    return _Crossings(line[hit], face[hit], weights, z, np.where(left[hit, 0], 1, -1))


def _candidates(xy: np.ndarray, corners: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs (line, face), in chunks: the faces whose box touches the cell that the line is in."""
    cells = max(int(np.sqrt(len(corners))), 1)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
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
    pairs = []
    for part in np.split(np.arange(len(home)), np.flatnonzero(np.diff(chunk)) + 1):
        line, step = _spread(count[home[part]])
        line = part[line]
        pairs.append((inside[line], face[start[home[line]] + step]))
    return pairs


def _spread(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts (2, 0, 3): items (0, 0, 2, 2, 2) and their steps (0, 1, 0, 1, 2)."""
    item = np.repeat(np.arange(len(count)), count)
    return item, np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
