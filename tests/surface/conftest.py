"""Surfaces whose every property is known, and whether a mesh is a closed manifold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from surface.mesh import TriangleMesh


def ball(radius: float = 1.0, middle: tuple[float, ...] = (0, 0, 0), fine: int = 4) -> TriangleMesh:
    made = trimesh.creation.icosphere(subdivisions=fine, radius=radius)
    return TriangleMesh(np.asarray(made.vertices) + middle, np.asarray(made.faces, np.int64))


def box(size: tuple[float, ...] = (1, 1, 1), middle: tuple[float, ...] = (0, 0, 0)) -> TriangleMesh:
    made = trimesh.creation.box(size)
    return TriangleMesh(np.asarray(made.vertices) + middle, np.asarray(made.faces, np.int64))


def faults(mesh: TriangleMesh) -> list[str]:
    """Why a mesh is no closed, oriented two-manifold; empty where it is one."""
    found = []
    faces = mesh.faces
    if (faces[:, [0, 1, 2]] == faces[:, [1, 2, 0]]).any():
        found.append("a face names a vertex twice")
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, times = np.unique(directed, axis=0, return_counts=True)
    if (times != 1).any():
        found.append("two faces run along an edge in the same direction")
    _, times = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    if (times != 2).any():
        found.append("an edge has not two faces")
    # The edges opposite of a vertex, in its faces, are one ring.
    ring: dict[int, dict[int, int]] = {}
    for a, b, c in faces.tolist():
        for v, x, y in ((a, b, c), (b, c, a), (c, a, b)):
            ring.setdefault(v, {})[x] = y
    for v, after in ring.items():
        start = node = next(iter(after))
        length = 0
        while length <= len(after):
            node, length = after.get(node, -1), length + 1
            if node == start:
                break
        if length != len(after):
            found.append(f"the faces round vertex {v} are not one fan")
            break
    if len(np.unique(faces)) != len(mesh.vertices):
        found.append("a vertex has no face")
    return found


def euler(mesh: TriangleMesh) -> int:
    edges = np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return len(mesh.vertices) - len(edges) + len(mesh.faces)


def volume(mesh: TriangleMesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6)


@pytest.fixture(scope="session")
def shapes() -> Callable[..., TriangleMesh]:
    """shapes("ball", ...) or shapes("box", ...)."""
    return lambda kind, *arguments, **named: {"ball": ball, "box": box}[kind](*arguments, **named)


@pytest.fixture(scope="session")
def check() -> dict[str, Callable]:
    """ "faults", "euler" and "volume" of a mesh."""
    return {"faults": faults, "euler": euler, "volume": volume}
