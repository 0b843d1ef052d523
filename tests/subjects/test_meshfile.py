"""Mesh files of every format, as exporters write them and as they break."""

from __future__ import annotations

import io
import json
import os
import struct
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from shards.geometry import read_geometry
from subjects.color import srgb_to_linear
from subjects.limits import Limits
from subjects.mesh import Mesh, MeshError
from subjects.meshfile import EXTENSIONS, check_winding, read_mesh, read_mesh_and_files
from subjects.meshfile.gltf import JSON_VALUES
from subjects.meshfile.joining import NORMAL_TOLERANCE, NORMALS, first_alike
from subjects.meshfile.layout import PARTS
from subjects.meshfile.stl import SOLIDS

TETRAHEDRON = """\
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""

# A cube as eight vertices and six quads.
CUBE_V = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
CUBE_F = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]

# 4 texels, rows from the top.
TEXELS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [9, 8, 7]]], dtype=np.uint8)


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def cylinder_obj(normals: list[tuple[float, float]] | None = None) -> str:
    """Three quads in a row around the y axis, each with its own texture coordinates.

    `normals` gives for each inner edge the (x, z) normal of the left and of the right quad.
    """
    angles = np.radians([-45.0, -15.0, 15.0, 45.0])
    v = [f"v {np.sin(a):.6f} {y} {np.cos(a):.6f}" for a in angles for y in (0, 1)]
    vt = [f"vt {u} {w}" for quad in range(3) for u in (quad / 4, quad / 4 + 0.2) for w in (0, 1)]
    vn = [f"vn {x:.6f} 0 {z:.6f}" for x, z in normals or []]
    faces = []
    for quad in range(3):
        corners = [(0, 0), (2, 2), (3, 3), (1, 1)]
        names = [f"{2 * quad + k + 1}/{4 * quad + t + 1}" for k, t in corners]
        if normals:
            left, right = 2 * quad + 1, 2 * quad + 2
            sides = (left, right, right, left)
            names = [f"{n}/{s}" for n, s in zip(names, sides, strict=True)]
        faces.append("f " + " ".join(names))
    return "\n".join([*v, *vt, *vn, *faces]) + "\n"


def vertex_normals(mesh: Mesh) -> np.ndarray:
    """(N, 3) unit normals of the faces that share each vertex, by trimesh."""
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).vertex_normals


def sphere() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=2)


def same_texels(texture: np.ndarray | None) -> None:
    assert texture is not None
    assert np.array_equal(texture, TEXELS)


class TestFormats:
    @pytest.mark.parametrize("kind", ["obj", "ply", "glb", "gltf", "stl"])
    def test_sphere_comes_back_closed_and_outward(self, tmp_path: Path, kind: str) -> None:
        path = tmp_path / f"sphere.{kind}"
        if kind == "gltf":
            for name, data in trimesh.Scene(sphere()).export(file_type="gltf").items():
                (tmp_path / name).write_bytes(data)
            path = tmp_path / "model.gltf"
        else:
            sphere().export(path)
        mesh = read_mesh(path)
        assert mesh.vertices.shape == sphere().vertices.shape
        assert len(mesh.faces) == len(sphere().faces)
        check_winding(mesh)
        assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume == pytest.approx(
            sphere().volume, rel=1e-5
        )

    @pytest.mark.parametrize("encoding", ["ascii", "binary"])
    def test_ply_encodings(self, tmp_path: Path, encoding: str) -> None:
        (tmp_path / "s.ply").write_bytes(sphere().export(file_type="ply", encoding=encoding))
        assert len(read_mesh(tmp_path / "s.ply").faces) == len(sphere().faces)

    def test_ascii_stl(self, tmp_path: Path) -> None:
        write(tmp_path / "s.stl", sphere().export(file_type="stl_ascii"))
        assert len(read_mesh(tmp_path / "s.stl").vertices) == len(sphere().vertices)

    def test_extension_in_capitals(self, tmp_path: Path) -> None:
        assert len(read_mesh(write(tmp_path / "A.OBJ", TETRAHEDRON)).faces) == 4

    def test_polygons_become_triangles(self, tmp_path: Path) -> None:
        text = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE_V)
        quads = "".join("f " + " ".join(str(i + 1) for i in f) + "\n" for f in CUBE_F[:-1])
        fan = "f 2 6 8\nf 2 8 4\n"  # the last side as triangles: a mixed file
        for faces in (quads + fan, quads + "f 2 6 8 4\n"):
            mesh = read_mesh(write(tmp_path / "cube.obj", text + faces))
            assert mesh.faces.shape == (12, 3)
            check_winding(mesh)
            cube = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            assert cube.volume == pytest.approx(1)

    def test_pentagon(self, tmp_path: Path) -> None:
        text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0.5 1.5 0\nv 0 1 0\nf 1 2 3 4 5\nf 1 3 2\n"
        assert len(read_mesh(write(tmp_path / "p.obj", text)).faces) == 4

    def test_negative_indices(self, tmp_path: Path) -> None:
        text = TETRAHEDRON.replace("f 1 3 2", "f -4 -2 -3")
        expected = read_mesh(write(tmp_path / "a.obj", TETRAHEDRON))
        assert np.array_equal(read_mesh(write(tmp_path / "b.obj", text)).faces, expected.faces)

    def test_negative_indices_count_from_their_face(self, tmp_path: Path) -> None:
        """As exporters write that put every object's vertices before its faces."""
        first, second = "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "v 5 5 5\nv 6 5 5\nv 5 6 5\n"
        text = f"{first}f -3 -2 -1\n{second}f -3 -2 -1\nf 1 -1 -2\n"
        mesh = read_mesh(write(tmp_path / "n.obj", text))
        assert np.array_equal(mesh.faces, [[0, 1, 2], [3, 4, 5], [0, 5, 4]])
        assert np.array_equal(mesh.vertices[3], [5, 5, 5])

    @pytest.mark.parametrize("ends", ["\n", "\r\n", " \n", "\\\n\n", " # it\n", "\n \t", "\r"])
    @pytest.mark.parametrize("together", [True, False])
    def test_obj_of_any_form(self, tmp_path: Path, ends: str, together: bool) -> None:
        """What was written is read: polygons of all sizes, corners of v/vt, lines in any order."""
        rng = np.random.default_rng(3)
        v, vt = rng.standard_normal((60, 3)).round(4), rng.random((40, 2)).round(4)
        polygons = [rng.choice(60, rng.integers(3, 7), replace=False) for _ in range(50)]
        coordinates = [rng.integers(0, 40, len(polygon)) for polygon in polygons]
        places = [f"v {x} {y}\t{z}" for x, y, z in v] + [f"vt {x} {y} 0" for x, y in vt]
        faces = [
            "f " + " ".join(f"{i + 1}/{j + 1}" for i, j in zip(*face, strict=True))
            for face in zip(polygons, coordinates, strict=True)
        ]
        if together:
            lines = [*places, "# faces", "s off", *faces]
        else:  # one after the other, as long as there are faces
            lines = [line for pair in zip(faces, places, strict=False) for line in pair]
            lines += places[len(faces) :]
        path = tmp_path / "any.obj"
        path.write_bytes((ends.join(lines) + ends).encode())
        mesh = read_mesh(path)
        fans = [(i, k) for i, face in enumerate(polygons) for k in range(1, len(face) - 1)]
        due = [[polygons[i][c] for c in (0, k, k + 1)] for i, k in fans]
        assert np.array_equal(mesh.vertices[mesh.faces], v[due])
        vertices, corners, _ = read_geometry(path)  # as the proof reads it
        assert np.array_equal(vertices[corners], v[due])
        due = [[coordinates[i][c] for c in (0, k, k + 1)] for i, k in fans]
        assert mesh.uv is not None
        assert np.array_equal(mesh.uv, vt[due].astype(np.float32))

    def test_lines_that_no_face_names_do_not_count(self, tmp_path: Path) -> None:
        mesh = read_mesh(write(tmp_path / "u.obj", "vt 0.5\nvn\n" + TETRAHEDRON))
        assert len(mesh.faces) == 4

    @pytest.mark.parametrize("line", ["\n", "v\n", "# it\n", "u\n"])
    def test_more_lines_than_the_triangles_of_the_limits_have(
        self, tmp_path: Path, line: str
    ) -> None:
        """They would take many times the file's memory."""
        path = write(tmp_path / "l.obj", TETRAHEDRON + line * 1100)
        with pytest.raises(MeshError) as error:
            read_mesh(path, Limits(triangles=4))
        one_line(error, path, "has 11", "lines, more than 4 triangles have", "limits.triangles")

    def test_many_materials(self, tmp_path: Path) -> None:
        """Each keeps its own faces, in the file's order, wherever they are named."""
        names = [f"m{k % 7}" for k in range(40)]
        lines = [f"usemtl {name}\nf 1 {k + 2} {k + 3}\n" for k, name in enumerate(names)]
        write(tmp_path / "m.mtl", "".join(f"newmtl m{k}\nKd 0.{k} 0 0\n" for k in range(7)))
        places = np.random.default_rng(0).random((42, 3)).round(3)
        rows = "".join(f"v {x} {y} {z}\n" for x, y, z in places)
        mesh = read_mesh(write(tmp_path / "m.obj", "mtllib m.mtl\n" + rows + "".join(lines)))
        red = np.array([round(10 * m.color[0]) for m in mesh.materials])[mesh.face_material]
        order = np.argsort([k % 7 for k in range(40)], kind="stable")
        assert np.array_equal(red, order % 7)
        due = places[np.stack([0 * order, order + 1, order + 2], axis=1)]
        assert np.array_equal(mesh.vertices[mesh.faces], due)

    def test_rows_of_several_lengths(self, tmp_path: Path) -> None:
        """Where not all vertices have colours, none has."""
        lines = TETRAHEDRON.splitlines(keepends=True)
        lines[1] = lines[1].replace("\n", " 1 0 0\n")
        mesh = read_mesh(write(tmp_path / "r.obj", "".join(lines)))
        expected = read_mesh(write(tmp_path / "a.obj", TETRAHEDRON))
        assert np.array_equal(mesh.vertices, expected.vertices)
        assert mesh.vertex_colors is None

    def test_faces_of_several_forms_lack_what_one_lacks(self, tmp_path: Path) -> None:
        more = "vt 0 0\nvn 0 0 1\n" + "f 1/1 3/1 2/1\nf 1//1 2//1 4//1\n"
        mesh = read_mesh(write(tmp_path / "f.obj", TETRAHEDRON + more))
        assert len(mesh.faces) == 6
        assert mesh.uv is None

    def test_unused_vertices_and_degenerate_faces_go(self, tmp_path: Path) -> None:
        mesh = read_mesh(write(tmp_path / "t.obj", "v 9 9 9\n" + TETRAHEDRON + "f 1 1 2\n"))
        assert mesh.vertices.shape == (4, 3)
        assert mesh.vertices.max() == 9  # in use, being named by faces 1 to 3 here
        text = TETRAHEDRON + "v 9 9 9\nf 1 1 2\n"
        mesh = read_mesh(write(tmp_path / "t.obj", text))
        assert mesh.vertices.max() == 1
        assert len(mesh.faces) == len(mesh.face_material) == 4

    def test_faces_without_area_stay(self, tmp_path: Path) -> None:
        text = TETRAHEDRON + "v 0.5 0 0\nf 1 5 2\n"
        assert len(read_mesh(write(tmp_path / "t.obj", text)).faces) == 5


