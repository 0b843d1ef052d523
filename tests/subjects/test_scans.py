"""A folder of scans as a source, and the subjects it makes."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import jsonargparse
import numpy as np
import pytest
import trimesh
from PIL import Image

from subjects.fits.fits import Fits
from subjects.limits import Limits
from subjects.mesh import Mesh, MeshError
from subjects.scans import Scans
from subjects.subject import Subject

AXES = {
    "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1),
    "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1),
}  # fmt: skip


def person(height: float = 1.8) -> trimesh.Trimesh:
    """A closed body, y up and facing +z: a box, with a nose in front and a left hand at +x."""
    body = trimesh.creation.box(bounds=[[-0.25, 0, -0.15], [0.25, height, 0.15]])
    nose = trimesh.creation.box(bounds=[[-0.02, 0.9 * height, 0.16], [0.02, height - 0.1, 0.2]])
    hand = trimesh.creation.box(bounds=[[0.3, 0.7, -0.05], [0.55, 0.8, 0.05]])
    return trimesh.util.concatenate([body, nose, hand])


def scans(root: Path, **changes: Any) -> Scans:
    return Scans(**{"root": str(root), "up": "y", "front": "z", "unit": "m"} | changes)


def export(mesh: trimesh.Trimesh, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path)
    return path


def textured(folder: Path) -> Path:
    """One person's folder as THuman2.0 lays it out."""
    folder.mkdir(parents=True)
    text = person().export(file_type="obj", include_normals=False, header=None)
    lines = [line for line in text.splitlines() if line.startswith(("v ", "f "))]
    faces = [
        "f " + " ".join(f"{i.split('/')[0]}/1" for i in line.split()[1:])
        for line in lines
        if line.startswith("f ")
    ]
    vertices = [line for line in lines if line.startswith("v ")]
    (folder / f"{folder.name}.obj").write_text(
        "\n".join(["mtllib material0.mtl", *vertices, "vt 0.5 0.5", "usemtl m", *faces]) + "\n"
    )
    (folder / "material0.mtl").write_text("newmtl m\nKd 1\nmap_Kd tex/material0.png\n")
    (folder / "tex").mkdir()
    Image.new("RGB", (3, 2), (1, 2, 3)).save(folder / "tex" / "material0.png")
    return folder / f"{folder.name}.obj"


def one_line(error: pytest.ExceptionInfo, *parts: object) -> None:
    message = str(error.value)
    assert "\n" not in message
    for part in parts:
        assert str(part) in message


class TestIds:
    def test_from_paths(self, tmp_path: Path) -> None:
        names = [
            "0525/0525.obj", "0525/body.obj", "0526/0526.OBJ", "0526/mesh_smplx.obj", "a/b.glb",
            "c.stl", "deep/er/x y.ply", "notes.txt", "._c.stl", ".trash/t.obj", "Jörg.obj",
        ]  # fmt: skip
        for name in names:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).touch()
        expected = ["0525", "0526", "J_rg", "a_b", "c", "deep_er_x_y"]
        assert scans(tmp_path).ids() == expected
        assert scans(tmp_path, limit=2).ids() == expected[:2]
        assert scans(tmp_path, pattern="*/*.obj").ids() == ["0525"]
        assert scans(tmp_path, pattern="*").ids() == ["J_rg", "c"]

    def test_one_id_for_two_files(self, tmp_path: Path) -> None:
        for name in ("a/b.obj", "a_b.obj"):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).touch()
        with pytest.raises(ValueError, match="the same id 'a_b'") as error:
            scans(tmp_path).ids()
        one_line(error, tmp_path / "a" / "b.obj", tmp_path / "a_b.obj", "rename one")

    def test_root_that_is_missing_or_empty(self, tmp_path: Path) -> None:
        with pytest.raises(ValueError, match="is no folder") as error:
            scans(tmp_path / "none").ids()
        one_line(error, "subjects.root", tmp_path / "none", "give the scans' folder")
        (tmp_path / "body.obj").touch()
        with pytest.raises(ValueError, match="holds no scan") as error:
            scans(tmp_path).ids()
        one_line(error, "subjects.root", tmp_path, ".obj")

    def test_root_that_is_a_folder_too_far_up(self, tmp_path: Path) -> None:
        export(person(), tmp_path / "Release" / "0000" / "0000.obj")
        with pytest.raises(ValueError, match="holds no scan that matches") as error:
            scans(tmp_path, pattern="[0-9]*/*.obj").ids()
        one_line(error, tmp_path / "Release" / "0000" / "0000.obj", "give that")

    def test_unknown_subject(self, tmp_path: Path) -> None:
        export(person(), tmp_path / "a.ply")
        with pytest.raises(ValueError, match="has no scan 'b'"):
            scans(tmp_path).make("b", 0, tmp_path / "out")


