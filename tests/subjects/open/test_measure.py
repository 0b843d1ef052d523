"""Measures against solids and surfaces whose figures are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from subjects.open.base.measure import fold_angles, through_share, winding_numbers
from subjects.open.base.surface import Piece
from subjects.open.bodies.penetration import solid_angle_winding

TURN = Rotation.from_euler("xyz", (17, 23, 31), degrees=True).as_matrix()


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def piece(mesh: trimesh.Trimesh) -> Piece:
    return Piece(np.array(mesh.vertices), np.array(mesh.faces), np.zeros((len(mesh.faces), 3, 2)))


def sheet(width: float, height: float, z: float, tilt_deg: float = 0.0, n: int = 40) -> Piece:
    """A flat sheet that looks towards +z, its upper edge then tilted towards the viewer."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
    flat = np.stack([width * u.ravel(), height * v.ravel(), np.zeros(n * n)], axis=1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n], axis=1),
            np.stack([corner + 1, corner + n + 1, corner + n], axis=1),
        ]
    )
    turned = flat @ Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix().T
    return Piece(turned + np.array([0, 0, z]), faces, np.zeros((len(faces), 3, 2)))


def test_a_ball_sunk_to_a_quarter_has_a_quarter_of_its_area_inside() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    # A cap's share of a sphere is its height's of the diameter: Archimedes.
    ground = box((-1, -2, -1), (1, -0.05, 1))
    for turn in (np.eye(3), TURN):
        mesh = (ball.vertices @ turn.T, ball.faces, ground.vertices @ turn.T, ground.faces)
        assert through_share(*mesh) == pytest.approx(0.25, abs=0.004)


def test_a_sleeve_that_runs_through_another_limb_counts_by_its_length_inside() -> None:
    sleeve = trimesh.creation.cylinder(radius=0.05, height=1.0, sections=60)
    sleeve = sleeve.subdivide_to_size(0.01)
    trunk = box((-0.2, -0.2, -0.1), (0.2, 0.2, 0.3))
    arm = trimesh.creation.cylinder(radius=0.04, height=1.2, sections=60)
    solid = trimesh.util.concatenate([arm, trunk])
    side = 2 * np.pi * 0.05
    inside = side * 0.4
    whole = side + 2 * np.pi * 0.05**2
    # The sleeve's lids lie in the arm, which goes on beyond them, but for their outer ring.
    inside += 2 * np.pi * 0.04**2
    share = through_share(sleeve.vertices, sleeve.faces, solid.vertices, solid.faces)
    assert share == pytest.approx(inside / whole, abs=0.01)


def test_cloth_outside_and_in_a_hollow_of_the_solid_is_not_inside() -> None:
    ring = trimesh.creation.torus(0.3, 0.1, major_sections=64, minor_sections=32)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.15)
    assert through_share(ball.vertices, ball.faces, ring.vertices, ring.faces) == 0.0
    beyond = ball.vertices + np.array([5.0, 0.0, 0.0])
    assert through_share(beyond, ball.faces, ring.vertices, ring.faces) == 0.0
    within = 0.5 * ball.vertices + np.array([0.3, 0.0, 0.0])
    assert through_share(within, ball.faces, ring.vertices, ring.faces) == 1.0


def test_windings_agree_with_the_solid_angle_and_count_overlaps() -> None:
    left, right = (trimesh.creation.icosphere(subdivisions=3) for _ in range(2))
    right.apply_translation([0.7, 0.2, 0.1])
    solid = trimesh.util.concatenate([left, right])
    points = np.random.default_rng(4).uniform(-1.2, 1.9, (4000, 3))
    found = winding_numbers(points, solid.vertices, solid.faces)
    assert found.tolist() == np.rint(solid_angle_winding(points, solid.triangles)).tolist()
    assert set(found.tolist()) == {0, 1, 2}
    # A garment in both at once is inside once.
    small = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    vertices = small.vertices + np.array([0.35, 0.1, 0.05])
    assert through_share(vertices, small.faces, solid.vertices, solid.faces) == 1.0


def test_no_line_slips_between_faces_at_their_edges_and_corners() -> None:
    # Vertices on whole millimetres, points under vertices, edges and diagonals all the same.
    solid = box((-0.01, -0.01, -0.01), (0.01, 0.01, 0.01)).subdivide().subdivide().subdivide()
    vertices = np.rint(solid.vertices / 0.00125)
    assert len(np.unique(vertices, axis=0)) == len(solid.vertices)
    for order in (slice(None), np.random.default_rng(1).permutation(len(vertices))):
        numbers = np.arange(len(vertices))[order]
        faces = np.argsort(numbers)[solid.faces]
        points = np.stack(np.meshgrid(*3 * [np.arange(-7.0, 8.0)]), axis=-1).reshape(-1, 3)
        assert (winding_numbers(points, vertices[numbers], faces) == 1).all()