class TestNormals:
    def test_seam_stays_smooth_and_keeps_its_texture_coordinates(self, tmp_path: Path) -> None:
        mesh = read_mesh(write(tmp_path / "c.obj", cylinder_obj()))
        assert len(mesh.vertices) == 8
        assert mesh.uv is not None
        assert {tuple(uv) for uv in mesh.uv.reshape(-1, 2).astype(float).round(3)} == {
            (u, w) for u in (0, 0.2, 0.25, 0.45, 0.5, 0.7) for w in (0.0, 1.0)
        }
        inner = np.abs(mesh.vertices[:, 0]) < 0.5
        outward = mesh.vertices[inner] * [1, 0, 1]
        assert np.allclose(vertex_normals(mesh)[inner], outward, atol=0.05)

    def test_corner_keeps_the_place_of_its_texture_coordinate(self, tmp_path: Path) -> None:
        mesh = read_mesh(write(tmp_path / "c.obj", cylinder_obj()))
        assert mesh.uv is not None
        assert np.allclose(mesh.uv[..., 1], mesh.vertices[mesh.faces][..., 1])

    def test_authored_hard_edge_stays_hard(self, tmp_path: Path) -> None:
        flat = [(np.sin(a), np.cos(a)) for a in np.radians([-30.0, -30.0, 0.0, 0.0, 30.0, 30.0])]
        mesh = read_mesh(write(tmp_path / "c.obj", cylinder_obj(flat)))
        assert len(mesh.vertices) == 12
        sides = np.degrees(np.arctan2(*vertex_normals(mesh)[:, [0, 2]].T))
        assert np.allclose(np.sort(sides), np.repeat([-30, 0, 30], 4), atol=1e-3)

    def test_authored_smooth_edge_stays_smooth(self, tmp_path: Path) -> None:
        angles = np.radians([-45.0, -15.0, -15.0, 15.0, 15.0, 45.0])
        wobble = np.array([0, 1, -1, 1, -1, 0]) * 3e-4  # a text file's rounding
        smooth = [(np.sin(a), np.cos(a)) for a in angles + wobble]
        assert len(read_mesh(write(tmp_path / "c.obj", cylinder_obj(smooth))).vertices) == 8

    def test_corners_without_a_normal_beside_those_with(self, tmp_path: Path) -> None:
        """They are told apart, as the proof does."""
        text = TETRAHEDRON.replace("f 1 3 2", "vn 0 0 -1\nf 1//1 3//1 2//1", 1)
        mesh = read_mesh(write(tmp_path / "n.obj", text))
        vertices, faces, normals = read_geometry(tmp_path / "n.obj")
        assert len(mesh.vertices) == len(vertices) == 7
        assert np.array_equal(mesh.vertices[mesh.faces], vertices[faces])
        assert np.array_equal(np.unique(normals, axis=0), [[0, 0, -1], [0, 0, 0]])

    def test_hard_edges_of_a_glb_stay(self, tmp_path: Path) -> None:
        box = trimesh.creation.box()
        box.unmerge_vertices()
        assert box.vertex_normals.shape == (36, 3)  # computing them makes the exporter write them
        box.export(tmp_path / "hard.glb")
        mesh = read_mesh(tmp_path / "hard.glb")
        assert len(mesh.vertices) == 24
        normals = vertex_normals(mesh)
        assert np.allclose(np.sort(np.abs(normals), axis=1), [0, 0, 1])

    def test_geometries_that_meet_under_different_nodes_join_smoothly(self, tmp_path: Path) -> None:
        square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
        faces = np.array([(0, 1, 2), (0, 2, 3)])
        turn = np.array([(0, 0, 1, 1), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1)], dtype=float)
        scene = trimesh.Scene()
        for vertices, matrix in ((square, np.eye(4)), (square @ turn[:3, :3], turn)):
            part = trimesh.Trimesh(vertices, faces, process=False)
            assert len(part.vertex_normals) == 4  # computed, and so exported
            scene.add_geometry(part, transform=matrix)
        scene.export(tmp_path / "g.glb")
        mesh = read_mesh(tmp_path / "g.glb")
        assert np.array_equal(mesh.bounds, [(0, 0, 0), (2, 1, 0)])
        assert len(mesh.vertices) == 6

    def test_first_alike_against_a_plain_loop(self) -> None:
        rng = np.random.default_rng(4)
        places = rng.integers(0, 3, (300, 3)).astype(float)
        normals = np.eye(3)[rng.integers(0, 3, 300)] + rng.uniform(-2e-4, 2e-4, (300, 3))
        expected: list[int] = []
        for i in range(300):
            heads = sorted(set(expected))
            same = (
                j
                for j in heads
                if (places[i] == places[j]).all()
                and np.linalg.norm(normals[i] - normals[j]) <= NORMAL_TOLERANCE
            )
            expected.append(next(same, i))
        assert np.array_equal(first_alike(places, normals), expected)