class TestConfiguration:
    @pytest.mark.parametrize(
        ("changes", "key"),
        [
            ({"up": "w"}, "subjects.up"),
            ({"front": "y"}, "subjects.front"),
            ({"front": "-y"}, "subjects.front"),
            ({"unit": "km"}, "subjects.unit"),
            ({"unit": 0.0}, "subjects.unit"),
            ({"unit": float("nan")}, "subjects.unit"),
            ({"limit": 0}, "subjects.limit"),
            ({"max_scan_to_body": 0.0}, "subjects.max_scan_to_body"),
            ({"max_body_to_scan": -1.0}, "subjects.max_body_to_scan"),
            ({"unit": "body"}, "subjects.unit"),
            ({"front": "body"}, "subjects.front"),
            ({"up": "body"}, "subjects.up"),
            ({"up": "body", "front": "body"}, "subjects.up"),
            ({"pattern": "../*"}, "subjects.pattern"),
            ({"pattern": "/*"}, "subjects.pattern"),
            ({"pattern": ""}, "subjects.pattern"),
        ],
    )
    def test_wrong_values(self, tmp_path: Path, changes: dict, key: str) -> None:
        with pytest.raises(ValueError, match=f"^{key}: ") as error:
            scans(tmp_path, **changes)
        one_line(error, "give")

    def test_jsonargparse_builds_it(self) -> None:
        parser = jsonargparse.ArgumentParser(exit_on_error=False)
        parser.add_class_arguments(Scans, "subjects")
        text = "subjects:\n  root: r\n  up: y\n  front: -z\n  unit: {}\n"
        units: list[tuple[str, Any]] = [("cm", "cm"), ("0.5", 0.5)]
        for unit, expected in units:
            parsed = parser.parse_string(text.format(unit))
            built = parser.instantiate(parsed).subjects
            assert built == Scans(root="r", up="y", front="-z", unit=expected)
        with pytest.raises(jsonargparse.ArgumentError, match="up"):
            parser.parse_string("subjects:\n  root: r\n  front: z\n  unit: m\n")