def test_an_open_solid_and_a_garment_of_nothing_are_refused() -> None:
    ball = trimesh.creation.icosphere(subdivisions=1)
    with pytest.raises(ValueError, match="not closed"):
        through_share(ball.vertices, ball.faces, ball.vertices, ball.faces[1:])
    flipped = ball.faces.copy()
    flipped[3] = flipped[3, ::-1]
    with pytest.raises(ValueError, match="not closed"):
        winding_numbers(np.zeros((1, 3)), ball.vertices, flipped)
    with pytest.raises(ValueError, match="no area"):
        through_share(np.zeros((3, 3)), np.array([[0, 1, 2]]), ball.vertices, ball.faces)


@pytest.mark.parametrize("tilt_deg", [0.0, 12.5, -40.0])
def test_the_fold_of_a_tilted_sheet_is_its_tilt(tilt_deg: float) -> None:
    body = box((-0.2, -0.5, -0.1), (0.2, 0.5, 0.1))
    cloth = sheet(0.2, 0.3, 0.4, tilt_deg)
    folds = fold_angles({"skin": _flat(body), "tee": cloth}, *_arrays(body))
    assert folds["tee"].angle_deg == pytest.approx(abs(tilt_deg), abs=1e-5)
    due = 0.2 * 0.3 * np.cos(np.radians(tilt_deg)) / 0.005**2
    assert folds["tee"].pixels == pytest.approx(due, rel=0.03)
    # What the cloth does not hide, and the whole back, shows the skin itself.
    assert folds["skin"].pixels + folds["tee"].pixels == 2 * 80 * 200
    assert folds["skin"].angle_deg == pytest.approx(0.0, abs=1e-5)


def test_the_fold_of_a_ball_around_a_ball() -> None:
    body = trimesh.creation.icosphere(subdivisions=5, radius=0.2)
    cloth = trimesh.creation.icosphere(subdivisions=5, radius=0.26)
    fold = fold_angles({"coat": piece(cloth)}, *_arrays(body))["coat"]
    # The mean over the disc of what the two slopes differ by, at the distance rho of the axis.
    rho = 0.2 * np.sqrt((np.arange(100_000) + 0.5) / 100_000)
    due = np.degrees(np.arcsin(rho / 0.2) - np.arcsin(rho / 0.26)).mean()
    assert fold.angle_deg == pytest.approx(due, rel=0.01)
    assert fold.pixels == pytest.approx(2 * np.pi * 0.2**2 / 0.005**2, rel=0.01)


def test_waves_fold_more_than_a_smooth_sheet() -> None:
    body = box((-0.2, -0.5, -0.1), (0.2, 0.5, 0.1))
    smooth, waved = sheet(0.4, 1.0, 0.2, n=400), sheet(0.4, 1.0, 0.2, n=400)
    height, period = 0.008, 0.08
    waved.vertices[:, 2] += height * np.sin(2 * np.pi / period * waved.vertices[:, 0])
    slope = 2 * np.pi * height / period * np.cos(np.linspace(0, 2 * np.pi, 10_000))
    found = [fold_angles({"tee": cloth}, *_arrays(body), 0.002) for cloth in (smooth, waved)]
    assert found[0]["tee"].angle_deg == pytest.approx(0.0, abs=1e-5)
    assert found[1]["tee"].angle_deg == pytest.approx(
        np.degrees(np.arctan(np.abs(slope))).mean(), rel=0.02
    )


def test_only_what_is_seen_before_the_body_counts() -> None:
    body = box((-0.2, -0.5, -0.1), (0.2, 0.5, 0.1))
    skin = _flat(body)
    jacket, hidden = sheet(0.3, 0.3, 0.4, 20.0), sheet(0.2, 0.2, 0.15)
    beside = Piece(jacket.vertices + np.array([2.0, 0.0, 0.0]), jacket.faces, jacket.uv)
    pieces = {"skin": skin, "tee": hidden, "jacket": jacket, "flag": beside}
    folds = fold_angles(pieces, *_arrays(body))
    assert set(folds) == {"skin", "jacket"}
    # A lining shows the same shape as the face that looks out.
    lining = Piece(jacket.vertices, jacket.faces[:, ::-1], jacket.uv)
    again = fold_angles({**pieces, "jacket": lining}, *_arrays(body))
    assert again["jacket"].pixels == folds["jacket"].pixels
    assert again["jacket"].angle_deg == pytest.approx(20.0, abs=1e-5)


def _arrays(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces; of a box each side its own, so that its normals are flat."""
    flat = _flat(mesh)
    return flat.vertices, flat.faces


def _flat(mesh: trimesh.Trimesh) -> Piece:
    if len(mesh.faces) > 12:
        return piece(mesh)
    vertices = mesh.triangles.reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Piece(np.array(vertices), faces, np.zeros((len(faces), 3, 2)))
