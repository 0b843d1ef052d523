"""What is measured on a dressed human: cloth inside the body, and folds.

Both measures follow lines along z in double precision. Faces that share an edge share the test of
which side a line passes it on, so the count of what a line goes through is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from subjects.crossings import Crossings, crossings
from subjects.open.base import surface
from subjects.open.base.surface import Piece


@dataclass(frozen=True)
class Fold:
    """How far a garment's surface turns away from the body's.

    Attributes:
        angle_deg: mean angle between the normals of the two; 0 is a second skin.
        pixels: how many it is the mean of.
    """

    angle_deg: float
    pixels: int


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
    met = crossings(points[near, :2], vertices, faces)
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
    bare = crossings(grid, body_vertices, body_faces)
    covered = np.unique(bare.line)
    worn = crossings(grid[covered], whole.vertices, whole.faces)
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


def _first(met: Crossings, towards: int) -> np.ndarray:
    """Of each line that meets anything, the crossing with the largest `towards` * z."""
    order = np.lexsort((-towards * met.z, met.line))
    return order[np.unique(met.line[order], return_index=True)[1]]


def _normals_at(
    met: Crossings, chosen: np.ndarray, faces: np.ndarray, normals: np.ndarray, towards: int
) -> np.ndarray:
    """(K, 3) unit normals at the `chosen` crossings, on the side that is seen."""
    mixed = (normals[faces[met.face[chosen]]] * met.weights[chosen][..., None]).sum(axis=1)
    mixed *= (towards * met.sign[chosen])[:, None]
    unit: np.ndarray = mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12)
    return unit
