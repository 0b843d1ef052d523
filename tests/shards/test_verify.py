"""The proof of a dataset: a closed form passes, and each kind of damage is named."""

import dataclasses
import json
import re

import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq

from shards.dataset import Dataset
from shards.manifest import DatasetError
from shards.raycast import Surface
from shards.verify import _Cast, camera_to_world, verify


def inner(mask):
    """Pixels of the mask whose neighbours within two pixels are in it as well."""
    return mask & np.all([np.roll(mask, s, a) for s in (-2, -1, 1, 2) for a in (0, 1)], axis=0)


def test_the_closed_form_passes(build, arrays, meta):
    calls = []
    report = verify(build(arrays, meta), progress=calls.append)
    assert report.breaches == []
    assert report.ok
    assert calls == ["box"]
    figures = report.figures["box"]
    assert figures["views"] == 3
    assert figures["mask_off"] == figures["body_mask_off"] == figures["depth_off"] == 0
    assert figures["depth_median_mm"] < 2e-4  # half a last place of a 32-bit float at 2 m
    assert figures["body_p999_mm"] < 3e-4
    assert 0 < figures["normal_median_deg"] < 0.05  # a 16-bit float's rounding
    assert "box" in report.table()
    assert report.table().endswith("sound")


def test_a_deflated_dataset_passes_as_well(build, arrays, meta):
    assert verify(build(arrays, meta, "deflate")).breaches == []


def test_camera_agrees_with_the_closed_form(arrays, meta):
    camera = meta["camera"]
    for yaw, matrix in zip(arrays["yaw_deg"], arrays["camera_to_world"], strict=True):
        due = camera_to_world(float(yaw), camera["distance"], camera["center_height"])
        np.testing.assert_allclose(matrix, due, atol=1e-12)


def test_the_face_turns_towards_camera_x():
    """The subject's +z, seen by the camera of yaw +30 degrees, leans to the right."""
    face = np.linalg.inv(camera_to_world(30.0, 2.0, 0.9))[:3, :3] @ (0, 0, 1)
    np.testing.assert_allclose(face, (0.5, 0, np.sqrt(0.75)), atol=1e-12)


def shift_depth(arrays, meta):
    arrays["depth_front"][1][arrays["mask"][1]] -= np.float32(0.001)


def shift_back(arrays, meta):
    arrays["depth_back"][2][arrays["mask"][2]] += np.float32(0.001)


def shift_one_pixel_sideways(arrays, meta):
    for name, array in arrays.items():
        if name not in ("yaw_deg", "camera_to_world"):
            arrays[name] = np.roll(array, 1, axis=2)


def clear_one_pixel(arrays, meta):
    pixel = (0, *np.argwhere(inner(arrays["mask"][0]))[40])
    for name, array in arrays.items():
        if name not in ("yaw_deg", "camera_to_world") and not name.startswith("body"):
            array[pixel] = 0


def add_one_pixel(arrays, meta):
    row, column = np.argwhere(arrays["mask"][0])[0]
    for name, array in arrays.items():
        if name not in ("yaw_deg", "camera_to_world") and not name.startswith("body"):
            array[0, row - 3, column] = array[0, row, column]


def flip_mask_alone(arrays, meta):
    arrays["mask"][0, 0, 0] = True


def scale_a_normal(arrays, meta):
    pixel = (1, *np.argwhere(arrays["mask"][1])[9])
    arrays["normal_front"][pixel] *= np.float16(0.99)


def turn_normals(arrays, meta):
    arrays["normal_back"] = -arrays["normal_back"]


def lean_normals(arrays, meta):
    normals = arrays["normal_front"].astype(float)
    c, s = np.cos(np.radians(0.5)), np.sin(np.radians(0.5))
    arrays["normal_front"] = (normals @ [[c, s, 0], [-s, c, 0], [0, 0, 1]]).astype("<f2")


def swap_sides(arrays, meta):
    front, back = arrays["depth_front"], arrays["depth_back"]
    arrays["depth_front"], arrays["depth_back"] = back, front


def mirror_back(arrays, meta):
    """The back as its own camera would see it."""
    arrays["depth_back"] = arrays["depth_back"][:, :, ::-1].copy()