class TestPlacement:
    @pytest.mark.parametrize(
        ("up", "front"),
        [(u, f) for u, f in itertools.product(AXES, AXES) if u[-1] != f[-1]],
    )
    def test_every_pair_of_axes(self, tmp_path: Path, up: str, front: str) -> None:
        """A person turned to lie as the file says comes back as it was modelled."""
        mesh = person()
        up_axis, front_axis = np.array(AXES[up]), np.array(AXES[front])
        left_axis = np.cross(up_axis, front_axis)
        lying = mesh.vertices @ np.stack([left_axis, up_axis, front_axis])
        turned = trimesh.Trimesh(lying * 100 + [7, -5, 300], mesh.faces, process=False)
        export(turned, tmp_path / "in" / "p.ply")
        subject = scans(tmp_path / "in", up=up, front=front, unit="cm").make(
            "p", 0, tmp_path / "out"
        )
        linear = subject.mesh_to_world[:3, :3]
        assert np.allclose(linear @ linear.T, 1e-4 * np.eye(3))
        assert np.linalg.det(linear) > 0
        surface = subject.surface()
        expected = mesh.vertices - [0.15, 0, 0.025]  # the middle of the bounding box in x and z
        found = surface.vertices[np.lexsort(surface.vertices.round(4).T)]
        assert np.allclose(found, expected[np.lexsort(expected.round(4).T)], atol=1e-5)

    @pytest.mark.parametrize(
        ("unit", "metres"),
        [("m", 1), ("dm", 0.1), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254), ("ft", 0.3048),
         (0.02, 0.02)],
    )  # fmt: skip
    def test_units(self, tmp_path: Path, unit: Any, metres: float) -> None:
        scaled = person().apply_scale(1 / metres)
        export(scaled, tmp_path / "p.stl")
        surface = scans(tmp_path, unit=unit).make("p", 0, tmp_path / "out").surface()
        lowest, highest = surface.bounds
        assert highest[1] - lowest[1] == pytest.approx(1.8, rel=1e-6)
        assert lowest[1] == pytest.approx(0, abs=1e-6)

    def test_a_person_that_lies_has_another_axis_up(self, tmp_path: Path) -> None:
        mesh = person()
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
        mesh.apply_scale(
            [1.0, 1.5, 1.0]
        )  # as deep as a person is broad: its height alone does not tell
        path = export(mesh, tmp_path / "p.ply")
        with pytest.raises(MeshError) as error:
            scans(tmp_path).make("p", 0, tmp_path / "out")
        one_line(error, path, "it seems to lie", "correct subjects.up: y")

    @pytest.mark.parametrize(("unit", "height"), [("cm", "0.018 m"), (100.0, "180 m")])
    def test_wrong_unit(self, tmp_path: Path, unit: Any, height: str) -> None:
        path = export(person(), tmp_path / "p.ply")
        with pytest.raises(MeshError) as error:
            scans(tmp_path, unit=unit).make("p", 0, tmp_path / "out")
        one_line(error, path, height, f"correct subjects.unit: {unit}")


