"""Distances, normal maps and scores against slow, obvious references."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surface.alignment import align, best_similarity
from surface.distances import nearest, sample
from surface.mesh import SurfaceError, TriangleMesh
from surface.normal_maps import castable, encoded, normal_map
from surface.score import ANGLES_DEG, ICON_HEIGHT, score, unit_box
from surface.truth import Truth, exposed

Shapes = Callable[..., TriangleMesh]


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def blob(shapes: Shapes, seed: int = 3) -> TriangleMesh:
    """A lopsided closed surface."""
    mesh = shapes("ball", 1.0, fine=3)
    v = mesh.vertices
    bumps = np.random.default_rng(seed).normal(size=(5, 3))
    height = 1 + 0.15 * np.cos(3 * v @ bumps.T).sum(axis=1)
    return TriangleMesh(v * height[:, None] * [0.4, 0.9, 0.3] + [0.1, 0.8, -2], mesh.faces)


def distance_to_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """By the plane where the foot lies inside, else by the three edges."""
    normal = np.cross(b - a, c - a)
    foot = p - normal * (normal @ (p - a)) / (normal @ normal)
    inside = all(normal @ np.cross(y - x, foot - x) >= 0 for x, y in ((a, b), (b, c), (c, a)))
    if inside:
        return float(np.linalg.norm(p - foot))
    edges = []
    for x, y in ((a, b), (b, c), (c, a)):
        along = np.clip((p - x) @ (y - x) / ((y - x) @ (y - x)), 0, 1)
        edges.append(float(np.linalg.norm(p - x - along * (y - x))))
    return min(edges)


def test_distances_are_those_of_brute_force(shapes: Shapes) -> None:
    mesh = blob(shapes)
    low, high = mesh.bounds
    points = np.concatenate(
        [
            rng().uniform(low - 0.3, high + 0.3, (60, 3)),
            mesh.vertices[::97] * 1.01,
            mesh.vertices[::131],
        ]
    )
    off, closest = nearest(points, mesh)
    triangles = mesh.vertices[mesh.faces]
    slow = [min(distance_to_triangle(p, *t) for t in triangles) for p in points]
    np.testing.assert_allclose(off, slow, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(points - closest, axis=1), off, atol=1e-9)


def test_samples_lie_on_the_surface_and_are_spread_by_area(shapes: Shapes) -> None:
    mesh = shapes("box", (1.0, 2.0, 4.0))
    points = sample(mesh, 20_000, rng())
    assert nearest(points, mesh)[0].max() < 1e-12
    # Each pair of sides has its share of the area.
    for axis, half, area in ((0, 0.5, 16), (1, 1.0, 8), (2, 2.0, 4)):
        share = (np.abs(np.abs(points[:, axis]) - half) < 1e-9).mean()
        assert share == pytest.approx(area / 28, abs=1e-3)


def slow_normal_map(mesh: TriangleMesh, angle_deg: float, half: float, size: int) -> np.ndarray:
    """Every ray against every triangle, with normals weighted by the faces' angles; encoded."""
    turn = Rotation.from_euler("y", -angle_deg, degrees=True)
    v = turn.apply(mesh.vertices)  # the camera goes round by an angle: the surface goes back by it
    normal = np.zeros_like(v)
    for face in mesh.faces:
        for k in range(3):
            a, b, c = (v[face[(k + s) % 3]] for s in range(3))
            u, w = (b - a) / np.linalg.norm(b - a), (c - a) / np.linalg.norm(c - a)
            plane = np.cross(u, w)
            normal[face[k]] += plane / np.linalg.norm(plane) * np.arccos(np.clip(u @ w, -1, 1))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    image = np.zeros((size, size, 3))
    a, b, c = (v[mesh.faces[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    for i in range(size):
        for j in range(size):
            x, y = (j + 0.5 - size / 2) * 2 * half / size, (size / 2 - i - 0.5) * 2 * half / size
            wb = ((x - a[:, 0]) * (c[:, 1] - a[:, 1]) - (y - a[:, 1]) * (c[:, 0] - a[:, 0])) / area
            wc = ((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])) / area
            weights = np.stack([1 - wb - wc, wb, wc], axis=1)
            z = np.einsum("fk,fk->f", weights, np.stack([a[:, 2], b[:, 2], c[:, 2]], axis=1))
            z[(weights < 0).any(axis=1)] = -np.inf
            face = int(np.argmax(z))
            if z[face] > -np.inf:
                n = weights[face] @ normal[mesh.faces[face]]
                n /= np.linalg.norm(n)
                plane = np.cross(b[face] - a[face], c[face] - a[face])
                image[i, j] = (n * np.sign(plane[2]) + 1) / 2
    return image


@pytest.mark.parametrize("angle", ANGLES_DEG)
def test_normal_maps_are_those_of_brute_force(shapes: Shapes, angle: int) -> None:
    mesh = blob(shapes).transformed(unit_box(blob(shapes)))
    fast = encoded(*normal_map(castable(mesh), angle, 0.5, 40))
    np.testing.assert_allclose(fast, slow_normal_map(mesh, angle, 0.5, 40), atol=1e-6)


def test_seams_do_not_show_in_normal_maps(shapes: Shapes) -> None:
    mesh = shapes("ball", 0.4, fine=3)
    torn = TriangleMesh(
        mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3)
    )
    maps = [normal_map(castable(m), 30, 0.5, 64)[0] for m in (mesh, torn)]
    np.testing.assert_allclose(maps[0], maps[1], atol=1e-9)


class TestScore:
    def test_is_that_of_brute_force(self, shapes: Shapes) -> None:
        mesh, true = blob(shapes, 4), blob(shapes, 3)
        truth = Truth.of(true, rng(), 100)
        found = score(mesh, truth, rng(), samples=80, size=24)
        boxed, true_boxed = (m.transformed(unit_box(m)) for m in (mesh, true))
        placed = truth.transformed(unit_box(true))

        def mean_distance(points: np.ndarray, to: TriangleMesh) -> float:
            triangles = to.vertices[to.faces]
            return float(
                np.mean([min(distance_to_triangle(p, *t) for t in triangles) for p in points])
            )

        assert found.truth_to_mesh == pytest.approx(
            100 * mean_distance(placed.points, boxed), abs=1e-6
        )
        drawn = sample(boxed, 80, rng())
        assert found.mesh_to_truth == pytest.approx(
            100 * mean_distance(drawn, true_boxed), abs=1e-6
        )
        for angle in ANGLES_DEG:
            maps = [slow_normal_map(m, angle, 0.5, 24) for m in (boxed, true_boxed)]
            slow = ((maps[0] - maps[1]) ** 2).sum(axis=2).mean()
            assert getattr(found, f"l2_{angle}") == pytest.approx(slow, abs=1e-6)

    def test_figures_have_the_conventions_names(self, shapes: Shapes) -> None:
        found = score(
            blob(shapes, 4), Truth.of(blob(shapes), rng(), 500), rng(), samples=500, size=32
        )
        ours = found.figures("paper")
        assert ours["CD"] == found.truth_to_mesh != found.mesh_to_truth
        assert ours["P2S"] == pytest.approx((found.truth_to_mesh + found.mesh_to_truth) / 2)
        angles = [getattr(found, f"l2_{a}") for a in ANGLES_DEG]
        assert ours["L2"] == pytest.approx(np.mean(angles))
        assert (ours["L2 front"], ours["L2 back"]) == (angles[0], angles[2])
        assert ours["L2 front, back"] == pytest.approx((angles[0] + angles[2]) / 2)
        theirs = found.figures("icon")
        assert theirs["P2S"] == found.truth_to_mesh
        assert theirs["Chamfer"] == ours["P2S"]
        assert theirs["Normals"] == pytest.approx(sum(angles))

    @pytest.mark.parametrize("convention", ["paper", "icon", "metric"])
    def test_of_a_mesh_against_itself_is_0(self, shapes: Shapes, convention: str) -> None:
        mesh = blob(shapes)
        found = score(mesh, Truth.of(mesh, rng(), 2000), rng(), convention, samples=2000, size=64)
        assert all(value < 1e-6 for value in found.figures(convention).values())

    def test_of_a_known_shift_is_the_shift(self, shapes: Shapes) -> None:
        """Between parallel plates that face each other: 2 cm off along their normal."""
        plate = shapes("box", (20.0, 20.0, 1e-3))
        moved = TriangleMesh(plate.vertices + np.array([0, 0, 0.02]), plate.faces)
        found = score(
            moved, Truth.of(plate, rng(), 20_000), rng(), "metric", samples=20_000, size=16
        )
        # The nearest of a plate's two sides is its thickness nearer for half of the points.
        assert found.truth_to_mesh == pytest.approx(100 * 0.0195, abs=2e-3)
        assert found.mesh_to_truth == pytest.approx(100 * 0.0195, abs=2e-3)

    def test_of_a_larger_ball_is_the_difference_of_the_radii(self, shapes: Shapes) -> None:
        small, large = (shapes("ball", r, fine=6) for r in (0.5, 0.53))
        found = score(large, Truth.of(small, rng()), rng(), "metric", size=64)
        assert found.truth_to_mesh == pytest.approx(3, rel=2e-3)
        assert found.mesh_to_truth == pytest.approx(3, rel=2e-3)

    def test_the_papers_box_undoes_size_and_place(self, shapes: Shapes) -> None:
        mesh, truth = blob(shapes, 4), Truth.of(blob(shapes), rng(), 3000)
        moved = TriangleMesh(mesh.vertices * 37 + [5, -3, 8], mesh.faces)
        one, other = (score(m, truth, rng(), samples=3000, size=64) for m in (mesh, moved))
        for name, value in one.figures("paper").items():
            assert other.figures("paper")[name] == pytest.approx(value, rel=1e-3)

    def test_icon_scales_the_truth_to_its_height_and_sums_four_angles(self, shapes: Shapes) -> None:
        small, large = (shapes("ball", r, fine=6) for r in (0.5, 0.51))
        found = score(large, Truth.of(small, rng()), rng(), "icon", size=64)
        assert pytest.approx(1.7578125) == ICON_HEIGHT
        assert found.truth_to_mesh == pytest.approx(100 * 0.01 * ICON_HEIGHT, rel=5e-3)

    def test_a_mesh_that_was_moved_turned_and_scaled_is_aligned(self, shapes: Shapes) -> None:
        true = blob(shapes)
        truth = Truth.of(true, rng())
        similarity = np.eye(4)
        similarity[:3, :3] = 1.7 * Rotation.from_euler("xyz", (4, 12, -3), degrees=True).as_matrix()
        similarity[:3, 3] = 0.4, -0.2, 3
        moved = true.transformed(similarity)
        boxed = score(moved, truth, rng(), "paper", samples=5000, size=64)
        laid = score(moved, truth, rng(), "paper", aligned=True, samples=5000, size=64)
        assert boxed.both_ways > 0.5
        assert laid.both_ways < 0.02
        assert laid.l2 < 1e-3 < boxed.l2

    def test_refuses_what_has_no_extent(self, shapes: Shapes) -> None:
        point = TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
        with pytest.raises(SurfaceError, match="no extent"):
            score(point, Truth.of(blob(shapes), rng(), 100), rng())
        line = TriangleMesh(np.array([[0, 0, 0], [0, 1, 0], [0, 2.0, 0]]), np.array([[0, 1, 2]]))
        with pytest.raises(SurfaceError, match="no area"):
            score(line, Truth.of(blob(shapes), rng(), 100), rng())


def test_the_best_similarity_is_recovered_to_rounding() -> None:
    points = rng().normal(size=(50, 3))
    truth = np.eye(4)
    truth[:3, :3] = 0.3 * Rotation.random(random_state=1).as_matrix()
    truth[:3, 3] = 1, 2, 3
    found = best_similarity(points, points @ truth[:3, :3].T + truth[:3, 3])
    np.testing.assert_allclose(found, truth, atol=1e-12)
    mirrored = best_similarity(points, points * [-1, 1, 1])
    assert np.linalg.det(mirrored[:3, :3]) > 0


def test_alignment_does_not_swell_or_shrink_a_mesh_that_lies_right(shapes: Shapes) -> None:
    true = blob(shapes)
    found = align(true, Truth.of(true, rng()), rng())
    np.testing.assert_allclose(found, np.eye(4), atol=1e-3)


class TestTruth:
    def test_what_clothes_cover_is_no_part_of_it(self, shapes: Shapes) -> None:
        coat, body = shapes("ball", 1.0, fine=4), shapes("ball", 0.7, fine=4)
        both = TriangleMesh(
            np.concatenate([coat.vertices, body.vertices]),
            np.concatenate([coat.faces, body.faces + len(coat.vertices)]),
        )
        truth = Truth.of(both, rng(), 2000)
        np.testing.assert_allclose(np.linalg.norm(truth.points, axis=1), 1, atol=0.01)
        assert truth.mesh is both
        assert 2000 < len(truth.points) < 4000  # the coat's share of the area, of twice 2000

    def test_all_of_a_scan_is_in_the_open_its_folds_too(self, shapes: Shapes) -> None:
        mesh = blob(shapes)
        assert exposed(sample(mesh, 2000, rng()), mesh).all()
        # A slot of 2 mm between two plates of 20 cm is seen through its ends alone.
        plates = [shapes("box", (0.2, 0.2, 0.01), (0, 0, z)) for z in (-0.006, 0.006)]
        slot = TriangleMesh(
            np.concatenate([p.vertices for p in plates]),
            np.concatenate([plates[0].faces, plates[1].faces + 8]),
        )
        inner = np.array([[0.0, 0.0, 0.001], [0.0, 0.0, 0.011]])
        assert exposed(inner, slot).tolist() == [False, True]

    def test_moves_with_a_similarity(self, shapes: Shapes) -> None:
        truth = Truth.of(blob(shapes), rng(), 500)
        move = unit_box(truth.mesh)
        moved = truth.transformed(move)
        assert nearest(moved.points, moved.mesh)[0].max() < 1e-9
