"""Mesh files, tables, captures and smoothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from surface.mesh import FORMATS, SurfaceError, TriangleMesh, read_mesh, write_mesh
from surface.pinhole import Frame, Pinhole, Place, orthographic
from surface.poisson import poisson_smoothed
from surface.table import Cell, Table

Shapes = Callable[..., TriangleMesh]


def colored(shapes: Shapes) -> TriangleMesh:
    mesh = shapes("ball", 0.5, (0, 0, -2), fine=3)
    shade = np.random.default_rng(0).integers(0, 256, mesh.vertices.shape, dtype=np.uint8)
    return TriangleMesh(mesh.vertices, mesh.faces, shade)


class TestFiles:
    @pytest.mark.parametrize("ending", FORMATS)
    def test_what_is_written_is_read_again(
        self, shapes: Shapes, tmp_path: Path, ending: str
    ) -> None:
        mesh = colored(shapes)
        write_mesh(tmp_path / f"m{ending}", mesh)
        found = read_mesh(tmp_path / f"m{ending}")
        assert found.faces.shape == mesh.faces.shape
        corners, theirs = (m.vertices[m.faces].mean(axis=1) for m in (mesh, found))
        np.testing.assert_allclose(theirs, corners, atol=1e-6)
        assert [path.name for path in tmp_path.iterdir()] == [f"m{ending}"]

    @pytest.mark.parametrize("ending", [".ply", ".obj"])
    def test_colours_are_kept_as_srgb(self, shapes: Shapes, tmp_path: Path, ending: str) -> None:
        mesh = colored(shapes)
        write_mesh(tmp_path / f"m{ending}", mesh)
        found = trimesh.load_mesh(tmp_path / f"m{ending}", process=False)
        np.testing.assert_allclose(found.visual.vertex_colors[:, :3], mesh.colors, atol=1)

    def test_glbs_colours_are_linear_as_gltf_has_them(self, shapes: Shapes, tmp_path: Path) -> None:
        mesh = shapes("ball", fine=1)
        grey = np.full(mesh.vertices.shape, 188, np.uint8)  # sRGB 188 is half of the light
        write_mesh(tmp_path / "m.glb", TriangleMesh(mesh.vertices, mesh.faces, grey))
        found = trimesh.load_mesh(tmp_path / "m.glb", process=False)
        np.testing.assert_allclose(found.visual.vertex_colors[:, :3], 128, atol=1)

    def test_other_endings_are_refused(self, shapes: Shapes, tmp_path: Path) -> None:
        with pytest.raises(ValueError, match=r"give \.obj, \.glb, \.ply"):
            write_mesh(tmp_path / "m.stl", colored(shapes))

    @pytest.mark.parametrize(
        ("name", "text", "said"),
        [
            ("none.obj", None, "cannot be opened"),
            ("empty.obj", "", "holds no triangles"),
            ("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "holds no triangles"),
            ("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices are NaN"),
            ("text.ply", "no mesh at all", "damaged"),
            ("far.obj", "v 0 0 0\nf 1 2 3\n", "damaged"),
        ],
    )
    def test_what_is_no_surface_is_named(
        self, tmp_path: Path, name: str, text: str | None, said: str
    ) -> None:
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(SurfaceError, match=f"{name}.*{said}"):
            read_mesh(tmp_path / name)


class TestPerspective:
    """A ball before a Kinect v2, off the axis, whose depth has a closed form."""

    CENTER, RADIUS = np.array([0.15, -0.1, -2.4]), 0.3

    def seen(self) -> Frame:
        camera = Pinhole()
        v, u = np.mgrid[:424, :512]
        ray = np.stack(
            [(u - camera.cx) / camera.fx, (camera.cy - v) / camera.fy, -np.ones(u.shape)], -1
        )
        along = ray @ self.CENTER
        length = (ray**2).sum(axis=-1)
        root = along**2 - length * (self.CENTER @ self.CENTER - self.RADIUS**2)
        mask = root > 0
        depth = np.where(mask, (along - np.sqrt(np.maximum(root, 0))) / length, 0)
        rgb = np.where(mask[..., None], [200, 100, 50], 0).astype(np.uint8)
        return Frame(rgb, depth, mask, None)

    def test_a_point_goes_to_the_orthographic_frame_and_back(self) -> None:
        place = Place(2.4, 2.0, (0.15, -0.1))
        points = np.random.default_rng(0).normal(size=(50, 3)) * 0.3 + [0, 0, -2.4]
        there = place.to_orthographic(points)
        np.testing.assert_allclose(place.from_orthographic(there), points, atol=1e-12)
        np.testing.assert_allclose(there[:, 2], points[:, 2] + 0.4)

    def test_the_persons_depth_stands_at_the_distance_that_was_learned(self) -> None:
        found = orthographic(self.seen(), Pinhole(), (424, 512), 0.005, 2.0)
        read = found.depth[found.mask]
        # Without a body the middle is taken for 0.1 m behind the front.
        assert np.median(read) == pytest.approx(1.9, abs=0.005)
        rows, columns = np.nonzero(found.mask)
        assert rows.mean() == pytest.approx(211.5, abs=1)
        assert columns.mean() == pytest.approx(255.5, abs=1)
        # A radius of 0.3 m at its own distance, seen at that of the middle: as their ratio is.
        assert np.ptp(rows) * 0.005 == pytest.approx(2 * 0.3 * found.place.middle / 2.4, rel=0.02)
        assert (found.rgb[found.mask] == [200, 100, 50]).mean() > 0.95

    def test_what_is_seen_comes_back_onto_the_ball_in_the_cameras_frame(self) -> None:
        found = orthographic(self.seen(), Pinhole(), (424, 512), 0.005, 2.0)
        i, j = np.nonzero(found.mask & (found.depth > 0))
        x, y = (j + 0.5 - 256) * 0.005, (212 - i - 0.5) * 0.005
        points = found.place.from_orthographic(np.column_stack([x, y, -found.depth[i, j]]))
        off = np.abs(np.linalg.norm(points - self.CENTER, axis=1) - self.RADIUS)
        assert np.median(off) < 0.002  # nearest pixels are up to half a pixel off
        assert np.quantile(off, 0.9) < 0.01

    def test_a_body_is_seen_where_the_person_is_and_its_back_is_farther(
        self, shapes: Shapes
    ) -> None:
        frame = self.seen()._replace(body=shapes("ball", 0.28, self.CENTER, fine=5))
        found = orthographic(frame, Pinhole(), (424, 512), 0.005, 2.0)
        body = found.body_back > 0
        assert 0.7 < (body & found.mask).sum() / found.mask.sum() <= 1
        both = body & (found.depth > 0)
        thick = (found.body_back - found.depth)[both]
        assert thick.max() == pytest.approx(0.58, abs=0.01)
        # The body's middle stands where it is to be shown.
        assert found.place.middle == pytest.approx(2.4, abs=0.01)
        assert (found.body_back[body].max() - 0.28) == pytest.approx(2.0, abs=0.01)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"rgb": np.zeros((10, 10, 3), np.uint8)}, "registered to the depth"),
            ({"mask": np.zeros((424, 512), bool)}, "read nothing of the person"),
            ({"mask": np.ones((424, 512), bool)}, "mask the background"),
        ],
    )
    def test_what_cannot_be_placed_is_named(self, change: dict, said: str) -> None:
        with pytest.raises(SurfaceError, match=said):
            orthographic(self.seen()._replace(**change), Pinhole(), (424, 512), 0.005, 2.0)

    @pytest.mark.parametrize(
        ("middle", "said"),
        [((3, 0, -2.4), "does not lie where"), ((0, 0, 2.4), "behind the camera")],
    )
    def test_a_body_in_another_frame_is_named(
        self, shapes: Shapes, middle: tuple[float, ...], said: str
    ) -> None:
        frame = self.seen()._replace(body=shapes("ball", 0.28, middle))
        with pytest.raises(SurfaceError, match=said):
            orthographic(frame, Pinhole(), (424, 512), 0.005, 2.0)


def test_poisson_smooths_noise_and_stays_closed(shapes: Shapes, check: dict[str, Callable]) -> None:
    ball = shapes("ball", 0.5, fine=5)
    noisy = ball.vertices * (
        1 + 0.01 * np.random.default_rng(0).normal(size=(len(ball.vertices), 1))
    )
    shade = np.where(ball.vertices[:, :1] > 0, 250, 5).repeat(3, axis=1).astype(np.uint8)
    found = poisson_smoothed(TriangleMesh(noisy, ball.faces, shade), depth=6)
    assert check["faults"](found) == []
    off = np.abs(np.linalg.norm(found.vertices, axis=1) - 0.5)
    assert off.mean() < 0.5 * np.abs(np.linalg.norm(noisy, axis=1) - 0.5).mean()
    assert found.colors is not None
    assert (found.colors[found.vertices[:, 0] > 0.1] == 250).all()


class TestTable:
    TABLE = Table(
        ["CD", "L2_x"],
        {
            "a": [Cell(0.2, 0.01), Cell(3)],
            "b & c": [Cell(0.1), Cell(None)],
            "bound": [Cell(0), Cell(0)],
        },
        digits=2,
        apart=frozenset({"bound"}),
    )

    def test_the_least_of_those_that_compete_stands_out(self) -> None:
        assert self.TABLE.markdown().splitlines() == [
            "| | CD | L2_x |",
            "|---|---:|---:|",
            "| a | 0.20 ± 0.01 | 3.00 |",
            "| b & c | **0.10** | - |",
            "| bound | 0.00 | 0.00 |",
        ]

    def test_latex_escapes_what_it_must(self) -> None:
        latex = self.TABLE.latex()
        assert r"b \& c & \textbf{0.10} & - \\" in latex
        assert r" & CD & L2\_x \\" in latex
        assert r"0.20 $\pm$ 0.01" in latex