class TestMake:
    def test_files_are_linked_with_their_texture(self, tmp_path: Path) -> None:
        scan = textured(tmp_path / "in" / "0525")
        subject = scans(tmp_path / "in", licence="CC0-1.0").make("0525", 3, tmp_path / "out")
        assert (subject.id, subject.source, subject.licence) == ("0525", "scans", "CC0-1.0")
        assert subject.mesh == tmp_path / "out" / "0525.obj"
        assert subject.mesh.is_symlink()
        assert subject.mesh.resolve() == scan.resolve()
        assert subject.files == (
            tmp_path / "out" / "material0.mtl",
            tmp_path / "out" / "tex" / "material0.png",
        )
        texture = subject.surface().materials[0].texture
        assert texture is not None
        assert (texture == [1, 2, 3]).all()

    def test_copies_where_links_fail(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        textured(tmp_path / "in" / "a")

        def refuse(*_: object, **__: object) -> None:
            raise OSError("this file system has no links")

        monkeypatch.setattr(Path, "symlink_to", refuse)
        subject = scans(tmp_path / "in").make("a", 0, tmp_path / "out")
        assert not subject.mesh.is_symlink()
        assert subject.mesh.read_bytes() == (tmp_path / "in" / "a" / "a.obj").read_bytes()
        assert subject.surface().materials[0].texture is not None

    def test_making_again_changes_nothing(self, tmp_path: Path) -> None:
        textured(tmp_path / "in" / "a")
        source = scans(tmp_path / "in")
        first, second = (source.make("a", 0, tmp_path / "out") for _ in range(2))
        assert first.content_sha256() == second.content_sha256()
        source.make("a", 0, tmp_path / "in" / "a")  # in place: nothing to link, nothing lost
        assert (tmp_path / "in" / "a" / "a.obj").is_file()
        assert not (tmp_path / "in" / "a" / "a.obj").is_symlink()

    def test_body_beside_the_scan(self, tmp_path: Path) -> None:
        scan = person()
        scan.apply_translation([5, 1, 2])
        export(scan, tmp_path / "in" / "a" / "a.ply")
        body = trimesh.creation.capsule(height=1.2, radius=0.2)  # 1.6 m, about the origin
        body.apply_transform([[0, 1, 0, 5], [0, 0, 1, 1.8], [1, 0, 0, 2], [0, 0, 0, 1]])
        path = export(body, tmp_path / "in" / "a" / "body.obj")
        path.write_text("mtllib body.mtl\nusemtl grey\n" + path.read_text())
        path.with_suffix(".mtl").write_text("newmtl grey\nKd 0.5\n")
        source = scans(tmp_path / "in", max_scan_to_body=1, max_body_to_scan=1)
        subject = source.make("a", 0, tmp_path / "out")
        assert subject.body == tmp_path / "out" / "body.obj"
        # A change of the file that the body was read from is a change of the subject.
        assert subject.files == (tmp_path / "out" / "fit_mesh.obj",)
        assert subject.files[0].resolve() == path
        surface = subject.body_surface()
        assert surface is not None
        low, high = surface.bounds
        assert np.allclose(low, [-0.35, 0, -0.225], atol=1e-3)
        assert np.allclose(high, [0.05, 1.6, 0.175], atol=1e-3)

    @pytest.mark.parametrize("name", ["body.obj", "Body.OBJ"])
    def test_body_in_letters_of_either_case(self, tmp_path: Path, name: str) -> None:
        export(person(), tmp_path / "in" / "a" / "a.ply")
        export(person(1.7), tmp_path / "in" / "a" / name)
        source = scans(tmp_path / "in")
        assert source.ids() == ["a"]
        subject = source.make("a", 0, tmp_path / "out")
        assert subject.body == tmp_path / "out" / "body.obj"
        surface = subject.body_surface()
        assert surface is not None
        assert surface.bounds[1][1] == pytest.approx(1.7)

    @pytest.mark.parametrize(
        ("size", "aside", "fault", "heights"),
        [
            (1.0, 0.0, "another size", ("0.018 m high", "the scan 1.8 m")),  # metres, not cm
            (1000.0, 0.0, "another size", ("18 m high", "the scan 1.8 m")),
            (59.0, 0.0, "another size", ("1.062 m high", "the scan 1.8 m")),
            (111.0, 0.0, "another size", ("1.998 m high", "the scan 1.8 m")),
            (100.0, 41.0, "elsewhere", ("1.8 m high", "the scan 1.8 m")),
            (61.0, 0.0, "", ()),
            (109.0, 0.0, "", ()),
            (100.0, 39.0, "", ()),
        ],
    )
    def test_body_of_another_size_or_place(
        self, tmp_path: Path, size: float, aside: float, fault: str, heights: tuple[str, ...]
    ) -> None:
        """The scan is in centimetres, its box 80 wide."""
        export(person().apply_scale(100), tmp_path / "in" / "a" / "a.ply")
        body = person().apply_scale(size).apply_translation([aside, 0, 0])
        path = export(body, tmp_path / "in" / "a" / "body.obj")
        source = scans(tmp_path / "in", unit="cm", max_scan_to_body=1, max_body_to_scan=1)
        if not fault:
            assert source.make("a", 0, tmp_path / "out").body is not None
            return
        with pytest.raises(MeshError) as error:
            source.make("a", 0, tmp_path / "out")
        one_line(error, path, fault, *heights, "subjects.unit: cm", "export it in the scan's")
        assert not (tmp_path / "out").exists()

    def test_body_that_is_too_far_off(self, tmp_path: Path) -> None:
        export(person(), tmp_path / "in" / "a" / "a.ply")
        path = export(person().apply_translation([0, 0, 0.08]), tmp_path / "in" / "a" / "body.obj")
        wide = {"max_scan_to_body": 0.1, "max_body_to_scan": 0.1}
        near = scans(tmp_path / "in", **wide).make("a", 0, tmp_path / "out")
        assert near.body_parameters["model"] == "mesh"
        for key in ("scan_to_body", "body_to_scan"):
            found = near.body_parameters[f"{key}_mm"]
            assert 0 < found < 80
            tight = wide | {f"max_{key}": found / 1000 - 1e-3}
            with pytest.raises(MeshError) as error:
                scans(tmp_path / "in", **tight).make("a", 0, tmp_path / "out")
            one_line(error, path, f"{key.replace('_', ' ')} ", f"raise subjects.max_{key}")

    def test_two_bodies(self, tmp_path: Path) -> None:
        for name in ("a.ply", "body.obj", "Body.OBJ"):
            export(person(), tmp_path / name)
        with pytest.raises(MeshError) as error:
            scans(tmp_path).make("a", 0, tmp_path / "out")
        one_line(error, tmp_path / "Body.OBJ", "'body.obj'", "keep")

    def test_without_a_body(self, tmp_path: Path) -> None:
        export(person(), tmp_path / "a.ply")
        subject = scans(tmp_path).make("a", 0, tmp_path / "out")
        assert subject.body is None
        assert subject.body_surface() is None

    def test_one_body_beside_two_scans(self, tmp_path: Path) -> None:
        for name in ("a.ply", "b.ply", "body.obj"):
            export(person(), tmp_path / name)
        with pytest.raises(MeshError) as error:
            scans(tmp_path).make("a", 0, tmp_path / "out")
        one_line(error, tmp_path / "body.obj", "own folder")

    def test_inside_out(self, tmp_path: Path) -> None:
        mesh = person()
        mesh.invert()
        path = export(mesh, tmp_path / "a.ply")
        with pytest.raises(MeshError) as error:
            scans(tmp_path).make("a", 0, tmp_path / "out")
        one_line(error, path, "inside out", "set subjects.flip_faces: true")

        surface = scans(tmp_path, flip_faces=True).make("a", 0, tmp_path / "out").surface()
        assert trimesh.Trimesh(surface.vertices, surface.faces, process=False).volume > 0

    def test_flipping_keeps_texture_coordinates_at_their_corners(self) -> None:
        mesh = Mesh(
            np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)]),
            np.array([(0, 1, 2)]),
            uv=np.array([[(0, 0), (1, 0), (0, 1)]], dtype=np.float32),
        )
        flipped = mesh.flipped()
        assert flipped.uv is not None
        assert np.array_equal(flipped.uv, flipped.vertices[flipped.faces][..., :2])
        assert np.allclose(
            np.cross(*np.diff(flipped.vertices[flipped.faces[0]], axis=0)), [0, 0, -1]
        )

    def test_mixed_winding(self, tmp_path: Path) -> None:
        mesh = person()
        faces = np.array(mesh.faces)
        faces[::3] = faces[::3, ::-1]
        path = export(trimesh.Trimesh(mesh.vertices, faces, process=False), tmp_path / "a.ply")
        with pytest.raises(MeshError) as error:
            scans(tmp_path).make("a", 0, tmp_path / "out")
        one_line(error, path, "% of its edges", "make its normals consistent")

    def test_a_bad_file_leaves_nothing_behind(self, tmp_path: Path) -> None:
        path = tmp_path / "in" / "a.obj"
        path.parent.mkdir()
        path.write_text("nothing\n")
        with pytest.raises(MeshError) as error:
            scans(tmp_path / "in").make("a", 0, tmp_path / "out")
        one_line(error, path)
        assert not (tmp_path / "out").exists()


