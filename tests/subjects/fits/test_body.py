"""A body in a scan: its maps, its yaw, its distance."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from subjects.fits.body import Body, surface_distance, yaw_of
from subjects.fits.similarity import compose
from subjects.mesh import Mesh, MeshError


def ball(radius: float, subdivisions: int = 5) -> Mesh:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh(mesh.vertices, mesh.faces)


class TestMaps:
    def test_of_a_sphere(self) -> None:
        """A ball of 0.5 m, in a scan of millimetres, seen from 2 m: closed form."""
        mesh = ball(0.5)
        turn = Rotation.from_rotvec([0.1, 0.7, -0.2]).as_matrix()
        body = Body(mesh.vertices, mesh.faces, compose(1000.0, turn, np.array([30.0, -7, 11])))
        scan_to_camera = compose(0.001, np.eye(3), np.array([-0.03, 0.007, -2.011]))
        step = (np.arange(64) + 0.5 - 32) * 0.02
        x, y = np.meshgrid(step, -step)
        front, back = body.depth_maps(np.stack([x, y], axis=-1), scan_to_camera)
        assert front.shape == back.shape == (64, 64)
        assert front.dtype == np.float32
        radius = np.hypot(x, y)
        inside, outside = radius < 0.495, radius > 0.5
        half = np.sqrt(0.25 - np.minimum(radius, 0.5) ** 2)
        assert not front[outside].any()
        assert not back[outside].any()
        assert np.abs(front - (2 - half))[inside].max() < 5e-3
        assert np.abs(back - (2 + half))[inside].max() < 5e-3
        assert np.median(np.abs(front - (2 - half))[inside]) < 2e-4
        assert ((front > 0) == (back > 0)).all()

    def test_scale_of_the_similarity(self) -> None:
        mesh = ball(1.0, 1)
        turn = Rotation.from_rotvec([1, 2, 3]).as_matrix()
        body = Body(mesh.vertices, mesh.faces, compose(0.4335, turn, np.ones(3)), turn.T)
        assert body.scan_units_per_metre == pytest.approx(0.4335)
        np.testing.assert_allclose(body.orientation_in_scan(), np.eye(3), atol=1e-12)

    def test_a_mesh_alone_says_no_direction(self) -> None:
        mesh = ball(1.0, 1)
        with pytest.raises(MeshError, match="where it faces"):
            Body(mesh.vertices, mesh.faces).orientation_in_scan()
        with pytest.raises(MeshError, match="which way is up"):
            Body(mesh.vertices, mesh.faces).upright_in_scan()


class TestYaw:
    @pytest.mark.parametrize("yaw", [-179.0, -90.0, 0.0, 30.0, 127.0])
    @pytest.mark.parametrize("lean", [(0, 0, 0), (60, 0, 0), (-80, 0, 0), (0, 0, 40), (100, 0, 0)])
    def test_a_bend_does_not_change_it(self, yaw: float, lean: tuple[float, ...]) -> None:
        turn = Rotation.from_euler("y", yaw, degrees=True)
        turn = turn * Rotation.from_rotvec(np.radians(lean))
        found = np.degrees(yaw_of(turn.as_matrix()))
        assert (found - yaw + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)

    def test_is_no_component_of_the_axis_angle(self) -> None:
        """The second component of the vector, which others read, is something else."""
        turn = Rotation.from_euler("y", 100, degrees=True) * Rotation.from_euler("x", 1.0)
        assert np.degrees(yaw_of(turn.as_matrix())) == pytest.approx(100)
        assert abs(np.degrees(turn.as_rotvec()[1]) - 100) > 5


class TestDistance:
    def test_between_spheres(self) -> None:
        small, large = ball(0.5), ball(0.53)
        assert surface_distance(large, small) == pytest.approx(0.03, abs=3e-4)
        assert surface_distance(small, large) == pytest.approx(0.03, abs=3e-4)

    def test_is_a_mean_over_area(self) -> None:
        """Two squares 1 m and 3 m above a floor, the farther one cut into many triangles."""
        floor = Mesh(np.array([[-9, 0, -9], [-9, 0, 9], [9, 0, 9.0]]), np.array([[0, 1, 2]]))
        square = np.array([[-8, 1, 2], [-8, 1, 3], [-7, 1, 3.0], [-7, 1, 2]])
        near = trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], process=False)
        far = near.copy().apply_translation([0, 2, 0]).subdivide().subdivide()
        both = trimesh.util.concatenate([near, far])
        distance = surface_distance(Mesh(both.vertices, both.faces), floor)
        assert distance == pytest.approx(2.0)

    def test_of_more_triangles_than_are_looked_at(self) -> None:
        large = ball(0.6, 7)
        assert len(large.faces) > 100_000
        assert surface_distance(large, ball(0.5)) == pytest.approx(0.1, abs=3e-4)
