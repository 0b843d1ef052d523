"""How deep one limb of a posed bare body stands inside another part of it."""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from subjects.open.base import surface
from subjects.open.base.subdivision import triangles
from subjects.open.base.template import BODY, bone_weights, template

PARTS: dict[str, tuple[str, ...]] = {
    "upper arm": ("upperarm",),
    "forearm": ("lowerarm", "wrist", "finger", "metacarpal"),
    "thigh": ("upperleg",),
    "shin": ("lowerleg", "foot", "toe"),
}
JOINT_ZONE = 0.06
"""Metres on the template: skin this near to the other part at rest folds and does not count."""
ALLOWED = 0.005
"""Metres: deeper than this a pose is rejected; soft tissue gives way this much."""


@lru_cache(maxsize=1)
def _labels() -> tuple[list[str], np.ndarray]:
    """Part names and the part of each base-mesh vertex."""
    index, weight, bones = bone_weights()
    names = ["trunk"]
    bone_part = np.zeros(len(bones), dtype=int)
    for part, prefixes in PARTS.items():
        for side in ("L", "R"):
            names.append(f"{part} {side}")
            for k, bone in enumerate(bones):
                if bone.startswith(prefixes) and bone.endswith(side):
                    bone_part[k] = len(names) - 1
    share = np.stack(
        [np.where(bone_part[index] == k, weight, 0).sum(axis=1) for k in range(len(names))]
    )
    return names, share.argmax(axis=0)


@lru_cache(maxsize=1)
def _parts() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, faces (F, 3) and vertices (K,) of each part; the faces are those it touches."""
    names, label = _labels()
    faces = triangles(template().groups[BODY].quads)
    owner = np.where(
        label[faces[:, 0]] == label[faces[:, 1]], label[faces[:, 0]], label[faces[:, 2]]
    )
    return [(name, faces[owner == k], np.unique(faces[owner == k])) for k, name in enumerate(names)]


@lru_cache(maxsize=1)
def _tested() -> list[tuple[int, int, np.ndarray]]:
    """Pairs (tested part, solid part) and the vertices of the first far from the second at rest."""
    parts, rest = _parts(), template().vertices
    trees = [cKDTree(rest[vertices]) for _, _, vertices in parts]
    result = []
    for a, b in permutations(range(len(parts)), 2):
        vertices = parts[a][2]
        far = trees[b].query(rest[vertices])[0] > JOINT_ZONE
        if far.any():
            result.append((a, b, vertices[far]))
    return result


def _caps(faces: np.ndarray) -> list[np.ndarray]:
    """The border loops of `faces`, each as directed edges (E, 2) that close it."""
    border = surface.border(faces)[:, ::-1]
    if len(border) == 0:
        return []
    size = int(border.max()) + 1
    graph = coo_matrix((np.ones(len(border)), (border[:, 0], border[:, 1])), shape=(size, size))
    component = connected_components(graph, directed=False)[1][border[:, 0]]
    return [border[component == k] for k in np.unique(component)]


@lru_cache(maxsize=1)
def _part_caps() -> list[list[np.ndarray]]:
    return [_caps(faces) for _, faces, _ in _parts()]


def solid_angle_winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How often the triangles (F, 3, 3) wind around each of `points` (P, 3), to rounding.

    They are corners and no mesh, so a part's lids need no vertices of their own;
    `measure.winding_numbers` counts exactly, but asks for a mesh that closes.

    Source: van Oosterom and Strackee 1983, the solid angle of a triangle.
    """
    result = np.zeros(len(points))
    for start in range(0, len(points), 64):
        a, b, c = (corners[None, :, k] - points[start : start + 64, None] for k in range(3))
        la, lb, lc = (np.sqrt((v * v).sum(axis=2)) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=2)
        below = (
            la * lb * lc
            + (a * b).sum(axis=2) * lc
            + (b * c).sum(axis=2) * la
            + (c * a).sum(axis=2) * lb
        )
        result[start : start + 64] = np.arctan2(volume, below).sum(axis=1) / (2 * np.pi)
    return result


def penetration(vertices: np.ndarray) -> tuple[float, str]:
    """Depth in metres of the deepest vertex inside another part, and the parts' names.

    Args:
        vertices: (19158, 3) posed base mesh, metres.
    """
    parts, caps = _parts(), _part_caps()
    worst, where = 0.0, "none"
    for a, b, tested in _tested():
        name, faces, members = parts[b]
        low, high = vertices[members].min(axis=0), vertices[members].max(axis=0)
        points = vertices[tested]
        inside = ((points > low) & (points < high)).all(axis=1)
        points = points[inside]
        if len(points) == 0:
            continue
        solid = vertices[faces]
        # Only a point within a hand's breadth can be inside a limb; the trunk is thicker.
        tree = cKDTree(vertices[members])
        distance, nearest = tree.query(points)
        points, nearest = points[distance < 0.15], nearest[distance < 0.15]
        if len(points) == 0:
            continue
        normals = np.zeros_like(vertices)
        face_normals = np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0])
        for k in range(3):
            np.add.at(normals, faces[:, k], face_normals)
        normal = normals[members[nearest]]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        depth = -((points - vertices[members[nearest]]) * normal).sum(axis=1)
        # From the deepest down: the first that is inside is the figure.
        order = np.argsort(-depth)
        order = order[depth[order] > worst]
        lids = [
            np.concatenate(
                [
                    vertices[loop],
                    np.broadcast_to(vertices[loop].mean(axis=(0, 1)), (len(loop), 1, 3)),
                ],
                axis=1,
            )
            for loop in caps[b]
        ]
        closed = np.concatenate([solid, *lids])
        for start in range(0, len(order), 16):
            some = order[start : start + 16]
            wound = solid_angle_winding(points[some], closed) > 0.5
            if wound.any():
                worst, where = float(depth[some][wound].max()), f"{parts[a][0]} in {name}"
                break
    return worst, where