class TestSubject:
    def subject(self, tmp_path: Path) -> Subject:
        textured(tmp_path / "in" / "a")
        export(person(1.7), tmp_path / "in" / "a" / "body.obj")
        source = scans(tmp_path / "in", up="y", front="x", licence="Öffentlich", unit=0.9)
        return source.make("a", 0, tmp_path / "data" / "subjects" / "a")

    def test_json_round_trip_in_another_place(self, tmp_path: Path) -> None:
        subject = self.subject(tmp_path)
        record = json.loads(json.dumps(subject.to_json(tmp_path / "data")))
        assert record["mesh"] == "subjects/a/a.obj"
        assert str(tmp_path) not in json.dumps(record)
        (tmp_path / "data").rename(tmp_path / "moved")
        back = Subject.from_json(record, tmp_path / "moved")
        assert back.mesh == tmp_path / "moved" / "subjects" / "a" / "a.obj"
        assert back.mesh_to_world.dtype == np.float64
        assert np.array_equal(back.mesh_to_world, subject.mesh_to_world)
        assert back.to_json(tmp_path / "moved") == record
        assert back.surface().materials[0].texture is not None
        for name in ("id", "source", "licence", "flip_faces", "body_parameters"):
            assert getattr(back, name) == getattr(subject, name)

    def test_json_of_paths_elsewhere(self, tmp_path: Path) -> None:
        subject = Subject("a", "open", "CC0-1.0", tmp_path / "a.obj", flip_faces=True)
        back = Subject.from_json(subject.to_json(tmp_path / "data"), tmp_path / "other")
        assert back.mesh == tmp_path / "a.obj"
        assert back.body is None
        assert back.files == ()
        assert back.flip_faces

    def test_content_hash(self, tmp_path: Path) -> None:
        subject = self.subject(tmp_path)
        seen = {subject.content_sha256()}
        for path in (subject.mesh, *subject.files, subject.body):
            assert path is not None
            kept = path.resolve().read_bytes()
            path.resolve().write_bytes(kept + b"\n")
            assert subject.content_sha256() not in seen
            seen.add(subject.content_sha256())
            path.resolve().write_bytes(kept)
        assert subject.content_sha256() in seen
        alone = Subject("b", "open", "CC0-1.0", subject.mesh, body=subject.body)
        file = Subject("b", "open", "CC0-1.0", subject.mesh, files=(subject.body or Path(),))
        assert alone.content_sha256() != file.content_sha256()
        assert len(alone.content_sha256()) == 64


