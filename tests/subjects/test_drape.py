"""Cloth in Blender's solver, for real: small pieces over a moving cylinder, and one human."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from subjects.open import OpenHumans
from subjects.open.drape import DrapeError, Layer, Material, drape

SOFT = Material(mass=0.2, stiffness=15.0, bending=0.05, slack=0.0)
RADIUS, TOP, BOTTOM, AROUND, DOWN = 0.12, 1.0, 0.6, 48, 20


def tube() -> tuple[np.ndarray, np.ndarray]:
    """A skirt: rings of vertices from the waist down, 1 cm off a column of 12 cm radius."""
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    height = np.linspace(TOP, BOTTOM, DOWN)
    radius = RADIUS + 0.01 + 0.25 * (TOP - height)
    vertices = np.stack(
        [
            np.outer(radius, np.sin(angle)),
            np.outer(height, np.ones(AROUND)),
            np.outer(radius, np.cos(angle)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    i, j = np.mgrid[: DOWN - 1, :AROUND]
    a, b = i * AROUND + j, i * AROUND + (j + 1) % AROUND
    c, d = a + AROUND, b + AROUND
    faces = np.stack([np.stack([a, c, b], -1), np.stack([b, c, d], -1)], axis=2).reshape(-1, 3)
    return vertices, faces


def column() -> tuple[np.ndarray, np.ndarray]:
    """The body: a column that walks 10 cm along x in three shapes."""
    solid = trimesh.creation.cylinder(RADIUS, 1.4, sections=64).subdivide().subdivide()
    upright = solid.vertices[:, [1, 2, 0]] + [0.0, 0.7, 0.0]
    return np.stack([upright + np.array([step, 0, 0]) for step in (0.0, 0.05, 0.1)]), np.asarray(
        solid.faces
    )


def skirt(material: Material) -> Layer:
    start, faces = tube()
    goal = np.stack([start + np.array([step, 0, 0]) for step in (0.0, 0.05, 0.1)])
    pin = (np.arange(len(start)) < 2 * AROUND).astype(float)
    return Layer(start, goal, faces, pin, material)


@pytest.fixture(scope="module")
def fallen() -> np.ndarray:
    return drape([skirt(SOFT)], *column())[0]


def test_the_waistband_goes_along_and_the_rest_hangs_outside(fallen):
    start, _ = tube()
    held = fallen[: 2 * AROUND] - start[: 2 * AROUND]
    np.testing.assert_allclose(held, np.tile([0.1, 0, 0], (2 * AROUND, 1)), atol=2e-3)
    # A cone that nothing but its waist holds falls together, as far as the column lets it.
    radius = np.hypot(fallen[:, 0] - 0.1, fallen[:, 2])
    hem = radius[-AROUND:]
    assert hem.mean() < np.hypot(start[:, 0], start[:, 2])[-AROUND:].mean() - 0.01
    assert radius.min() > RADIUS - 0.001
    # It hangs, within a few centimetres of its own length.
    assert 0.55 < fallen[-AROUND:, 1].mean() < 0.62


def test_the_same_cloth_falls_the_same_way_to_the_bit(fallen):
    assert drape([skirt(SOFT)], *column())[0].tobytes() == fallen.tobytes()


def test_cloth_that_wants_to_be_six_times_as_long_is_refused():
    explosive = Material(mass=0.2, stiffness=15.0, bending=0.05, slack=5.0)
    with pytest.raises(DrapeError, match=r"torn|exploded|settle"):
        drape([skirt(explosive)], *column())


def test_a_solver_that_fails_is_named():
    whole = skirt(SOFT)
    short = Layer(whole.start, whole.goal[:, :-1], whole.faces, whole.pin, SOFT)
    with pytest.raises(DrapeError, match=r"the cloth solver ended with 1: \w+"):
        drape([short], *column())


def test_a_human_wears_draped_cloth(tmp_path):
    """The solver's garments: other than laid ones, outside the body, and said to be so."""
    shapes = {}
    for cloth in ("laid", "draped"):
        folder = tmp_path / cloth
        source = OpenHumans(cloth=cloth, poses=["a_pose"])
        shapes[cloth] = source.make("open_0002", 0, folder)
    parameters = json.loads((tmp_path / "draped" / "parameters.json").read_text())
    garments = parameters["drapes"]["garments"]
    assert len(garments) == 2
    assert all(0 <= g["through_share"] <= 0.03 for g in garments)
    laid, draped = (
        trimesh.load(shapes[c].mesh, process=False, skip_materials=True) for c in ("laid", "draped")
    )
    distance = trimesh.proximity.ProximityQuery(laid).vertex(draped.vertices)[0]
    # Cloth hangs elsewhere, but not far: it was neither lost nor left where it began.
    assert np.quantile(distance, 0.9) > 0.003
    assert distance.max() < 0.25