def mirror_back_within_the_mask(arrays, meta):
    """The back's normals mirrored, which no mask and no depth can tell."""
    arrays["normal_back"] *= np.array([-1, 1, 1], dtype="<f2")


def write_nan(arrays, meta):
    pixel = (2, *np.argwhere(arrays["mask"][2])[5])
    arrays["normal_back"][pixel] = np.nan


def colour_outside(arrays, meta):
    arrays["rgb_back"][0, 0, 0, 1] = 1


def sense_outside(arrays, meta):
    arrays["depth_sensor"][0, 0, 0] = 1.5


def wrong_yaw(arrays, meta):
    arrays["yaw_deg"] = -arrays["yaw_deg"]


def skewed_camera(arrays, meta):
    arrays["camera_to_world"][1, 0, 0] *= 1.001


def shift_body(arrays, meta):
    arrays["body_depth_back"][arrays["body_depth_back"] > 0] += np.float32(0.001)


def hole_in_body(arrays, meta):
    pixel = (0, *np.argwhere(inner(arrays["body_depth_front"][0] > 0))[0])
    arrays["body_depth_front"][pixel] = arrays["body_depth_back"][pixel] = 0


def half_a_body(arrays, meta):
    arrays["body_depth_front"][0, 0, 0] = 1.0


def body_without_a_mesh(arrays, meta):
    meta["body"] = None


def many_dropped(arrays, meta):
    meta["dropped_pixels"] = [0, 5, 0]


def wrong_mesh_hash(arrays, meta):
    meta["mesh_sha256"] = "0" * 64


def missing_mesh(arrays, meta):
    meta["mesh"] = "subjects/other.obj"


def subject_elsewhere(arrays, meta):
    meta["mesh_to_world"][0][3] += 10.0


def empty_view(arrays, meta):
    for name, array in arrays.items():
        if name not in ("yaw_deg", "camera_to_world"):
            array[1] = 0
    subject_elsewhere(arrays, meta)


def camera_of_nan(arrays, meta):
    arrays["camera_to_world"][2, 0, 3] = np.nan


def yaw_of_nan(arrays, meta):
    arrays["yaw_deg"] = arrays["yaw_deg"].copy()
    arrays["yaw_deg"][1] = np.nan


def camera_far_away(arrays, meta):
    arrays["camera_to_world"][1, 0, 3] = 1e308


def depth_of_nan(arrays, meta):
    arrays["depth_front"][0][arrays["mask"][0]] = np.nan


def sensor_of_nan(arrays, meta):
    arrays["depth_sensor"][0][arrays["mask"][0]] = np.nan


def subject_at_the_end_of_the_world(arrays, meta):
    meta["mesh_to_world"][0][3] = 1e300


def wrong_scale(arrays, meta):
    meta["mesh_to_world"][0][0] = meta["mesh_to_world"][1][1] = meta["mesh_to_world"][2][2] = 0.0101