class TestTexture:
    """An image for scans whose own materials do not lead to one, as RenderPeople's."""

    def folder(self, root: Path) -> Path:
        scan = textured(root / "rp_a_OBJ")
        (scan.parent / "material0.mtl").unlink()
        for name, color in (("a_dif_8k", (9, 8, 7)), ("a_norm_8k", (0, 0, 0))):
            Image.new("RGB", (3, 2), color).save(scan.parent / "tex" / f"{name}.png")
        return scan

    def test_covers_the_scan(self, tmp_path: Path) -> None:
        """The largest of several sizes."""
        scan = self.folder(tmp_path / "in")
        Image.new("RGB", (1, 1), (1, 1, 1)).save(scan.parent / "tex" / "a_dif_2k.png")
        source = scans(tmp_path / "in", texture="{folder}/tex/*_dif*.png")
        subject = source.make("rp_a_OBJ", 0, tmp_path / "data" / "subjects" / "a")
        assert subject.texture == tmp_path / "data" / "subjects" / "a" / "a_dif_8k.png"
        assert subject.files == ()
        (material,) = subject.surface().materials
        assert material.texture is not None
        assert (material.texture == [9, 8, 7]).all()
        record = json.loads(json.dumps(subject.to_json(tmp_path / "data")))
        assert record["texture"] == "subjects/a/a_dif_8k.png"
        back = Subject.from_json(record, tmp_path / "data")
        assert back.content_sha256() == subject.content_sha256()
        before = subject.content_sha256()
        Image.new("RGB", (3, 2)).save(tmp_path / "in" / "rp_a_OBJ" / "tex" / "a_dif_8k.png")
        assert subject.content_sha256() != before

    def test_without_it_the_scan_is_refused(self, tmp_path: Path) -> None:
        self.folder(tmp_path / "in")
        with pytest.raises(MeshError, match="material0"):
            scans(tmp_path / "in").make("rp_a_OBJ", 0, tmp_path / "out")

    def test_missing_or_broken(self, tmp_path: Path) -> None:
        path = self.folder(tmp_path / "in")
        source = scans(tmp_path / "in", texture="{folder}/tex/{name}.jpg")
        with pytest.raises(MeshError) as error:
            source.make("rp_a_OBJ", 0, tmp_path / "out")
        one_line(error, path, "rp_a_OBJ/tex/rp_a_OBJ.jpg", "subjects.texture")
        (path.parent / "tex" / "rp_a_OBJ.jpg").write_bytes(b"no image")
        with pytest.raises(MeshError) as error:
            source.make("rp_a_OBJ", 0, tmp_path / "out")
        one_line(error, "rp_a_OBJ.jpg", "no readable image")

    def test_stays_below_the_root(self, tmp_path: Path) -> None:
        with pytest.raises(ValueError, match=r"^subjects\.texture: "):
            scans(tmp_path, texture="../{name}.jpg")

    def test_a_folder_with_brackets(self, tmp_path: Path) -> None:
        scan = textured(tmp_path / "in" / "a[1]")
        Image.new("RGB", (1, 1), (5, 5, 5)).save(scan.parent / "dif.png")
        source = scans(tmp_path / "in", texture="{folder}/dif*.png")
        assert source.make("a_1_", 0, tmp_path / "out").texture == tmp_path / "out" / "dif.png"


