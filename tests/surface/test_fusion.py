"""Fusion: closed, manifold, oriented, symmetric, near the truth, and arms that stay arms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import label

from surface.cloud import back_project, lines_of_sight
from surface.distances import nearest, sample
from surface.fusion import STEP, fuse
from surface.mesh import SurfaceError, TriangleMesh

SIZE, PIXEL = (424, 512), 0.005


def sphere_maps(radius: float = 0.5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y = lines_of_sight(SIZE, PIXEL)
    inside = radius**2 - x**2 - y**2
    mask, bulge = inside > 0, np.sqrt(np.maximum(inside, 0))
    return (
        np.where(mask, 2 - bulge, 0).astype(np.float32),
        np.where(mask, 2 + bulge, 0).astype(np.float32),
        mask,
    )


def test_back_projection_is_the_contract_of_the_grid() -> None:
    depth, mask = np.zeros((4, 6)), np.zeros((4, 6), bool)
    depth[1, 4], mask[1, 4] = 1.5, True
    np.testing.assert_allclose(back_project(depth, mask, 0.1), [[0.15, 0.05, -1.5]])


@pytest.fixture(scope="module")
def mesh() -> TriangleMesh:
    return fuse(*sphere_maps(), PIXEL)


class TestSphere:
    def test_it_is_closed_with_the_characteristic_of_a_sphere(
        self, mesh: TriangleMesh, check: dict[str, Callable]
    ) -> None:
        assert check["faults"](mesh) == []
        assert check["euler"](mesh) == 2

    def test_its_faces_look_outwards_and_hold_the_volume(
        self, mesh: TriangleMesh, check: dict[str, Callable]
    ) -> None:
        assert check["volume"](mesh) == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=1e-3)

    def test_both_ways_it_is_less_than_half_a_pixel_from_the_sphere(
        self, mesh: TriangleMesh, shapes: Callable[..., TriangleMesh]
    ) -> None:
        points = sample(mesh, 20_000, np.random.default_rng(0))
        off = np.abs(np.linalg.norm(points - [0, 0, -2], axis=1) - 0.5)
        true = sample(shapes("ball", 0.5, (0, 0, -2), fine=6), 20_000, np.random.default_rng(1))
        assert off.mean() < PIXEL / 20
        assert off.max() < PIXEL
        assert nearest(true, mesh)[0].mean() < PIXEL / 20

    def test_every_pixel_of_both_maps_is_a_vertex(self, mesh: TriangleMesh) -> None:
        front, back, mask = sphere_maps()
        known = {tuple(v) for v in np.round(mesh.vertices, 9).tolist()}
        for depth in (front, back):
            points = back_project(depth, mask, PIXEL)
            assert {tuple(v) for v in np.round(points, 9).tolist()} <= known


@pytest.mark.parametrize("step", [None, 0.1])
@pytest.mark.parametrize("seed", range(60))
def test_any_maps_give_a_closed_oriented_manifold(
    seed: int, step: float | None, check: dict[str, Callable]
) -> None:
    """Specks, diagonals, holes, lines of one pixel; steps everywhere, backs before fronts."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 14, 2))
    mask = rng.random(shape) < rng.choice([0.2, 0.5, 0.8, 0.95])
    mask.flat[0] = True
    front = rng.choice([1, 1.05, 1.2, 1.4, 1.45, 1.9], shape)
    back = front + rng.choice([-0.1, 0, 0.05, 0.3, 0.6], shape)
    mesh = fuse(front, back, mask, 0.01, step=step)
    assert check["faults"](mesh) == []
    if step is None:
        pieces = label(mask)[1]
        holes = label(np.pad(~mask, 1, constant_values=True), np.ones((3, 3)))[1] - 1
        assert check["euler"](mesh) == 2 * (pieces - holes)