@pytest.mark.parametrize(
    ("damage", "breach"),
    [
        (shift_depth, "box view 1: depth_front is off by 1.0000 mm"),
        (shift_back, "box view 2: depth_back is off by 1.0000 mm"),
        (shift_one_pixel_sideways, "box view 0: mask differs from the ray cast"),
        (clear_one_pixel, "box view 0: mask differs from the ray cast: 0 pixels too many, 1 too"),
        (add_one_pixel, "box view 0: mask differs from the ray cast: 1 pixels too many, 0 too"),
        (flip_mask_alone, "box view 0: mask differs from depth_front > 0 in 1 pixels"),
        (scale_a_normal, "box view 1: normal_front is not of unit length in 1 pixels"),
        (turn_normals, "box view 0: normal_back faces away from its viewer"),
        (lean_normals, "box view 0: normal_front is off by 0."),
        (swap_sides, "box view 0: depth_back is nearer than depth_front"),
        (mirror_back, "box view 0: mask differs from depth_back > 0"),
        (mirror_back_within_the_mask, "box view 0: normal_back is off by"),
        (write_nan, "box view 2: normal_back is not finite everywhere"),
        (colour_outside, "box view 0: rgb_back is not 0 in 1 pixels outside the mask"),
        (sense_outside, "box view 0: depth_sensor is not 0 in 1 pixels outside the mask"),
        (wrong_yaw, "box view 1: camera_to_world disagrees with yaw_deg"),
        (skewed_camera, "box view 1: camera_to_world is no rigid transform"),
        (shift_body, "box view 0: body_depth_back is off by"),
        (hole_in_body, "box view 0: the body's silhouette differs from the ray cast"),
        (half_a_body, "box view 0: the body's front and back silhouettes differ in 1 pixels"),
        (body_without_a_mesh, "box view 0: body_depth_front is not 0, but meta.body is null"),
        (many_dropped, "box view 1: 5 pixels dropped"),
        (wrong_mesh_hash, "box: .*box.obj has another sha256 .* run the build again"),
        (missing_mesh, "box: meta.mesh: .*other.obj is missing; run the build again"),
        (subject_elsewhere, "box view 0: the subject leaves the frame"),
        (empty_view, "box view 1: mask is empty"),
        (camera_of_nan, "box view 2: camera_to_world or yaw_deg is not finite"),
        (yaw_of_nan, "box view 1: camera_to_world or yaw_deg is not finite"),
        (camera_far_away, "box view 1: camera_to_world disagrees with yaw_deg"),
        (depth_of_nan, "box view 0: depth_front is not finite everywhere"),
        (depth_of_nan, "box view 0: depth_front is off by nan mm"),
        (sensor_of_nan, "box view 0: depth_sensor is not finite everywhere"),
        (subject_at_the_end_of_the_world, "box: meta.mesh: .*has vertices that are not finite"),
        (wrong_scale, "box view 0: depth_front is off by"),
    ],
)
def test_each_damage_is_named(build, arrays, meta, damage, breach):
    damage(arrays, meta)
    report = verify(build(arrays, meta))
    assert not report.ok
    assert all("\n" not in line for line in report.breaches)
    expected = re.compile(breach)
    assert any(expected.match(line) for line in report.breaches), report.breaches
    assert report.breaches[0] in report.table()


def test_a_declared_dropped_pixel_is_allowed(build, arrays, meta):
    clear_one_pixel(arrays, meta)
    meta["dropped_pixels"] = [1, 0, 0]
    assert verify(build(arrays, meta)).breaches == []


def test_a_pixel_on_the_edge_may_fall_on_either_side(build, arrays, meta):
    """The mesh is moved so that one pixel's centre lies within a micrometre of the outline."""
    camera = arrays["camera_to_world"][0]
    folder = build(arrays, meta)
    row, column = np.argwhere(arrays["mask"][0])[0]  # the topmost pixel: the one above is empty
    x, y = (column + 0.5 - 48) * 0.02, (32 - row - 0.5) * 0.02

    def surface(shift):
        moved = np.array(meta["mesh_to_world"])
        moved[1, 3] -= shift
        return Surface.read(folder / "subjects" / "box.obj", moved)

    def covered(shift):
        return 0.5 - float(surface(shift).cast(np.array([[x, y]]), camera, -1).hit[0])

    shift = brentq(covered, 0, 0.02, xtol=1e-8)
    cast = _Cast(surface(shift), camera, arrays["mask"][0], 0.02)
    mask = np.zeros((64, 96), dtype=bool)
    mask[cast._rows, cast._columns] = cast._covered.reshape(cast._rows.stop - cast._rows.start, -1)
    for value in (False, True):
        mask[row, column] = value
        gained, lost, edge = cast.compare_mask(mask)
        assert (gained, lost) == (0, 0)
        assert edge == (value != bool(surface(shift).cast(np.array([[x, y]]), camera, -1).hit[0]))


def test_an_edited_byte_is_found(build, arrays, meta):
    folder = build(arrays, meta)
    path = folder / "shards" / "box.npz"
    raw = bytearray(path.read_bytes())
    raw[Dataset(folder).shard("box").members["rgb_front"].offset + 32 * 96 * 3 + 150] ^= 1
    path.write_bytes(raw)
    assert "has another sha256 than the manifest" in verify(folder).breaches[0]


def test_missing_and_torn_shards_are_breaches(build, arrays, meta):
    folder = build(arrays, meta)
    path = folder / "shards" / "box.npz"
    path.write_bytes(path.read_bytes()[:-100])
    breaches = verify(folder).breaches
    assert re.search("the manifest says .*; run the build again", breaches[0])
    assert "is no whole shard" in breaches[1]
    path.unlink()
    assert "box.npz is missing" in verify(folder).breaches[0]


