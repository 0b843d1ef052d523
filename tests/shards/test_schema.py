"""What the schema refuses, and that it names what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shards.schema import (
    MEMBERS,
    SchemaError,
    check_arrays,
    check_meta,
    check_relative_path,
    check_subject_id,
)


def test_the_contract_accepts_the_box(arrays, meta):
    size = check_arrays(arrays)
    assert size == (3, 64, 96)
    check_meta(meta, *size)


def test_radiance_is_optional_and_comes_in_pairs(arrays):
    radiance = np.zeros((3, 64, 96, 3), "<f2")
    check_arrays({**arrays, "radiance_front": radiance, "radiance_back": radiance})
    with pytest.raises(SchemaError, match="come together"):
        check_arrays({**arrays, "radiance_front": radiance})


@pytest.mark.parametrize("name", [n for n, m in MEMBERS.items() if not m.optional])
def test_every_member_is_missed_and_its_type_checked(arrays, name):
    without = {n: a for n, a in arrays.items() if n != name}
    with pytest.raises(SchemaError, match=f"member '{name}' is missing"):
        check_arrays(without)
    with pytest.raises(SchemaError, match=f"member '{name}' has type int16"):
        check_arrays({**arrays, name: arrays[name].astype(np.int16)})
    with pytest.raises(SchemaError, match="has shape"):
        check_arrays({**arrays, name: arrays[name][..., :-1]})


def test_unknown_members_and_wrong_byte_order_are_refused(arrays):
    with pytest.raises(SchemaError, match="'depth' is unknown"):
        check_arrays({**arrays, "depth": arrays["depth_front"]})
    with pytest.raises(SchemaError, match="'depth_front' has type >f4, not float32"):
        check_arrays({**arrays, "depth_front": arrays["depth_front"].astype(">f4")})


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("schema_version", 1, "schema_version is 1"),
        ("schema_version", True, "schema_version is True"),
        ("subject", "../box", "subject id '../box'"),
        ("mesh", "/etc/passwd", "meta.mesh: '/etc/passwd'"),
        ("mesh", "subjects/../../x.obj", "meta.mesh"),
        ("body", "..", "meta.body"),
        ("mesh_sha256", "abc", "not 64 hex digits"),
        ("files", {"subjects/a.mtl": "abc"}, "not 64 hex digits"),
        ("files", {"../a.mtl": "0" * 64}, "no posix path"),
        ("mesh_to_world", [[1, 0], [0, 1]], "no 4x4 list"),
        ("mesh_to_world", np.diag([1, 2, 1, 1]).tolist(), "no similarity"),
        ("mesh_to_world", np.diag([1, 1, -1, 1]).tolist(), "no similarity"),
        ("camera", {}, "meta.camera.size is missing"),
        ("dropped_pixels", [0, 0], "not one count for each of 3 views"),
        ("dropped_pixels", [0, 0, -1], "not one count for each of 3 views"),
        ("sensor", "kinect", "which is no dict"),
        ("seed", "7", "which is no int"),
        ("seed", 10**400, "meta.seed is 1000*, which is no finite number"),
        ("light", {"power": float("inf")}, "meta.light.power is inf, which is no finite number"),
        ("extra", [{"deep": [float("nan")]}], r"meta.extra.deep is nan, which is no finite number"),
    ],
)
def test_meta_is_refused_by_key(meta, key, value, message):
    with pytest.raises(SchemaError, match=message):
        check_meta({**meta, key: value}, 3, 64, 96)


def test_every_key_of_meta_is_missed(meta):
    for key in set(meta) - {"yaw"}:
        without = {k: v for k, v in meta.items() if k != key}
        with pytest.raises(SchemaError, match=f"meta.{key} is missing"):
            check_meta(without, 3, 64, 96)


def test_meta_must_agree_with_the_images(meta):
    with pytest.raises(SchemaError, match=r"meta.camera.size is \[64, 96\]"):
        check_meta(meta, 3, 424, 512)


@pytest.mark.parametrize("subject", ["", ".", "..", ".hidden", "a/b", "a b", "ä", "a\n", "a\\b"])
def test_subject_ids_that_cannot_name_a_file(subject):
    with pytest.raises(SchemaError, match="subject id"):
        check_subject_id(subject)


def test_subject_ids_that_can():
    for subject in ("0525", "a.b-c_D", "-", "_x"):
        assert check_subject_id(subject) == subject


@pytest.mark.parametrize("path", ["", ".", "..", "/a", "a/../b", "C:/a", "a\\b", "a\0b", None])
def test_paths_that_leave_the_folder(path):
    with pytest.raises(SchemaError, match="no posix path below"):
        check_relative_path(path, "file")


DOCS = Path(__file__).parents[2] / "docs"
CONVENTIONS = (DOCS / "conventions.md").read_text()
SHARDS = (DOCS / "shards.md").read_text()


def test_the_documentation_has_every_member_as_it_is():
    for member in MEMBERS.values():
        assert f"| `{member.name}` | {member.shape_text} | {member.dtype.name} |" in SHARDS


def test_the_documentation_has_every_key_of_meta(meta):
    for key in meta.keys() - {"yaw"}:
        assert f"`{key}`" in SHARDS, key


def test_the_documented_back_projection_lands_on_the_box(arrays, meta):
    """The snippet's points lie on the box's six planes, in the world."""
    snippet = next(s for s in CONVENTIONS.split("```python\n")[1:] if "points =" in s)
    names = {"np": np, "shard": arrays, "meta": json.loads(json.dumps(meta)), "v": 1}
    exec(snippet.split("```")[0], names)
    points = names["points"][:, :3]
    assert len(points) == arrays["mask"][1].sum()
    tilt = Rotation.from_euler("xyz", (17, 23, 31), degrees=True).as_matrix()
    box = (points - (0.02, 0.6, 0.01)) @ tilt / (0.25, 0.4, 0.15)
    np.testing.assert_allclose(np.abs(box).max(axis=1), 1, atol=5e-6)
