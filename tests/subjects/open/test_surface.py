"""Cutting, sewing, refining and smoothing of cloth, on shapes whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy import sparse

from subjects.open.base import surface
from subjects.open.base.subdivision import loop
from subjects.open.base.surface import Pattern

SIDE = 11


def grid(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """A flat unit square of triangles: (N, 2) points, (F, 3) faces counter-clockwise from +z."""
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    return np.stack([x.ravel(), y.ravel()], axis=1), faces


def tube(heights: np.ndarray, around: int) -> tuple[np.ndarray, np.ndarray]:
    """An open tube of radius 1 about y, its faces outwards."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    ring = np.stack([np.sin(angle), np.zeros(around), np.cos(angle)], axis=1)
    vertices = (ring[None] + heights[:, None, None] * [0.0, 1.0, 0.0]).reshape(-1, 3)
    i, j = np.mgrid[: len(heights) - 1, :around]
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.stack([np.stack([a, b, b + around], -1), np.stack([a, b + around, a + around], -1)])
    return vertices, faces.reshape(-1, 3)


@pytest.mark.parametrize("slope", [0.0, 0.37])
def test_a_cut_follows_the_line_without_slivers_and_takes_the_chart_along(slope: float) -> None:
    at, faces = grid()
    uv = (at * [0.5, 0.25] + 0.1)[faces]
    field = at[:, 0] + slope * at[:, 1] - 0.5049
    cut = surface.cut(sparse.identity(len(at), format="csr"), faces, uv, field)
    points = cut.matrix @ at
    line = points @ [1.0, slope] - 0.5049
    assert line.max() < 1e-9
    border = surface.on_border(cut.faces)
    hem = border & (np.abs(points - 0.5) < 0.499).all(axis=1)
    assert hem.any()
    assert np.abs(line[hem]).max() < 1e-9
    # What is left of the line is all there, once.
    solid = trimesh.Trimesh(np.pad(points, ((0, 0), (0, 1))), cut.faces, process=False)
    assert solid.area == pytest.approx(0.5049 - slope / 2, abs=1e-9 if slope == 0 else 1e-3)
    longest = np.linalg.norm(np.diff(points[cut.faces][:, [0, 1, 2, 0]], axis=1), axis=2).max(1)
    height = 2 * solid.area_faces / longest
    assert height.min() > 0.15 / (SIDE - 1)
    np.testing.assert_allclose(cut.uv, (points * [0.5, 0.25] + 0.1)[cut.faces], atol=1e-12)


def test_without_moving_vertices_the_same_cut_has_slivers(monkeypatch) -> None:
    """The measure above can fail."""
    monkeypatch.setattr(surface, "NEAR_HEM", 0.0)
    at, faces = grid()
    field = at[:, 0] - 0.5049
    cut = surface.cut(sparse.identity(len(at), format="csr"), faces, at[faces], field)
    points = cut.matrix @ at
    solid = trimesh.Trimesh(np.pad(points, ((0, 0), (0, 1))), cut.faces, process=False)
    assert solid.area_faces.min() < 0.05 * np.median(solid.area_faces)


def test_loop_keeps_a_plane_and_rounds_an_octahedron() -> None:
    at, faces = grid(5)
    matrix, fine, uv = loop(faces, at[faces])
    points = matrix @ at
    assert len(fine) == 4 * len(faces)
    assert np.asarray(matrix.sum(axis=1)).ravel() == pytest.approx(1.0)
    solid = trimesh.Trimesh(np.pad(points, ((0, 0), (0, 1))), fine, process=False)
    # The corners are rounded off, as cubic B-splines are; nothing folds over.
    assert 0.98 < solid.area < 1.0
    assert (solid.face_normals[:, 2] > 0.99).all()
    np.testing.assert_allclose(uv[0], [at[faces[0, 0]], *(at[faces[0, :1]] + at[faces[0, 1:]]) / 2])

    ball = trimesh.creation.icosphere(subdivisions=0)
    matrix, fine, _ = loop(np.asarray(ball.faces), np.zeros((len(ball.faces), 3, 2)))
    rounder = trimesh.Trimesh(matrix @ ball.vertices, fine, process=False)
    assert rounder.is_watertight
    radius = np.linalg.norm(rounder.vertices, axis=1)
    assert np.ptp(radius) < 0.05
    assert 0.6 < radius.mean() < 1.0


def test_two_tubes_are_sewn_into_one_with_every_face_outwards() -> None:
    lower, lower_faces = tube(np.linspace(0, 1, 4), 20)
    upper, upper_faces = tube(np.linspace(1.1, 2, 4), 33)
    rims = []
    for vertices, faces, height in ((upper, upper_faces, 1.1), (lower, lower_faces, 1.0)):
        start = int(np.flatnonzero(np.isclose(vertices[:, 1], height))[0])
        loop_ = surface.rim(faces, start)
        assert np.allclose(vertices[loop_, 1], height)
        z, x = vertices[loop_][:, [2, 0]].T
        turn = (z * np.roll(x, -1) - x * np.roll(z, -1)).sum()
        rims.append(loop_ if turn > 0 else np.roll(loop_[::-1], 1))
    every = sparse.identity(len(upper) + len(lower), format="csr")
    both = [
        Pattern(rows, f, np.zeros((len(f), 3, 2)))
        for rows, f in ((every[: len(upper)], upper_faces), (every[len(upper) :], lower_faces))
    ]
    whole = surface.sewn(both[0], both[1], (rims[0], rims[1]))
    vertices = np.concatenate([upper, lower])
    assert len(whole.faces) == len(upper_faces) + len(lower_faces) + 20 + 33
    mesh = trimesh.Trimesh(vertices, whole.faces, process=False)
    assert mesh.is_winding_consistent
    outward = (mesh.triangles_center * [1, 0, 1] * mesh.face_normals).sum(axis=1)
    assert outward.min() > 0.5
    # Two open rims are left of four.
    assert surface.on_border(whole.faces).sum() == 20 + 33


def test_smoothing_flattens_a_bump_and_lets_no_print_creep() -> None:
    at, faces = grid(15)
    uneven = np.pad(at**1.6, ((0, 0), (0, 1)))
    mean = surface.averaging(faces, len(uneven))
    flat = surface.evened(uneven, faces, mean, uneven, 30)
    np.testing.assert_allclose(flat, uneven, atol=1e-12)
    # Plain averaging does let it creep.
    crept = uneven.copy()
    for _ in range(30):
        crept = 0.5 * crept + 0.5 * (mean @ crept)
    assert np.linalg.norm(crept - uneven, axis=1).max() > 0.01

    bumpy = uneven + [0.0, 0.0, 0.05] * (np.arange(len(at)) == 7 * 15 + 7)[:, None]
    smooth = surface.evened(bumpy, faces, mean, bumpy, 30)
    assert smooth[:, 2].max() < 0.01
    held = surface.evened(bumpy, faces, mean, bumpy, 30, where=np.zeros(len(at)))
    assert (held == bumpy).all()
