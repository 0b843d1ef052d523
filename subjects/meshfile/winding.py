"""Which way a surface's faces look."""

from __future__ import annotations

import numpy as np

from subjects.mesh import Mesh, MeshError
from subjects.meshfile.joining import first_alike

DISAGREEING_EDGES = 0.01
"""Share of two-faced edges whose faces may run in opposite senses; scans have some flaws."""

OPEN_EDGES = 0.01
"""A mesh with a smaller share of one-faced edges is closed enough for its volume to have a sign."""


def check_winding(mesh: Mesh, *, flip_faces: bool = False) -> None:
    """Refuse a surface whose faces do not all look outwards.

    Args:
        mesh: the surface as its file has it.
        flip_faces: check the surface as it is once its faces are flipped.

    Raises:
        MeshError: more than `DISAGREEING_EDGES` of the edges have faces of opposite senses, or
            the mesh is closed enough to have a volume and the volume is negative.
    """
    lowest, highest = mesh.bounds
    vertices = mesh.vertices - (lowest + highest) / 2
    faces = first_alike(vertices)[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]

    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    uphill = np.sort(2 * edge + (start < end))  # with its sense as the last bit
    first = np.flatnonzero(np.diff(uphill >> 1, prepend=-1))
    uses = np.diff(first, append=len(uphill))
    sense = np.add.reduceat(2 * (uphill & 1) - 1, first)

    shared = uses == 2
    disagree = np.count_nonzero(sense[shared]) / max(np.count_nonzero(shared), 1)
    if disagree > DISAGREEING_EDGES:
        raise MeshError(
            f"at {disagree:.1%} of its edges the two faces wind in opposite senses; "
            "make its normals consistent and export it again"
        )
    corners = vertices[faces]
    volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    if flip_faces:
        volume = -volume
    if np.mean(uses == 1) < OPEN_EDGES and volume < 0:
        raise MeshError(
            f"inside out (its signed volume is {volume:.3g}); "
            f"set subjects.flip_faces: {str(not flip_faces).lower()}"
        )
