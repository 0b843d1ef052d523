"""Mesh files of every format, as exporters write them and as they break."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from subjects.color import srgb_to_linear
from subjects.mesh import Mesh, MeshError
from subjects.meshfile import EXTENSIONS, check_winding, read_mesh, read_mesh_and_files, texture
from subjects.meshfile.joining import NORMAL_TOLERANCE, first_alike

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

    def test_face_beyond_the_vertices(self, tmp_path: Path) -> None:
        for face in ("f 1 2 77", "f 1 2 -77"):
            path = write(tmp_path / "b.obj", TETRAHEDRON + face + "\n")
            with pytest.raises(MeshError) as error:
                read_mesh(path)
            one_line(error, path, "again")

    def test_missing_mtl(self, tmp_path: Path) -> None:
        path = write(tmp_path / "m.obj", "mtllib gone.mtl\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "'gone.mtl'", "put that file there")

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
        write(tmp_path / "m.mtl", "newmtl skin\nKd pale\n")
        path = write(tmp_path / "m.obj", "mtllib m.mtl\nusemtl skin\n" + TETRAHEDRON)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, "'m.mtl'", "'Kd pale'")

    @pytest.mark.parametrize(
        ("name", "reason"),
        [
            ("gone.png", "put that file there"),
            ("../outside.png", "outside its folder"),
            ("sub/../../outside.png", "outside its folder"),
            ("/etc/hostname", "outside its folder"),
            ("C:\\scans\\a.png", "outside its folder"),
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
        pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, "png")
        (folder / "cut.png").write_bytes(truncated(buffer.getvalue()))
        Image.fromarray(pixels[..., 0].astype(np.uint16) * 257).save(folder / "deep.png")
        path = TestTextures().textured(folder, name)
        with pytest.raises(MeshError) as error:
            read_mesh(path)
        one_line(error, path, name, reason)
        write(
            folder / "p.ply",
            f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 3\n"
            "property float x\nproperty float y\nproperty float z\nproperty float s\n"
            "property float t\nelement face 1\nproperty list uchar int vertex_indices\n"
            "end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
        )
        with pytest.raises(MeshError) as error:
            read_mesh(folder / "p.ply")
        one_line(error, folder / "p.ply", name, reason)

    def test_texture_beyond_the_bound(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        Image.new("RGB", (40, 30)).save(tmp_path / "t.png")
        path = TestTextures().textured(tmp_path)
        before = Image.MAX_IMAGE_PIXELS
        for bound in (1199, 500):  # within twice the bound Pillow only warns
            monkeypatch.setattr(texture, "TEXTURE_PIXELS", bound)
            with pytest.raises(MeshError) as error:
                read_mesh(path)
            one_line(error, path, "'t.png'", f"more than {bound} pixels", "scale it down")
        monkeypatch.setattr(texture, "TEXTURE_PIXELS", 1200)
        assert read_mesh(path).materials[0].texture is not None
        assert before == Image.MAX_IMAGE_PIXELS

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


class TestWinding:
    def mesh(self) -> Mesh:
        ball = sphere()
        return Mesh(ball.vertices, ball.faces)

    def test_sound(self) -> None:
        check_winding(self.mesh())
        check_winding(self.mesh().flipped(), flip_faces=True)

    def test_inside_out(self) -> None:
        with pytest.raises(MeshError, match=r"signed volume is -4.* set subjects flip_faces: true"):
            check_winding(self.mesh().flipped())
        with pytest.raises(MeshError, match="set subjects flip_faces: false"):
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
