"""Parts made one mesh."""

from __future__ import annotations

import numpy as np

from subjects.mesh import Mesh, MeshError
from subjects.meshfile.part import Part

NORMAL_TOLERANCE = 1e-3
"""Unit normals nearer than this are one normal: text files round theirs."""

NORMALS = 1000
"""Most different normals at one place, each takes a round: a cone's tip has a few dozen."""


def joined(parts: list[Part]) -> Mesh:
    """One mesh of all parts, with vertices at one place and of one normal made one."""
    vertices = np.concatenate([part.vertices for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    corners = np.concatenate(
        [part.faces + start for part, start in zip(parts, starts, strict=True)]
    )

    faces = first_alike(vertices, normals)[corners]
    real = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not real.any():
        raise MeshError("has no faces with an area; export a surface, not a point cloud")
    faces, corners = faces[real], corners[real]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    faces = (np.cumsum(used) - 1)[faces]

    uv = None
    if any(part.uv is not None for part in parts):
        plain = np.float32(0)
        uv = np.concatenate(
            [
                np.broadcast_to(plain, (*part.faces.shape, 2)) if part.uv is None else part.uv
                for part in parts
            ]
        )[real]
    materials = list({id(part.material): part.material for part in parts}.values())
    index = {id(material): i for i, material in enumerate(materials)}
    face_material = np.repeat(
        [index[id(part.material)] for part in parts], [len(part.faces) for part in parts]
    )[real]
    colors = _joined_colors(parts)
    return Mesh(
        vertices=vertices[used],
        faces=faces,
        uv=uv,
        materials=tuple(materials),
        face_material=face_material.astype(np.int32),
        vertex_colors=None if colors is None else colors[used],
    )


def _joined_colors(parts: list[Part]) -> np.ndarray | None:
    """(N, 3) uint8 where any part has vertex colours; plain parts take their material's."""
    if all(part.colors is None for part in parts):
        return None
    if any(part.material.texture is not None for part in parts):
        raise MeshError("has textures and vertex colours in turn; bake them into one texture")
    plain = [np.round(np.asarray(part.material.color) * 255).astype(np.uint8) for part in parts]
    return np.concatenate(
        [
            np.broadcast_to(color, part.vertices.shape) if part.colors is None else part.colors
            for part, color in zip(parts, plain, strict=True)
        ]
    )


def first_alike(places: np.ndarray, normals: np.ndarray | None = None) -> np.ndarray:
    """(N,) for each vertex the first at the same place, and of the same normal where given.

    Args:
        places: (N, 3) compared exactly.
        normals: (N, 3) unit or zero, compared to `NORMAL_TOLERANCE`.
    """
    pending = np.lexsort(places.T)
    ordered = places[pending]
    place = np.cumsum((ordered != np.roll(ordered, 1, axis=0)).any(axis=1))
    first = np.empty(len(places), dtype=np.int64)
    for _ in range(NORMALS):
        heads = np.diff(place, prepend=-1) != 0
        head = pending[heads][np.cumsum(heads) - 1]
        if normals is None:
            alike = np.ones(len(pending), dtype=bool)
        else:
            apart = normals[pending] - normals[head]
            alike = np.einsum("ni,ni->n", apart, apart) <= NORMAL_TOLERANCE**2
        first[pending[alike]] = head[alike]
        pending, place = pending[~alike], place[~alike]
        if not len(pending):
            return first
    raise MeshError(f"has over {NORMALS} normals at one place; clean the mesh and export it again")