class TestNames:
    """A subject's folder has files of its own beside the scan's."""

    @pytest.mark.parametrize("name", ["body.obj", "Body.obj", "fit_mesh.obj", "cost.json"])
    def test_a_scan_may_not_bring_one_of_them(self, tmp_path: Path, name: str) -> None:
        scan = textured(tmp_path / "in" / "a")
        (scan.parent / "material0.mtl").rename(scan.parent / name)
        scan.write_text(scan.read_text().replace("material0.mtl", name))
        kept = (scan.parent / name).read_bytes()
        with pytest.raises(MeshError) as error:
            scans(tmp_path / "in", fits=Fits(mesh=["{name}.ply"])).make("a", 0, tmp_path / "out")
        assert "has no fit" in str(error.value)
        export(person(), tmp_path / "in" / "a.ply")
        source = scans(tmp_path / "in", pattern="a/*", fits=Fits(mesh=["{name}.ply"]))
        with pytest.raises(MeshError) as error:
            source.make("a", 0, tmp_path / "out")
        one_line(error, scan, f"'{name}'", "rename it")
        assert (scan.parent / name).read_bytes() == kept

    def test_a_body_is_never_written_through_a_link(self, tmp_path: Path) -> None:
        export(person(), tmp_path / "in" / "a" / "a.ply")
        path = export(person(1.75), tmp_path / "in" / "a" / "body.obj")
        kept = path.read_bytes()
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "body.obj").symlink_to(path)
        scans(tmp_path / "in").make("a", 0, tmp_path / "out")
        assert path.read_bytes() == kept
        assert not (tmp_path / "out" / "body.obj").is_symlink()


class TestLimits:
    def test_hold_for_the_scan_and_for_what_is_made_of_it(self, tmp_path: Path) -> None:
        textured(tmp_path / "in" / "a")
        tight = Limits(triangles=10)
        with pytest.raises(MeshError, match=r"subjects\.limits\.triangles"):
            scans(tmp_path / "in", limits=tight).make("a", 0, tmp_path / "out")
        subject = scans(tmp_path / "in").make("a", 0, tmp_path / "out")
        assert subject.surface() is not None
        record = subject.to_json(tmp_path) | {"limits": dataclasses.asdict(tight)}
        with pytest.raises(MeshError, match=r"subjects\.limits\.triangles"):
            Subject.from_json(record, tmp_path).surface()