@pytest.mark.parametrize("step", [None, 0.1])
def test_mirrored_depths_give_the_mirrored_surface_triangle_for_triangle(
    step: float | None,
) -> None:
    rng = np.random.default_rng(5)
    mask = rng.random((12, 15)) < 0.8
    front = 1.5 + 0.3 * rng.random(mask.shape)
    back = front + 0.4 * rng.random(mask.shape)
    one = fuse(front, back, mask, 0.01, step=step)
    other = fuse(4 - back, 4 - front, mask, 0.01, step=step)

    def triangles(mesh: TriangleMesh, mirrored: bool) -> set:
        vertices = mesh.vertices.copy()
        faces = mesh.faces
        if mirrored:
            vertices[:, 2] = -4 - vertices[:, 2]
            faces = faces[:, ::-1]
        corners = np.round(vertices, 9)[faces]
        first = np.lexsort(corners.transpose(2, 0, 1)[::-1], axis=1)[:, 0]
        turned = [np.roll(c, -f, axis=0) for c, f in zip(corners, first, strict=True)]
        return {tuple(t.ravel().tolist()) for t in turned}

    assert triangles(one, False) == triangles(other, True)


def test_colours_come_from_both_images(check: dict[str, Callable]) -> None:
    front, back, mask = sphere_maps(0.1)
    rgb = np.zeros((*SIZE, 3), np.uint8)
    red, blue = rgb.copy(), rgb.copy()
    red[..., 0], blue[..., 2] = 200, 100
    mesh = fuse(front, back, mask, PIXEL, red, blue)
    assert mesh.colors is not None
    before = mesh.vertices[:, 2] > -2 + 0.04
    behind = mesh.vertices[:, 2] < -2 - 0.04
    assert (mesh.colors[before] == [200, 0, 0]).all()
    assert (mesh.colors[behind] == [0, 0, 100]).all()
    rest = mesh.colors[~before & ~behind].astype(int)
    assert (rest[:, 0] / 2 + rest[:, 2] <= 101).all()  # mixtures on the rim