def test_an_unfinished_build_is_a_breach(build, arrays, meta):
    folder = build(arrays, meta)
    path = folder / "dataset.json"
    document = json.loads(path.read_text())
    document["rectoverso"]["counts"]["planned"] = 2
    path.write_text(json.dumps(document))
    assert "1 planned subjects are not finished" in verify(folder).breaches[0]
    (folder / "failures.jsonl").write_text('{"subject": "x", "stage": "render", "reason": "r"}\n')
    assert verify(folder).ok


def test_another_split_in_the_manifest_is_a_breach(build, arrays, meta):
    folder = build(arrays, meta)
    path = folder / "manifest.jsonl"
    path.write_text(path.read_text().replace('"train"', '"test"'))
    assert "list other subjects or splits" in verify(folder).breaches[0]


def test_a_folder_that_is_no_dataset_is_an_error(tmp_path):
    with pytest.raises(DatasetError, match=r"holds no dataset\.json"):
        verify(tmp_path)


def test_too_many_pixels_on_an_edge_are_a_breach(build, arrays, meta, monkeypatch):
    """With a reach of a pixel whatever is wrong lies on an edge: no hiding place."""
    shift_one_pixel_sideways(arrays, meta)
    monkeypatch.setattr("shards.verify._PROBES", 0.02 * np.array([[1, 0], [-1, 0]]))
    report = verify(build(arrays, meta))
    assert report.figures["box"]["mask_off"] == 0
    for name in ("mask", "the body's silhouette"):
        found = [line for line in report.breaches if f"view 0: {name} differs" in line]
        assert found
        assert "pixels on an edge" in found[0]


def test_a_record_of_failure_that_is_none_is_a_breach(build, arrays, meta):
    folder = build(arrays, meta)
    for line in ('{"a": 1}', '{"subject": 5, "stage": "render", "reason": "r"}', "[]", "{"):
        (folder / "failures.jsonl").write_text(line + "\n")
        (breach,) = verify(folder).breaches
        assert "failures.jsonl line 1 is no" in breach
        assert "remove the line and build again" in breach


def test_other_versions_in_the_manifest_are_a_breach(build, arrays, meta):
    folder = build(arrays, meta)
    path = folder / "manifest.jsonl"
    path.write_text(path.read_text().replace(np.__version__, "0"))
    (breach,) = verify(folder).breaches
    assert "different versions; run the build again" in breach


def test_a_document_that_breaks_off_is_an_error(build, arrays, meta):
    path = build(arrays, meta) / "dataset.json"
    document = json.loads(path.read_text())
    for key, value in (("counts", {}), ("counts", {"planned": "1"}), ("splits", {"train": [[]]})):
        broken = {**document, "rectoverso": {**document["rectoverso"], key: value}}
        path.write_text(json.dumps(broken))
        with pytest.raises(DatasetError, match="is no dataset's"):
            verify(path.parent)


def faces_from(number):
    return f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf {number} 2 3\n".encode()


DAMAGED = {
    "empty.glb": b"",
    "cut.glb": b"glTF\2\0\0\0",
    "cut.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n",
    "index.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
    "empty.stl": b"",
    "unknown.xyz": b"0 0 0",
    "empty.obj": b"",
    "points.obj": b"v 0 0 0\nv 1 0 0\n",
    "short.obj": b"v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "word.obj": b"v 0 x 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "nan.obj": b"v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "zero.obj": faces_from(0),
    "past.obj": faces_from(4),
    "before.obj": faces_from(-4),
    "corner.obj": faces_from("1//a"),
    "huge.obj": faces_from(10**30),
    "normal.obj": faces_from("1//1"),
}


@pytest.mark.parametrize("name", DAMAGED)
@pytest.mark.parametrize("key", ["mesh", "body"])
def test_a_damaged_surface_is_a_breach_with_a_cure(build, arrays, meta, key, name):
    meta[key] = f"subjects/{name}"
    folder = build(arrays, meta)
    (folder / "subjects" / name).write_bytes(DAMAGED[name])
    (breach,) = [line for line in verify(folder).breaches if "sha256" not in line]
    assert breach.startswith(f"box: meta.{key}: {folder / 'subjects' / name} ")
    assert breach.endswith("; delete the file and run the build again")
    assert "\n" not in breach


