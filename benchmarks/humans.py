"""Open humans with as many faces as a scan has, laid out as a folder of scans."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from engine.workers import cpu_count, run
from subjects.mesh import Mesh
from subjects.meshfile import read_mesh
from subjects.open import OpenHumans
from subjects.wavefront import rows, vertex_lines


def write_humans(root: Path, count: int, faces: int) -> list[Path]:
    """The first `count` draft humans of seed 0, cut into `faces` triangles or a few more.

    Returns:
        their OBJ files, each in a folder of its own with its texture and its body.
    """
    jobs = [(root / f"open_{k:04d}", faces) for k in range(count)]
    made = []
    for _, result in run(_write, jobs, jobs=min(count, cpu_count())):
        if isinstance(result, BaseException):
            raise result
        made.append(result)
    return sorted(made)


def _write(job: tuple[Path, int]) -> Path:
    folder, faces = job
    folder.mkdir(parents=True)
    made = folder / "made"
    subject = OpenHumans(cloth="laid").make(folder.name, 0, made)
    path = folder / subject.mesh.name
    mesh = bisected(read_mesh(subject.mesh), faces)
    assert mesh.uv is not None
    texels, corner = np.unique(mesh.uv.reshape(-1, 2), axis=0, return_inverse=True)
    corners = np.stack([mesh.faces, corner.reshape(-1, 3)], axis=-1) + 1
    path.write_text(
        "mtllib material0.mtl\n"
        + vertex_lines(mesh.vertices, 9)
        + rows("vt %.6f %.6f", texels)
        + f"usemtl {_material(made)}\n"
        + rows("f %d/%d %d/%d %d/%d", corners.reshape(-1, 6))
    )
    for name in ("material0.mtl", "material0.jpeg", "body.obj"):
        (made / name).rename(folder / name)
    shutil.rmtree(made)
    return path


def _material(folder: Path) -> str:
    return (folder / "material0.mtl").read_text().split("newmtl ")[1].split()[0]


def bisected(mesh: Mesh, faces: int) -> Mesh:
    """The same surface with at least `faces` triangles: longest edges are halved, in rounds.

    An edge is halved where it is the longest of all triangles that share it, so no triangle is
    cut twice in a round and no vertex lies on a neighbour's edge.
    """
    while len(mesh.faces) < faces:
        mesh = _halve(mesh, faces - len(mesh.faces))
    return mesh


def _halve(mesh: Mesh, wanted: int) -> Mesh:
    """One round: about `wanted` triangles more, the longest edges first."""
    assert mesh.uv is not None
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1), axis=-1)
    edges, edge = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    edge = edge.reshape(-1, 3)
    length = np.linalg.norm(np.diff(mesh.vertices[edges], axis=1)[:, 0], axis=-1)
    # Edges as long as others are told apart by their number, the same for all triangles.
    rank = np.argsort(np.argsort(length, kind="stable"), kind="stable")
    longest = np.argmax(rank[edge], axis=1)
    cut = edge[np.arange(len(edge)), longest]
    shares = np.bincount(edge.ravel(), minlength=len(edges))
    chosen = np.flatnonzero(np.bincount(cut, minlength=len(edges)) == shares)
    chosen = chosen[np.argsort(-length[chosen], kind="stable")]
    chosen = chosen[: np.searchsorted(np.cumsum(shares[chosen]), wanted) + 1]

    middle = np.full(len(edges), -1)
    middle[chosen] = len(mesh.vertices) + np.arange(len(chosen))
    split = np.flatnonzero(middle[cut] >= 0)
    # The cut edge first: corners a, b, c become (m, b, c) and (m, c, a).
    turn = (longest[split, None] + np.arange(3)) % 3
    corners = np.take_along_axis(mesh.faces[split], turn, axis=1)
    uv = np.take_along_axis(mesh.uv[split], turn[..., None], axis=1)
    new, new_uv = middle[cut[split]], (uv[:, 0] + uv[:, 1]) / 2
    kept = np.setdiff1d(np.arange(len(mesh.faces)), split)

    def gathered(old: np.ndarray, own: np.ndarray, at: np.ndarray) -> np.ndarray:
        halves = [np.stack([at, own[:, i], own[:, j]], axis=1) for i, j in ((1, 2), (2, 0))]
        return np.concatenate([old[kept], *halves])

    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, mesh.vertices[edges[chosen]].mean(axis=1)]),
        faces=gathered(mesh.faces, corners, new),
        uv=gathered(mesh.uv, uv, new_uv),
        face_material=np.concatenate([mesh.face_material[i] for i in (kept, split, split)]),
    )