class TestColours:
    @pytest.mark.parametrize("kind", ["ply", "obj"])
    def test_vertex_colours_are_exact(self, tmp_path: Path, kind: str) -> None:
        ball = sphere()
        colors = np.random.default_rng(0).integers(0, 256, (len(ball.vertices), 4), dtype=np.uint8)
        ball.visual.vertex_colors = colors
        ball.export(tmp_path / f"b.{kind}")
        mesh = read_mesh(tmp_path / f"b.{kind}")
        assert mesh.vertex_colors is not None
        order = np.lexsort(np.round(mesh.vertices, 5).T)
        expected = np.lexsort(np.round(ball.vertices, 5).T)
        assert np.array_equal(mesh.vertex_colors[order], colors[expected, :3])

    def test_obj_vertex_colours_survive_a_plain_material(self, tmp_path: Path) -> None:
        write(tmp_path / "m.mtl", "newmtl a\nKd 0.1 0.1 0.1\n")
        v = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1 0.2 0.4 0.6\n"
        text = "mtllib m.mtl\n" + v + "usemtl a\nf 1 3 2\nf 1 2 4\n"
        mesh = read_mesh(write(tmp_path / "v.obj", text))
        assert mesh.vertex_colors is not None
        assert {tuple(c) for c in mesh.vertex_colors.tolist()} == {
            (255, 0, 0), (0, 255, 0), (0, 0, 255), (51, 102, 153),
        }  # fmt: skip

    def test_gltf_vertex_colours_are_linear(self, tmp_path: Path) -> None:
        ball = sphere()
        srgb = np.array([200, 100, 50])
        linear = np.round(srgb_to_linear(srgb / 255) * 255).astype(np.uint8)
        ball.visual.vertex_colors = np.tile([*linear, 255], (len(ball.vertices), 1))
        ball.export(tmp_path / "b.glb")
        mesh = read_mesh(tmp_path / "b.glb")
        assert mesh.vertex_colors is not None
        assert np.abs(mesh.vertex_colors.astype(int) - srgb).max() <= 2

    def test_face_colours_of_a_ply(self, tmp_path: Path) -> None:
        ball = sphere()
        ball.visual.face_colors = np.tile([10, 20, 30, 255], (len(ball.faces), 1))
        ball.export(tmp_path / "f.ply")
        colors = read_mesh(tmp_path / "f.ply").vertex_colors
        assert colors is not None
        assert (colors == [10, 20, 30]).all()

    @pytest.mark.parametrize(
        ("kd", "color"),
        [("Kd 0.2 0.4 0.6", (0.2, 0.4, 0.6)), ("Kd 0.5", (0.5, 0.5, 0.5)), ("", (0.8, 0.8, 0.8))],
    )
    def test_colour_of_an_mtl(self, tmp_path: Path, kd: str, color: tuple) -> None:
        write(tmp_path / "m.mtl", f"newmtl skin tone\n{kd}\n")
        text = "mtllib m.mtl\nusemtl skin tone\n" + TETRAHEDRON
        mesh = read_mesh(write(tmp_path / "m.obj", text))
        assert [m.color for m in mesh.materials] == [pytest.approx(color)]
        assert mesh.materials[0].texture is None

    def test_only_material_needs_no_usemtl(self, tmp_path: Path) -> None:
        write(tmp_path / "m.mtl", "newmtl skin\nKd 0.2 0.4 0.6\n")
        mesh = read_mesh(write(tmp_path / "m.obj", "mtllib m.mtl\n" + TETRAHEDRON))
        assert [m.color for m in mesh.materials] == [pytest.approx((0.2, 0.4, 0.6))]

    def test_materials_of_an_obj_keep_their_faces(self, tmp_path: Path) -> None:
        write(tmp_path / "m.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n")
        lines = TETRAHEDRON.splitlines()
        text = "\n".join(["mtllib m.mtl", *lines[:4], "usemtl a", *lines[4:5], "usemtl b"])
        mesh = read_mesh(write(tmp_path / "m.obj", text + "\n" + "\n".join(lines[5:]) + "\n"))
        assert len(mesh.vertices) == 4
        colors = np.array([m.color for m in mesh.materials])[mesh.face_material]
        normals = np.cross(*np.diff(mesh.vertices[mesh.faces], axis=1).transpose(1, 0, 2))
        below = normals[:, 2] < -0.5  # the first face, f 1 3 2
        assert below.sum() == 1
        assert (colors[below] == [1, 0, 0]).all()
        assert (colors[~below] == [0, 1, 0]).all()


class TestTextures:
    def textured(self, folder: Path, name: str = "t.png", kd: str = "Kd 1") -> Path:
        """An OBJ as THuman2.0's, but small."""
        write(folder / "material0.mtl", f"newmtl material_0\n{kd}\nKs 0.4\nmap_Kd {name}\n")
        text = cylinder_obj().replace("f 1", "usemtl material_0\nf 1", 1)
        return write(folder / "scan.obj", "mtllib material0.mtl\n" + text)

    def test_obj_as_thuman_has_it(self, tmp_path: Path) -> None:
        Image.fromarray(TEXELS).save(tmp_path / "t.png")
        mesh, files = read_mesh_and_files(self.textured(tmp_path))
        same_texels(mesh.materials[0].texture)
        assert len(mesh.materials) == 1
        assert files == (Path("material0.mtl"), Path("t.png"))

    def test_only_texture_needs_no_usemtl(self, tmp_path: Path) -> None:
        Image.fromarray(TEXELS).save(tmp_path / "t.png")
        path = self.textured(tmp_path)
        expected = read_mesh(path)
        path.write_text(path.read_text().replace("usemtl material_0\n", ""))
        mesh = read_mesh(path)
        same_texels(mesh.materials[0].texture)
        assert len(mesh.materials) == 1
        assert np.array_equal(mesh.uv, expected.uv)

    @pytest.mark.parametrize("name", ["tex/a b.png", r"tex\a b.png", '"tex/a b.png"'])
    def test_name_with_folder_and_blank(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "tex").mkdir()
        Image.fromarray(TEXELS).save(tmp_path / "tex" / "a b.png")
        mesh, files = read_mesh_and_files(self.textured(tmp_path, name))
        same_texels(mesh.materials[0].texture)
        assert Path("tex/a b.png") in files

    def test_texture_through_links(self, tmp_path: Path) -> None:
        (tmp_path / "original").mkdir()
        Image.fromarray(TEXELS).save(tmp_path / "original" / "t.png")
        self.textured(tmp_path / "original")
        (tmp_path / "linked").mkdir()
        for path in (tmp_path / "original").iterdir():
            (tmp_path / "linked" / path.name).symlink_to(path)
        mesh = read_mesh(tmp_path / "linked" / "scan.obj")
        same_texels(mesh.materials[0].texture)

    @pytest.mark.parametrize("mode", ["RGBA", "P", "L", "LA"])
    def test_any_8_bit_image_becomes_rgb(self, tmp_path: Path, mode: str) -> None:
        gray = np.repeat(TEXELS[..., :1], 3, axis=2)
        source = gray if mode.startswith("L") else TEXELS
        image = Image.fromarray(source)
        image = image.quantize(4) if mode == "P" else image.convert(mode)
        if "A" in mode:
            image.putalpha(128)
        image.save(tmp_path / "t.png")
        texture = read_mesh(self.textured(tmp_path)).materials[0].texture
        assert texture is not None
        assert texture.dtype == np.uint8
        assert np.array_equal(texture, source)

    def test_ply_texture(self, tmp_path: Path) -> None:
        Image.fromarray(TEXELS).save(tmp_path / "t.png")
        text = (
            "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\n"
            "property float x\nproperty float y\nproperty float z\nelement face 2\n"
            "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
            "end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
            "3 0 2 1 6 0 0 0 1 1 0\n3 0 1 3 6 0.5 0.5 1 0.5 0.5 1\n"
        )
        mesh = read_mesh(write(tmp_path / "t.ply", text))
        same_texels(mesh.materials[0].texture)
        assert len(mesh.vertices) == 4
        assert mesh.uv is not None
        where = {
            tuple(np.round(uv, 2)): tuple(v)
            for uv, v in zip(
                mesh.uv.reshape(-1, 2), mesh.vertices[mesh.faces].reshape(-1, 3), strict=True
            )
        }
        assert where == {
            (0, 0): (0, 0, 0), (0, 1): (0, 1, 0), (1, 0): (1, 0, 0),
            (0.5, 0.5): (0, 0, 0), (1, 0.5): (1, 0, 0), (0.5, 1): (0, 0, 1),
        }  # fmt: skip

    def glb(self, path: Path) -> Path:
        """A textured ball, and a red one scaled, mirrored and put aside by its node."""
        ball = sphere()
        uv = np.random.default_rng(1).uniform(size=(len(ball.vertices), 2))
        texture = PBRMaterial(name="cloth", baseColorTexture=Image.fromarray(TEXELS))
        ball.visual = TextureVisuals(uv=uv, material=texture)
        red = sphere()
        plain = PBRMaterial(name="red", baseColorFactor=[255, 0, 0, 255])
        red.visual = TextureVisuals(material=plain)
        scene = trimesh.Scene()
        scene.add_geometry(ball)
        matrix = np.diag([-0.5, 0.5, 0.5, 1.0])
        matrix[:3, 3] = 10, 0, 0
        scene.add_geometry(red, transform=matrix)
        scene.export(path)
        return path

    def test_glb_of_two_materials_and_a_mirrored_node(self, tmp_path: Path) -> None:
        mesh = read_mesh(self.glb(tmp_path / "two.glb"))
        check_winding(mesh)
        right = mesh.vertices[mesh.faces][:, 0, 0] > 5
        assert right.sum() == (~right).sum() == len(sphere().faces)
        placed = mesh.vertices[mesh.vertices[:, 0] > 5]
        assert np.allclose([placed.min(0), placed.max(0)], [[9.5, -0.5, -0.5], [10.5, 0.5, 0.5]])
        outside = trimesh.Trimesh(mesh.vertices, mesh.faces[right], process=False)
        assert outside.volume > 0
        for face, material in zip(right, mesh.face_material, strict=True):
            found = mesh.materials[material]
            if face:
                assert found.texture is None
                assert found.color == pytest.approx((1, 0, 0))
            else:
                same_texels(found.texture)

    def test_gltf_texture_coordinates_run_upwards(self, tmp_path: Path) -> None:
        ball = sphere()
        uv = np.stack([ball.vertices[:, 0], ball.vertices[:, 1]], axis=1)
        material = PBRMaterial(baseColorTexture=Image.fromarray(TEXELS))
        ball.visual = TextureVisuals(uv=uv, material=material)
        ball.export(tmp_path / "b.glb")
        mesh = read_mesh(tmp_path / "b.glb")
        assert mesh.uv is not None
        assert np.allclose(mesh.uv, mesh.vertices[mesh.faces][..., :2], atol=1e-6)

    def test_gltf_factor_darkens_the_texture_in_linear_light(self, tmp_path: Path) -> None:
        ball = sphere()
        material = PBRMaterial(
            baseColorTexture=Image.new("RGB", (2, 2), (255, 255, 200)),
            baseColorFactor=np.array([128, 255, 128, 255], dtype=np.uint8),
        )
        ball.visual = TextureVisuals(uv=ball.vertices[:, :2], material=material)
        ball.export(tmp_path / "b.glb")
        texture = read_mesh(tmp_path / "b.glb").materials[0].texture
        assert texture is not None
        linear = srgb_to_linear(texture[0, 0] / 255)
        expected = srgb_to_linear(np.array([255, 255, 200]) / 255) * [128 / 255, 1, 128 / 255]
        assert np.allclose(linear, expected, atol=0.005)