class TestArmBeforeTrunk:
    """A round bar that stands 0.3 m before a box, attached to it at its left end."""

    RADIUS, GAP = 0.04, 0.3

    def maps(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x, y = lines_of_sight((80, 100), 0.01)
        trunk = (np.abs(x) < 0.3) & (np.abs(y) < 0.3)
        arm = (np.abs(y) < self.RADIUS) & (np.abs(x) < 0.2)
        bulge = np.sqrt(np.maximum(self.RADIUS**2 - y**2, 0))
        # Towards the left the bar comes down to the trunk.
        middle = 2 - self.GAP * np.clip((x + 0.2) / 0.15, 0, 1)
        front = np.where(arm, np.minimum(middle - bulge, 2.0), 2.0)
        return np.where(trunk, front, 0), np.where(trunk, 2.2, 0), trunk

    def webs(self, mesh: TriangleMesh) -> float:
        """Area of the triangles that cross the gap, half of the way, below the bar's free part."""
        corners = mesh.vertices[mesh.faces]
        middle = corners.mean(axis=1)
        crossing = np.ptp(corners[..., 2], axis=1) > self.GAP / 3
        crossing &= (middle[:, 0] > 0) & (np.abs(middle[:, 1]) < 0.08)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(np.linalg.norm(cross[crossing], axis=1).sum() / 2)

    def test_without_a_cut_webs_join_them(self, check: dict[str, Callable]) -> None:
        mesh = fuse(*self.maps(), 0.01, step=None)
        assert check["faults"](mesh) == []
        assert check["euler"](mesh) == 2
        assert self.webs(mesh) > 0.05

    def test_with_the_cut_the_bar_stands_free_and_is_round(
        self, check: dict[str, Callable]
    ) -> None:
        mesh = fuse(*self.maps(), 0.01)
        assert check["faults"](mesh) == []
        assert self.webs(mesh) == 0
        # Joined at one end alone, it is a sphere still.
        assert check["euler"](mesh) == 2
        trunk, bar = 0.6 * 0.6 * 0.2, np.pi * self.RADIUS**2 * 0.3
        assert check["volume"](mesh) == pytest.approx(trunk + bar, rel=0.03)
        at = mesh.vertices[(np.abs(mesh.vertices[:, 0] - 0.1) < 0.005)]
        bar_at = at[at[:, 2] > -1.85]
        assert np.ptp(bar_at[:, 1]) == pytest.approx(2 * self.RADIUS, abs=0.012)
        assert np.ptp(bar_at[:, 2]) == pytest.approx(2 * self.RADIUS, abs=0.012)
        hidden = at[(np.abs(at[:, 1]) < self.RADIUS / 2) & (at[:, 2] < -1.85) & (at[:, 2] > -2.1)]
        np.testing.assert_allclose(hidden[:, 2], -2, atol=0.005)

    def test_from_behind_it_is_the_same(self, check: dict[str, Callable]) -> None:
        front, back, mask = self.maps()
        turned = [np.where(mask, 4 - depth, 0) for depth in (back, front)]
        mesh = fuse(*turned, mask, 0.01)
        assert check["faults"](mesh) == []
        assert check["volume"](mesh) == pytest.approx(
            check["volume"](fuse(front, back, mask, 0.01)), rel=1e-9
        )

    def test_what_is_hidden_has_the_colour_of_what_is_around_it(self) -> None:
        front, back, mask = self.maps()
        rgb = np.full((*mask.shape, 3), 50, np.uint8)
        rgb[front < 1.95] = 250
        mesh = fuse(front, back, mask, 0.01, rgb, rgb)
        assert mesh.colors is not None
        v = mesh.vertices
        under = (np.abs(v[:, 1]) < 0.02) & (v[:, 0] > 0) & (v[:, 0] < 0.15)
        np.testing.assert_array_equal(mesh.colors[under & (np.abs(v[:, 2] + 2) < 0.005)], 50)


def test_a_part_that_no_line_of_sight_shares_stands_alone(check: dict[str, Callable]) -> None:
    """Two plates side by side, one 0.5 m behind the other and 2 cm thick."""
    mask = np.ones((10, 20), bool)
    front = np.where(np.arange(20) < 10, 1.5, 2.0) * np.ones((10, 1))
    mesh = fuse(front, front + 0.02, mask, 0.01)
    assert check["faults"](mesh) == []
    assert check["euler"](mesh) == 4
    assert check["euler"](fuse(front, front + 0.02, mask, 0.01, step=None)) == 2


def test_steep_thin_cloth_is_not_torn(check: dict[str, Callable]) -> None:
    """3 mm thick and sloped by twice its pixel."""
    mask = np.ones((20, 20), bool)
    front = 2 + 0.02 * np.arange(20) * np.ones((20, 1))
    assert check["euler"](fuse(front, front + 0.003, mask, 0.01, step=STEP)) == 2


class TestWhatIsRefused:
    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"mask": np.zeros((4, 5), bool)}, "the silhouette is empty"),
            ({"depth_back": np.ones((5, 4))}, r"\(5, 4\) with a mask of \(4, 5\)"),
            ({"mask": np.ones((4, 5))}, r"\(float64\); give \(H, W\)"),
            ({"depth_front": np.full((4, 5), np.nan)}, "front's depth is nan at row 0, column 0"),
            ({"depth_back": np.zeros((4, 5))}, "no number above 0 at 20 of 20 pixels"),
            ({"rgb_front": np.zeros((4, 5, 3), np.uint8)}, "colours of one side only"),
            ({"pixel_size": 0.0}, "pixel_size: 0.0"),
            ({"step": -1.0}, "step: -1.0"),
        ],
    )
    def test_each_is_named(self, change: dict, said: str) -> None:
        given = {
            "depth_front": np.ones((4, 5)),
            "depth_back": np.full((4, 5), 1.2),
            "mask": np.ones((4, 5), bool),
            "pixel_size": 0.01,
        }
        with pytest.raises(SurfaceError, match=said):
            fuse(**{**given, **change})