def test_a_lost_surface_is_a_breach_with_a_cure(build, arrays, meta):
    folder = build(arrays, meta)
    for name in ("box.obj", "body.obj"):
        (folder / "subjects" / name).unlink()
    breaches = verify(folder).breaches
    assert len(breaches) == 2
    assert all(line.endswith("is missing; run the build again") for line in breaches)


@pytest.fixture
def sphere(tmp_path):
    """A sphere of 0.5 m around (0, 1, 0), 20,480 faces, as a file without normals."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    mesh.apply_translation([0, 1, 0])
    return mesh, tmp_path / "sphere.obj"


def write_obj(path, vertices, faces, uv=False):
    lines = ["v {!r} {!r} {!r}".format(*map(float, v)) for v in vertices]
    if uv:  # every face an island of its own: a seam along every edge
        lines += [f"vt {i / len(faces)} {k / 3}" for i in range(len(faces)) for k in range(3)]
        lines += [
            "f " + " ".join(f"{v + 1}/{3 * i + k + 1}" for k, v in enumerate(face))
            for i, face in enumerate(faces)
        ]
    else:
        lines += ["f {} {} {}".format(*(face + 1)) for face in faces]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("kind", ["shared", "seams", "soup"])
@pytest.mark.parametrize("towards", [-1, 1])
def test_rays_on_a_sphere(sphere, kind, towards):
    """Depth and smooth normals as the sphere has them, however the file divides its vertices."""
    mesh, path = sphere
    if kind == "soup":
        soup = mesh.vertices[mesh.faces].reshape(-1, 3)
        write_obj(path, soup, np.arange(len(soup)).reshape(-1, 3))
    else:
        write_obj(path, mesh.vertices, mesh.faces, uv=kind == "seams")
    camera = camera_to_world(33.0, 2.0, 0.9)
    x, y = np.random.default_rng(5).uniform(-0.55, 0.55, (2, 4000))
    hits = Surface.read(path, np.eye(4)).cast(np.column_stack([x, y]), camera, towards)
    # In the camera's frame the centre stands at (0, 0.1, -2).
    square = 0.25 - x**2 - (y - 0.1) ** 2
    clear = np.abs(square) > 2e-3
    np.testing.assert_array_equal(hits.hit[clear], square[clear] > 0)
    inside = square > 0.05
    height = np.sqrt(square[inside])
    expected = -2 - towards * height
    assert np.abs(hits.z[inside] - expected).max() < 3e-4  # the facets' sagitta
    radial = np.column_stack([x[inside], y[inside] - 0.1, -towards * height]) / 0.5
    cosine = np.einsum("ni,ni->n", hits.normal[inside], radial)
    assert np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1)))) < 0.05


def test_inside_out_faces_give_normals_towards_the_viewer(sphere):
    mesh, path = sphere
    write_obj(path, mesh.vertices, mesh.faces[:, ::-1])
    hits = Surface.read(path, np.eye(4)).cast(
        np.array([[0.0, 0.1]]), camera_to_world(0, 2, 0.9), -1
    )
    np.testing.assert_allclose(hits.normal, [[0, 0, 1]], atol=1e-3)


def test_hard_edges_of_the_file_stay_hard(build, arrays, meta):
    """Without its own normals the box is smooth: then flat normals are wrong by far."""
    folder = build(arrays, meta)
    path = folder / "subjects" / "box.obj"
    path.write_text(re.sub(r"//\d+", "", re.sub(r"vn .*\n", "", path.read_text())))
    report = verify(folder)
    assert report.figures["box"]["normal_median_deg"] > 10
    assert report.figures["box"]["depth_median_mm"] < 2e-4


def test_the_report_keeps_the_worst_view(build, arrays, meta):
    shift_depth(arrays, meta)
    report = verify(build(arrays, meta))
    assert report.figures["box"]["depth_median_mm"] == pytest.approx(1, abs=1e-3)
    assert dataclasses.asdict(report)["breaches"] == report.breaches