def with_header(data: bytes, changes: dict) -> bytes:
    """The GLB with keys of its JSON replaced."""
    (length,) = struct.unpack_from("<I", data, 12)
    text = json.dumps(json.loads(data[20 : 20 + length]) | changes).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    whole = 20 + len(text) + len(rest)
    return struct.pack("<4sIII4s", b"glTF", 2, whole, len(text), b"JSON") + text + rest


def truncated(data: bytes) -> bytes:
    return data[: len(data) * 2 // 3]


def one_line(error: pytest.ExceptionInfo, *parts: object) -> None:
    message = str(error.value)
    assert "\n" not in message
    for part in parts:
        assert str(part) in message


class TestErrors:
    @pytest.mark.parametrize("kind", ["ply", "glb", "stl"])
    def test_truncated_binary(self, tmp_path: Path, kind: str) -> None:
        path = tmp_path / f"cut.{kind}"
        path.write_bytes(truncated(sphere().export(file_type=kind)))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "truncated", "again")

    def test_truncated_ascii_ply(self, tmp_path: Path) -> None:
        lines = sphere().export(file_type="ply", encoding="ascii").splitlines()
        path = tmp_path / "cut.ply"
        path.write_bytes(b"\n".join(lines[:-7]) + b"\n")
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "is truncated: 313 of 320 face rows", "copy it again")

    @pytest.mark.parametrize("kind", ["double", "float", "uchar"])
    def test_ply_with_indices_of_any_type(self, tmp_path: Path, kind: str) -> None:
        text = sphere().export(file_type="ply", encoding="ascii").decode()
        assert "property list uchar int vertex_indices" in text
        path = write(tmp_path / "p.ply", text.replace("uchar int vertex", f"uchar {kind} vertex"))
        assert np.array_equal(
            read_mesh(path).faces, read_mesh(write(tmp_path / "i.ply", text)).faces
        )

    @pytest.mark.parametrize("first", [3, 4])
    def test_binary_ply_of_triangles_and_quads(self, tmp_path: Path, first: int) -> None:
        faces = [f if i else f[:first] for i, f in enumerate([*CUBE_F, (0, 3, 2)])]
        path = tmp_path / "mixed.ply"
        path.write_bytes(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(CUBE_V)}\n"
            f"property float x\nproperty float y\nproperty float z\nelement face {len(faces)}\n"
            "property list uchar int vertex_indices\nend_header\n".encode()
            + np.array(CUBE_V, "<f4").tobytes()
            + b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
        )
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "mixes triangles with other polygons", "triangulate it on export")

    @pytest.mark.parametrize("kind", EXTENSIONS)
    def test_garbage(self, tmp_path: Path, kind: str) -> None:
        path = tmp_path / f"noise{kind}"
        path.write_bytes(np.random.default_rng(0).bytes(5000))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path)

    @pytest.mark.parametrize("kind", EXTENSIONS)
    def test_empty_file(self, tmp_path: Path, kind: str) -> None:
        path = write(tmp_path / f"empty{kind}", "")
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path)

    @pytest.mark.parametrize(("good", "bad"), [("v 0 1 0", "v 0 one 0"), ("f 1 4 3", "f x 4 3")])
    def test_words_among_the_numbers(self, tmp_path: Path, good: str, bad: str) -> None:
        path = write(tmp_path / "w.obj", TETRAHEDRON.replace(good, bad))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "export it again")

    def test_unknown_extension(self, tmp_path: Path) -> None:
        path = write(tmp_path / "a.fbx", "")
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "'.fbx'", *EXTENSIONS)

    def test_no_such_file(self, tmp_path: Path) -> None:
        with pytest.raises(MeshError) as error:
            read_mesh(tmp_path / "none.obj")
        one_line(error, tmp_path / "none.obj", "check the path")

    def test_nan_vertex_of_an_obj(self, tmp_path: Path) -> None:
        path = write(tmp_path / "n.obj", TETRAHEDRON.replace("v 0 1 0", "v 0 nan 0"))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "1 of 4 vertices are NaN", "clean the mesh")

    @pytest.mark.parametrize("encoding", ["ascii", "binary"])
    def test_nan_vertex_of_a_ply(self, tmp_path: Path, encoding: str) -> None:
        ball = sphere()
        vertices = np.array(ball.vertices)
        vertices[3] = np.nan
        bad = trimesh.Trimesh(vertices, ball.faces, process=False)
        path = tmp_path / "n.ply"
        path.write_bytes(bad.export(file_type="ply", encoding=encoding))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "NaN", "clean the mesh")

    def test_points_without_faces(self, tmp_path: Path) -> None:
        trimesh.PointCloud(sphere().vertices).export(tmp_path / "cloud.ply")
        write(tmp_path / "cloud.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")
        for name in ("cloud.ply", "cloud.obj"):
            with pytest.raises(MeshError) as error:
                read_mesh(tmp_path / name)
            one_line(error, tmp_path / name, "export its triangles")

    def test_only_degenerate_faces(self, tmp_path: Path) -> None:
        path = write(tmp_path / "d.obj", "v 0 0 0\nv 1 0 0\nf 1 1 2\n")
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "no faces with an area")

    @pytest.mark.parametrize(
        ("face", "fault"),
        [
            ("f 1 2 77", "names v 77, but there are 4"),
            ("f 1 2 5", "names v 5, but there are 4"),
            ("f 1 2 -5", "names v -5, but there are 4"),
            ("f 0 1 2", "names v 0, but there are 4, counted from 1"),
            ("f 1/1 2/2 3/4", "names vt 4, but there are 3"),
            ("f 1/1 2/2 3/-4", "names vt -4, but there are 3"),
            ("f 1/1 2/0 3/3", "names vt 0, but there are 3"),
            ("f 1//1 2//1 3//3", "names vn 3, but there are 2"),
            ("f 1/1/1 2/2/1 3/3/-3", "names vn -3, but there are 2"),
            ("f 1/1/1 2/2/1 3/3/9999999999999999999999", "names vn 9223372036854775807"),
            ("f 1/1/1/1 2/2/1/1 3/3/1/1", "damaged"),
            ("f 1 2 -1\nv 9 9 9\nf -6 1 2", "names v -6, but there are 5"),
            ("f 1 2 -9223372036854775808\nv 9 9 9", "names v -9223372036854775808"),
            ("f 1//-9223372036854775808 2//1 3//1", "names vn -9223372036854775808"),
            ("f 1/1/1/ 2 3", "a corner of more than v/vt/vn"),
            ("f 1 2 /3", "a corner that begins with no number"),
            ("f 1-2 2 3", "damaged"),
            ("f 1 2 3\nv 1 2", "a line 'v' that is not 3 numbers or more"),
            ("f 1//1 2//1 3//1\nvn 1", "a line 'vn' that is not 3 numbers or more"),
            ("f 1 2 3\nv 1-2 3 4", "damaged"),
        ],
    )
    def test_face_beyond_what_the_obj_holds(self, tmp_path: Path, face: str, fault: str) -> None:
        more = "vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nvn 0 1 0\n"
        path = write(tmp_path / "b.obj", TETRAHEDRON.replace("f 1 3 2", f"{more}{face}", 1))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, fault, "again")

    def test_vertices_between_faces_of_several_forms(self, tmp_path: Path) -> None:
        more = "vt 0 0\nvn 0 0 1\nf 1/1/1 3/1/1 2/1/1\nv 1 1 1\nf 2//1 3//1 5//1\n"
        assert len(read_mesh(write(tmp_path / "b.obj", TETRAHEDRON + more)).faces) == 6

    @pytest.mark.parametrize("index", [-1, 4])
    def test_face_beyond_the_vertices_of_a_ply(self, tmp_path: Path, index: int) -> None:
        head = "ply\nformat {} 1.0\nelement vertex 3\n" + "".join(
            f"property float {name}\n" for name in "xyzst"
        )
        head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        corners = np.array([(0, 0, 0, 0, 0), (1, 0, 0, 1, 0), (0, 1, 0, 0, 1)], "<f4")
        binary = corners.tobytes() + struct.pack("<B3i", 3, 0, 1, index)
        rows = "".join(f"{' '.join(map(str, row))}\n" for row in corners)
        for name, data in {
            "ascii": (head.format("ascii") + rows + f"3 0 1 {index}\n").encode(),
            "binary": head.format("binary_little_endian").encode() + binary,
        }.items():
            path = tmp_path / f"{name}.ply"
            path.write_bytes(data)
            with pytest.raises(MeshError) as error:
                read_mesh(path)
            one_line(error, path, "again")

    def test_missing_mtl(self, tmp_path: Path) -> None:
        path = write(tmp_path / "m.obj", "mtllib gone.mtl\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "'gone.mtl'", "put that file there")

    @pytest.mark.parametrize(
        "name", ["../m.mtl", "/m.mtl", "a/../../m.mtl", "C:m.mtl", "C:\\m.mtl", "..\\m.mtl"]
    )
    def test_mtl_outside(self, tmp_path: Path, name: str) -> None:
        write(tmp_path / "m.mtl", "newmtl skin\n")
        path = write(tmp_path / "scan" / "m.obj", f"mtllib {name}\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, f"'{name}'", "outside its folder")

    def test_blanks_without_end(self, tmp_path: Path) -> None:
        blanks = " \t" * 200_000
        start = time.perf_counter()
        read_mesh(write(tmp_path / "m.obj", f"mtllib {blanks}\nusemtl{blanks}\n" + TETRAHEDRON))
        for head in (f"comment{blanks}\n", f"comment texturefile {blanks}\n"):
            with pytest.raises(MeshError, match="its header has no end"):
                read_mesh(write(tmp_path / "m.ply", f"ply\nformat ascii 1.0\n{head}end_header\n"))
        assert time.perf_counter() - start < 5  # by backtracking it would be hours

    def test_undefined_material(self, tmp_path: Path) -> None:
        write(tmp_path / "m.mtl", "newmtl skin\n")
        path = write(tmp_path / "m.obj", "mtllib m.mtl\nusemtl cloth\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "'cloth'", "'m.mtl'")

    def test_materials_that_no_face_uses(self, tmp_path: Path) -> None:
        write(tmp_path / "m.mtl", "newmtl skin\nnewmtl cloth\n")
        path = write(tmp_path / "m.obj", "mtllib m.mtl\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "none of the 2 materials of 'm.mtl'", "usemtl")

    def test_mtl_line_that_is_no_colour(self, tmp_path: Path) -> None:
        for line in ("Kd pale", "Kd nan 0 0", "Kd 1 2"):
            write(tmp_path / "m.mtl", f"newmtl skin\n{line}\n")
            path = write(tmp_path / "m.obj", "mtllib m.mtl\nusemtl skin\n" + TETRAHEDRON)
            with pytest.raises(MeshError) as error:
                read_mesh(path)
            one_line(error, path, "'m.mtl'", f"'{line}'")

    @pytest.mark.parametrize(
        ("name", "reason"),
        [
            ("gone.png", "put that file there"),
            ("../outside.png", "outside its folder"),
            ("sub/../../outside.png", "outside its folder"),
            ("/etc/hostname", "outside its folder"),
            ("C:\\scans\\a.png", "outside its folder"),
            ("..\\outside.png", "outside its folder"),
            ("\\scans\\a.png", "outside its folder"),
            (".", "no regular file"),
            ("pipe", "no regular file"),
            ("x" * 5000, "cannot be opened"),
            ("a\x00b", "cannot be opened"),
            ("script.eps", "no readable image"),
            ("noise.png", "no readable image"),
            ("cut.png", "cannot be decoded"),
            ("deep.png", "8-bit RGB"),
        ],
    )
    def test_bad_texture(self, tmp_path: Path, name: str, reason: str) -> None:
        folder = tmp_path / "scan"
        folder.mkdir()
        Image.fromarray(TEXELS).save(tmp_path / "outside.png")
        (folder / "noise.png").write_bytes(b"no image at all")
        os.mkfifo(folder / "pipe")
        Image.new("RGB", (2, 2)).save(folder / "script.eps")
        pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, "png")
        (folder / "cut.png").write_bytes(truncated(buffer.getvalue()))
        Image.fromarray(pixels[..., 0].astype(np.uint16) * 257).save(folder / "deep.png")
        path = TestTextures().textured(folder, name)
        shown = name[:300] if name.isprintable() else ""
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, shown, reason)
        write(
            folder / "p.ply",
            f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 3\n"
            "property float x\nproperty float y\nproperty float z\nproperty float s\n"
            "property float t\nelement face 1\nproperty list uchar int vertex_indices\n"
            "end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
        )
        with pytest.raises(MeshError) as error:
            read_mesh(folder / "p.ply")
        one_line(error, folder / "p.ply", shown, reason)

    def test_texture_without_coordinates(self, tmp_path: Path) -> None:
        Image.fromarray(TEXELS).save(tmp_path / "t.png")
        write(tmp_path / "m.mtl", "newmtl a\nmap_Kd t.png\n")
        path = write(tmp_path / "u.obj", "mtllib m.mtl\nusemtl a\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "no texture coordinates", "unwrap")

    def test_broken_image_in_a_glb(self, tmp_path: Path) -> None:
        data = TestTextures().glb(tmp_path / "g.glb").read_bytes()
        assert data.count(b"\x89PNG") == 1
        (tmp_path / "g.glb").write_bytes(data.replace(b"\x89PNG", b"\x00PNG"))
        with pytest.raises(MeshError) as error:
            read_mesh(tmp_path / "g.glb")
        one_line(error, tmp_path / "g.glb", "no readable image")

    def test_compressed_glb(self, tmp_path: Path) -> None:
        data = sphere().export(file_type="glb")
        path = tmp_path / "draco.glb"
        path.write_bytes(with_header(data, {}))
        assert len(read_mesh(path).faces) == 320
        required = {"extensionsRequired": ["KHR_draco_mesh_compression"]}
        path.write_bytes(with_header(data, required))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "KHR_draco_mesh_compression")

    @pytest.mark.parametrize(
        "how", [{"texCoord": 1}, {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}]
    )
    def test_moved_texture_of_a_glb(self, tmp_path: Path, how: dict) -> None:
        path = TestTextures().glb(tmp_path / "g.glb")
        material = {"name": "cloth", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        material["pbrMetallicRoughness"]["baseColorTexture"] |= how  # type: ignore[index]
        path.write_bytes(with_header(path.read_bytes(), {"materials": [material, {}]}))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "'cloth'", "bake")

    def test_gltf_without_its_buffer(self, tmp_path: Path) -> None:
        files = trimesh.Scene(sphere()).export(file_type="gltf")
        (tmp_path / "model.gltf").write_bytes(files["model.gltf"])
        with pytest.raises(MeshError) as error:
            read_mesh(tmp_path / "model.gltf")
        one_line(error, tmp_path / "model.gltf", ".bin", "put that file there")


def triangle_glb(changes: dict | None = None, binary: bytes | None = None) -> bytes:
    """A GLB of one triangle with keys of its JSON replaced."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "<f4").tobytes()
    binary = points + np.arange(3, dtype="<u4").tobytes() if binary is None else binary
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }
    bare = struct.pack("<4sIII4s", b"glTF", 2, 0, 2, b"JSON") + b"{}"
    bare += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return with_header(bare, header | (changes or {}))


def mesh_of(**primitive: object) -> dict:
    return {
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, **primitive}]}]
    }


def accessor(**changes: object) -> dict:
    """The triangle's accessors, its positions' one changed; None takes a key away."""
    positions = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", **changes}
    positions = {key: value for key, value in positions.items() if value is not None}
    indices = {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
    return {"accessors": [positions, indices]}


SPARSE = {
    "count": 1,
    "indices": {"bufferView": 1, "componentType": 5125},
    "values": {"bufferView": 0},
}


class TestBrokenGlb:
    def test_triangle_is_sound(self, tmp_path: Path) -> None:
        (tmp_path / "t.glb").write_bytes(triangle_glb())
        assert len(read_mesh(tmp_path / "t.glb").faces) == 1

    @pytest.mark.parametrize(
        ("changes", "fault"),
        [
            ({"meshes": [], "nodes": [{}]}, "holds no surface"),
            ({"scenes": [{}]}, "holds no surface"),
            (mesh_of(mode=0), "holds no surface, only points"),
            (mesh_of(mode=1), "holds no surface"),
            (mesh_of(mode=6), "triangle fans"),
            (mesh_of(indices=7), "names accessors[7], but has 2 accessors"),
            (mesh_of(indices=-1), "names accessors[-1]"),
            (mesh_of(attributes={"POSITION": 2}), "names accessors[2]"),
            (mesh_of(attributes={"POSITION": 0, "TEXCOORD_0": 1}), "are no floats"),
            (mesh_of(material=0), "names materials[0], but has 0"),
            ({"nodes": [{"mesh": 3}]}, "names meshes[3]"),
            ({"nodes": [{"mesh": 0, "children": [1]}]}, "names nodes[1], but has 1"),
            ({"nodes": [{"mesh": 0, "children": [0]}]}, "nodes[0] twice"),
            ({"nodes": [{"children": [1]}, {"mesh": 0, "children": [0]}]}, "nodes[0] twice"),
            ({"nodes": [{"children": [1, 1]}, {"mesh": 0}]}, "nodes[1] twice"),
            ({"scenes": [{"nodes": [0, 0]}]}, "nodes[0] twice"),
            ({"scene": 1}, "names scenes[1]"),
            ({"nodes": [{"mesh": 0, "scale": [1, 0, 1]}]}, "no size along an axis"),
            ({"nodes": [{"mesh": 0, "translation": [float("nan"), 0, 0]}]}, "are NaN"),
            ({"nodes": [{"mesh": 0, "scale": [float("nan"), 1, 1]}]}, "are NaN"),
            ({"nodes": [{"mesh": 0, "matrix": [1, 2]}]}, "damaged"),
            (accessor(count=4), "accessors[0] has 4 rows to byte 48 of its view's 36"),
            (accessor(count=0), "accessors[0] has 0 rows"),
            (accessor(count=-1), "has -1 for a count"),
            (accessor(count=3.0), "has 3.0 for a count"),
            (accessor(byteOffset=-12), "has -12 for a byteOffset"),
            (accessor(componentType=1), "unknown type"),
            (accessor(sparse=SPARSE), "sparse accessor for POSITION"),
            (accessor(bufferView=None), "no faces with an area"),
            (accessor(bufferView=None, count=10**9), "claim 1.2e+04 MB, more than 1024"),
            (accessor(bufferView=None, count=10**9, sparse=SPARSE), "subjects.limits.mesh_mb"),
            ({"bufferViews": [{"buffer": 0, "byteLength": 49}] * 2}, "ends at byte 49 of 48"),
            ({"bufferViews": [{"buffer": 1, "byteLength": 9}] * 2}, "names buffers[1], but has 1"),
            ({"extras": [0] * JSON_VALUES}, f"values, more than {JSON_VALUES}"),
            ({"nodes": [{"mesh": 0}] * (PARTS + 1), "scenes": [{"nodes": [*range(PARTS + 1)]}]},
             f"more than {PARTS}; join them"),
        ],
    )  # fmt: skip
    def test_layout(self, tmp_path: Path, changes: dict, fault: str) -> None:
        path = tmp_path / "t.glb"
        path.write_bytes(triangle_glb(changes))
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, fault)

    @pytest.mark.parametrize(
        ("place", "replaced", "fault"),
        [
            (0, b"glTf", "does not begin with 'glTF'"),
            (4, b"\x01\0\0\0", "only GLTF 2"),
            (8, b"\xff\xff\0\0", "is truncated"),
            (12, b"\xff\xff\xff\x7f", "its JSON should have 2147483647 bytes"),
            (16, b"JSOM", "no initial JSON header"),
            (20, b"[[[[", "no GLB file"),
        ],
    )
    def test_framing(self, tmp_path: Path, place: int, replaced: bytes, fault: str) -> None:
        data = triangle_glb()
        path = tmp_path / "t.glb"
        path.write_bytes(data[:place] + replaced + data[place + len(replaced) :])
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, fault)

    @pytest.mark.parametrize("text", ["[" * 500_000, "{}", "[]", "7", '{"buffers": 3}'])
    def test_json_of_a_gltf(self, tmp_path: Path, text: str) -> None:
        path = write(tmp_path / "t.gltf", text)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path)

    def test_nan_vertex(self, tmp_path: Path) -> None:
        points = np.array([(0, 0, 0), (1, np.nan, 0), (0, 1, 0)], "<f4").tobytes()
        path = tmp_path / "t.glb"
        path.write_bytes(triangle_glb(binary=points + np.arange(3, dtype="<u4").tobytes()))
        with pytest.raises(MeshError, match="1 of 3 vertices are NaN"):
            read_mesh(path)

    def test_nodes_nested_deep(self, tmp_path: Path) -> None:
        depth = 5000
        nodes: list[dict] = [{"translation": [1, 0, 0], "children": [i + 1]} for i in range(depth)]
        (tmp_path / "t.glb").write_bytes(triangle_glb({"nodes": [*nodes, {"mesh": 0}]}))
        assert np.array_equal(read_mesh(tmp_path / "t.glb").bounds[0], (depth, 0, 0))

    @pytest.mark.parametrize(
        "uri",
        ["../o.bin", "%2e%2e/o.bin", "%2E%2E%2Fo.bin", "..%5Co.bin", "%2Fo.bin", "C%3A%5Co.bin"],
    )
    def test_buffer_outside(self, tmp_path: Path, uri: str) -> None:
        files = trimesh.Scene(sphere()).export(file_type="gltf")
        header = json.loads(files["model.gltf"])
        (tmp_path / "o.bin").write_bytes(files[header["buffers"][0]["uri"]])
        for key in ("buffers", "images"):
            changed = header | {key: [{"byteLength": 9, "uri": uri}]}
            path = write(tmp_path / "scan" / "m.gltf", json.dumps(changed))
            for name, data in files.items():
                (path.parent / name).write_bytes(data)
            with pytest.raises(MeshError) as error:
                read_mesh(path)
            one_line(error, path, "outside its folder")

    def test_buffer_of_a_percent_encoded_name(self, tmp_path: Path) -> None:
        files = trimesh.Scene(sphere()).export(file_type="gltf")
        header = json.loads(files["model.gltf"])
        (tmp_path / "a b.bin").write_bytes(b"".join(files[b["uri"]] for b in header["buffers"][:1]))
        header["buffers"][0]["uri"] = "a%20b.bin"
        for buffer in header["buffers"][1:]:
            (tmp_path / buffer["uri"]).write_bytes(files[buffer["uri"]])
        mesh, names = read_mesh_and_files(write(tmp_path / "m.gltf", json.dumps(header)))
        assert len(mesh.faces) == len(sphere().faces)
        assert Path("a b.bin") in names

    @pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
    def test_normals_that_are_no_numbers_are_none(self, tmp_path: Path, value: float) -> None:
        box = trimesh.creation.box()
        normals = np.array(box.vertex_normals)
        normals[3] = value
        data = box.export(file_type="glb", include_normals=True)
        assert data.count(box.vertex_normals.astype("<f4").tobytes()) == 1
        data = data.replace(
            box.vertex_normals.astype("<f4").tobytes(), normals.astype("<f4").tobytes()
        )
        (tmp_path / "n.glb").write_bytes(data)
        assert len(read_mesh(tmp_path / "n.glb").vertices) == 8

    def test_too_many_normals_at_one_place(self) -> None:
        turns = np.linspace(0, 6, NORMALS + 1)
        normals = np.stack([np.sin(turns), np.cos(turns), 0 * turns], axis=1)
        assert len(np.unique(first_alike(np.zeros((NORMALS, 3)), normals[1:]))) == NORMALS
        with pytest.raises(MeshError, match=f"over {NORMALS} normals at one place"):
            first_alike(np.zeros((NORMALS + 1, 3)), normals)


class TestLimits:
    def test_defaults_hold_the_largest_texture(self) -> None:
        Limits().check_pixels(16384 * 16384, "t.png")
        with pytest.raises(MeshError, match=r"270\.5 megapixels, more than 270"):
            Limits().check_pixels(270_500_000, "t.png")

    @pytest.mark.parametrize("value", [0, -1, float("nan"), float("inf")])
    @pytest.mark.parametrize("name", ["mesh_mb", "triangles", "texture_megapixels"])
    def test_no_bound(self, name: str, value: float) -> None:
        with pytest.raises(ValueError, match=rf"^subjects\.limits\.{name}: .*; give a number"):
            Limits(**{name: value})

    @pytest.mark.parametrize("kind", ["obj", "ply", "glb", "stl"])
    def test_size_of_the_file(self, tmp_path: Path, kind: str) -> None:
        path = tmp_path / f"s.{kind}"
        sphere().export(path)
        size = path.stat().st_size / 1e6
        assert len(read_mesh(path, Limits(mesh_mb=size)).faces) == 320
        with pytest.raises(MeshError) as error:
            read_mesh(path, Limits(mesh_mb=0.99 * size))
        one_line(
            error, path, f"up to 's.{kind}' hold {size:.4g} MB", "raise subjects.limits.mesh_mb"
        )

    @pytest.mark.parametrize("kind", ["obj", "ply", "glb", "stl"])
    def test_triangles(self, tmp_path: Path, kind: str) -> None:
        path = tmp_path / f"s.{kind}"
        sphere().export(path)
        assert len(read_mesh(path, Limits(triangles=320)).faces) == 320
        with pytest.raises(MeshError) as error:
            read_mesh(path, Limits(triangles=319))
        one_line(error, path, "has 320 triangles, more than 319", "subjects.limits.triangles")

    def test_polygons_count_as_their_triangles(self, tmp_path: Path) -> None:
        ring = [(np.sin(a), np.cos(a)) for a in np.linspace(0, 6, 50)]
        text = "".join(f"v {x} {y} 0\n" for x, y in ring)
        path = write(tmp_path / "p.obj", text + f"f {' '.join(map(str, range(1, 51)))}\n")
        assert len(read_mesh(path, Limits(triangles=48)).faces) == 48
        with pytest.raises(MeshError, match="has 48 triangles, more than 47"):
            read_mesh(path, Limits(triangles=47))

    def test_instances_count(self, tmp_path: Path) -> None:
        path = tmp_path / "t.glb"
        path.write_bytes(
            triangle_glb({"nodes": [{"mesh": 0}] * 5, "scenes": [{"nodes": [0, 1, 2, 3, 4]}]})
        )
        read_mesh(path, Limits(triangles=5))
        with pytest.raises(MeshError, match="has 5 triangles, more than 4"):
            read_mesh(path, Limits(triangles=4))

    def test_vertices_without_faces_count(self, tmp_path: Path) -> None:
        path = write(tmp_path / "v.obj", TETRAHEDRON + "v 9 9 9\n" * 20)
        read_mesh(path, Limits(triangles=8))
        with pytest.raises(MeshError, match="has 24 vertices, more than 21"):
            read_mesh(path, Limits(triangles=7))

    @pytest.mark.parametrize("element", ["vertex", "face", "strange"])
    def test_claims_of_a_ply(self, tmp_path: Path, element: str) -> None:
        for encoding in ("ascii", "binary_little_endian"):
            head = f"ply\nformat {encoding} 1.0\nelement {element} 4000000000\n"
            path = write(tmp_path / "c.ply", head + "property float x\nend_header\n0\n")
            with pytest.raises(MeshError) as error:
                read_mesh(path)
            one_line(error, path, "has 4000000000", "raise subjects.limits.triangles")

    def test_edges_of_a_ply(self, tmp_path: Path) -> None:
        data = sphere().export(file_type="ply", encoding="ascii").decode()
        edges = "element edge {}\nproperty int vertex1\nproperty int vertex2\nend_header"
        path = write(tmp_path / "e.ply", data.replace("end_header", edges.format(0)))
        assert len(read_mesh(path).faces) == 320
        data = data.replace("end_header", edges.format(1)) + "0 1\n"
        with pytest.raises(MeshError, match="has edges beside its faces; export it without"):
            read_mesh(write(path, data))

    def test_lines_without_end(self, tmp_path: Path) -> None:
        data = sphere().export(file_type="ply", encoding="ascii")
        (tmp_path / "l.ply").write_bytes(data + b"\n" * 5000)
        with pytest.raises(MeshError, match="for 482 rows"):
            read_mesh(tmp_path / "l.ply")

    def test_claims_of_an_stl(self, tmp_path: Path) -> None:
        data = sphere().export(file_type="stl")
        (tmp_path / "c.stl").write_bytes(data[:80] + b"\xff\xff\xff\xff" + data[84:])
        with pytest.raises(MeshError, match="incorrect length in header"):
            read_mesh(tmp_path / "c.stl")

    def test_solids_of_an_stl(self, tmp_path: Path) -> None:
        solid = trimesh.creation.box().export(file_type="stl_ascii") + "\n"
        assert len(read_mesh(write(tmp_path / "s.stl", 3 * solid)).vertices) == 8
        with pytest.raises(MeshError, match="is truncated: 2 of 3 solids end"):
            read_mesh(write(tmp_path / "s.stl", 2 * solid + solid[: len(solid) // 2]))
        many = "solid a\nendsolid a\n" * (SOLIDS + 1)
        with pytest.raises(MeshError, match="export it as one"):
            read_mesh(write(tmp_path / "s.stl", many))

    def test_textures_add_up(self, tmp_path: Path) -> None:
        for name in "ab":
            Image.new("RGB", (40, 30)).save(tmp_path / f"{name}.png")
        before = Image.MAX_IMAGE_PIXELS
        lines = cylinder_obj().replace("f 3", "usemtl b\nf 3", 1).replace("f 1", "usemtl a\nf 1", 1)
        path = write(tmp_path / "t.obj", "mtllib m.mtl\n" + lines)
        write(tmp_path / "m.mtl", "newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd b.png\n")
        assert len(read_mesh(path, Limits(texture_megapixels=0.0024)).materials) == 2
        for bound, name, figure in (
            (0.0023, "b", 0.0024),
            (0.001, "a", 0.0012),
            (5e-4, "a", 0.0012),
        ):
            with pytest.raises(MeshError) as error:
                read_mesh(path, Limits(texture_megapixels=bound))
            cure = "raise subjects.limits.texture_megapixels"
            one_line(error, path, f"'{name}.png'", f"{figure} megapixels", f"than {bound:g};", cure)
        write(tmp_path / "m.mtl", "newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd a.png\n")
        mesh = read_mesh(path, Limits(texture_megapixels=0.0012))
        assert mesh.materials[0].texture is mesh.materials[1].texture
        assert before == Image.MAX_IMAGE_PIXELS

    def test_texture_of_a_glb(self, tmp_path: Path) -> None:
        path = TestTextures().glb(tmp_path / "g.glb")
        read_mesh(path, Limits(texture_megapixels=4e-6))
        for bound in (3e-6, 1e-6):
            with pytest.raises(MeshError) as error:
                read_mesh(path, Limits(texture_megapixels=bound))
            one_line(error, path, "4e-06 megapixels", "subjects.limits.texture_megapixels")

    def test_image_is_bounded_before_it_is_decoded(self, tmp_path: Path) -> None:
        Image.new("L", (1, 1)).save(tmp_path / "t.png")
        data = bytearray((tmp_path / "t.png").read_bytes())
        data[16:24] = struct.pack(">II", 60_000, 60_000)
        data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
        (tmp_path / "t.png").write_bytes(data)
        with pytest.raises(MeshError, match=r"'t\.png' have 3600 megapixels, more than 270"):
            read_mesh(TestTextures().textured(tmp_path))

    def test_named_files_add_up(self, tmp_path: Path) -> None:
        Image.new("RGB", (40, 30)).save(tmp_path / "t.png")
        path = TestTextures().textured(tmp_path)
        size = sum(file.stat().st_size for file in tmp_path.iterdir()) / 1e6
        read_mesh(path, Limits(mesh_mb=size))
        with pytest.raises(MeshError) as error:
            read_mesh(path, Limits(mesh_mb=size - 1e-6))
        one_line(error, path, "up to 't.png' hold", "raise subjects.limits.mesh_mb")

    def test_size_is_asked_before_reading(self, tmp_path: Path) -> None:
        with (tmp_path / "huge.obj").open("wb") as file:
            file.truncate(10**13)  # sparse: it takes no room
        with pytest.raises(MeshError, match="hold 1e\\+07 MB, more than 1024"):
            read_mesh(tmp_path / "huge.obj")

    def test_only_regular_files(self, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe.obj")
        (tmp_path / "folder.ply").mkdir()
        (tmp_path / "zero.stl").symlink_to("/dev/zero")
        for name in ("pipe.obj", "folder.ply", "zero.stl"):
            with pytest.raises(MeshError) as error:
                read_mesh(tmp_path / name)
            one_line(error, tmp_path / name, "no regular file")


class TestDamage:
    """Whatever a damaged file holds, it is a mesh or one line."""

    CASES = 100

    def files(self, folder: Path) -> dict[str, Path]:
        """Small files of every kind; of the OBJ its MTL is damaged too."""
        ball = trimesh.creation.icosphere(subdivisions=1)
        Image.fromarray(TEXELS).save(folder / "t.png")
        obj = TestTextures().textured(folder)
        paths = {"obj": obj, "mtl": folder / "material0.mtl", "png": folder / "t.png"}
        for name in ("s.ply", "s.stl", "s.glb"):
            ball.export(folder / name)
        (folder / "a.ply").write_bytes(ball.export(file_type="ply", encoding="ascii"))
        write(folder / "a.stl", ball.export(file_type="stl_ascii"))
        TestTextures().glb(folder / "t.glb")
        return paths | {path.name: path for path in folder.glob("?.*")}

    @pytest.mark.parametrize(
        "kind", ["obj", "mtl", "png", "s.ply", "a.ply", "s.stl", "a.stl", "s.glb", "t.glb"]
    )
    @pytest.mark.filterwarnings("ignore")
    def test_cuts_and_flips(self, tmp_path: Path, kind: str) -> None:
        path = self.files(tmp_path)[kind]
        mesh = path if path.suffix in EXTENSIONS else tmp_path / "scan.obj"
        sound = path.read_bytes()
        read_mesh(mesh)
        rng = np.random.default_rng(0)
        refused = 0
        for case in range(self.CASES):
            data = bytearray(sound)
            if case % 4 == 0:
                del data[int(rng.integers(len(sound))) :]
            else:  # the head, where counts and names are, as often as all the rest
                reach = len(sound) if case % 2 else min(len(sound), 1000)
                for place in rng.integers(reach, size=int(rng.integers(1, 4))):
                    data[place] = rng.choice([0, 10, 32, 45, 48, 57, 255, data[place] ^ 1])
            path.write_bytes(data)
            try:
                read_mesh(mesh, Limits(mesh_mb=10, triangles=100_000, texture_megapixels=1))
            except MeshError as error:
                assert "\n" not in str(error)  # noqa: PT017
                assert str(error).startswith(f"{mesh}: ")  # noqa: PT017
                refused += 1
        assert refused >= self.CASES // 10


class TestWinding:
    def mesh(self) -> Mesh:
        ball = sphere()
        return Mesh(ball.vertices, ball.faces)

    def test_sound(self) -> None:
        check_winding(self.mesh())
        check_winding(self.mesh().flipped(), flip_faces=True)

    def test_inside_out(self) -> None:
        with pytest.raises(
            MeshError, match=r"signed volume is -4.* set subjects\.flip_faces: true"
        ):
            check_winding(self.mesh().flipped())
        with pytest.raises(MeshError, match=r"set subjects\.flip_faces: false"):
            check_winding(self.mesh(), flip_faces=True)

    def test_share_of_turned_faces(self) -> None:
        def turned(count: int) -> Mesh:
            ball = trimesh.creation.icosphere(subdivisions=4)  # 5,120 faces, 7,680 edges
            far = np.arange(count) * (len(ball.faces) // max(count, 1))
            faces = np.array(ball.faces)
            faces[far] = faces[far, ::-1]
            return Mesh(ball.vertices, faces)

        check_winding(turned(25))  # 75 edges: 0.98 %
        with pytest.raises(MeshError, match=r"at 1\.0% of its edges"):
            check_winding(turned(26))  # 78 edges: 1.02 %

    def test_hard_edges_do_not_hide_a_turned_mesh(self) -> None:
        vertices = self.mesh().vertices[self.mesh().faces].reshape(-1, 3)
        soup = Mesh(vertices, np.arange(len(vertices)).reshape(-1, 3))
        check_winding(soup)
        with pytest.raises(MeshError, match="inside out"):
            check_winding(soup.flipped())

    def test_open_surface_has_no_inside(self) -> None:
        ball = self.mesh()
        upper = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 1] > 0]
        check_winding(Mesh(ball.vertices, upper).flipped())

    def test_holes_and_distance_do_not_change_the_sign(self) -> None:
        ball = self.mesh()
        away = 1000 * ball.vertices[ball.faces[0]].mean(axis=0)
        pierced = Mesh(ball.vertices + away, ball.faces[1:])
        check_winding(pierced)
        with pytest.raises(MeshError, match="inside out"):
            check_winding(pierced.flipped())
