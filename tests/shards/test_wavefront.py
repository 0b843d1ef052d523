"""The OBJ reader of the proof: every form of the format, and agreement with trimesh's."""

from collections import Counter

import numpy as np
import pytest
from trimesh.exchange.obj import load_obj
from trimesh.geometry import triangulate_quads

from shards.wavefront import read_obj

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
NORMALS = "vn 0 0 1\nvn 0 1 0\n"


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "mesh.obj"
        path.write_bytes(text.encode())
        vertices, faces, normals = read_obj(path)
        return vertices[faces][..., :2].astype(int).tolist(), normals[faces]

    return read


TRIANGLE = [[[0, 0], [1, 0], [1, 1]]]


@pytest.mark.parametrize(
    "text",
    [
        SQUARE + "f 1 2 3",
        SQUARE + "f 1/1 2/2 3/3\n",
        SQUARE + NORMALS + "f 1//1 2//1 3//1\n",
        SQUARE + NORMALS + "f 1/9/1 2/8/1 3/7/1\n",
        SQUARE + NORMALS + "f -4//-2 -3//-2 -2//-2\n",
        SQUARE + "f\t1/\t2// 3/1/ # 4\n",
        "# v 9 9 9\n" + SQUARE.replace("\n", "\r\n") + "f 1 \\\r\n 2 3\r\n",
        SQUARE.replace("0\n", "0 0.5 0.5 0.5\n") + "usemtl f\ng v\no vn\ns 1\nf 1 2 3\n",
        SQUARE + "f 1 2 3\nf 1 2\n",
    ],
)
def test_every_form_of_a_triangle(read, text):
    corners, normals = read(text)
    assert corners == TRIANGLE
    assert (normals == ([0, 0, 1] if "vn 0" in text else [0, 0, 0])).all()


def test_an_index_from_the_end_counts_the_lines_above_it(read):
    more = "".join(f"v {x} 5 0\n" for x in (7, 8, 9))
    corners, _ = read(f"{SQUARE}f -4 -3 -2\n{more}f -3 -2 -1\nf 1 2 3\n")
    assert corners == [*TRIANGLE, [[7, 5], [8, 5], [9, 5]], *TRIANGLE]


def test_polygons_become_fans(read):
    corners, _ = read("v 2 2 0\n" + SQUARE + "v 0 .5 0\nf 2 3 4 5 6\nf 2 3 4\nf 2 3 4 5\n")
    a, b, c, d, e = [0, 0], [1, 0], [1, 1], [0, 1], [0, 0]
    assert corners == [[a, b, c], [a, c, d], [a, d, e], [a, b, c], [a, b, c], [a, c, d]]


def test_one_place_with_two_normals_is_two_vertices(tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_text(SQUARE + NORMALS + "f 1//1 2//1 3//1\nf 1//2 3//1 4//1\nf 1 2 3\n")
    vertices, faces, normals = read_obj(path)
    assert len(vertices) == 4 + 1 + 3
    assert normals[faces[:, 0]].tolist() == [[0, 0, 1], [0, 1, 0], [0, 0, 0]]


@pytest.mark.parametrize("sides", [3, 4, 5])
def test_it_agrees_with_trimesh(tmp_path, sides):
    """Places exact to the last bit, and the same triangles out of polygons."""
    rng = np.random.default_rng(3)
    polygons = np.array([rng.permutation(60)[:sides] for _ in range(90)]) + 1
    lines = ["v {!r} {!r} {!r}".format(*map(float, p)) for p in rng.normal(size=(60, 3))]
    lines += ["vn {} {} {}".format(*np.eye(3)[i]) for i in rng.integers(3, size=60)]
    lines += [f"vt {i / 60} 0" for i in range(60)]
    lines += ["f " + " ".join(f"{c}/{61 - c}/{c}" for c in polygon) for polygon in polygons]
    path = tmp_path / "mesh.obj"
    path.write_text("\n".join(lines))
    with path.open() as file:
        (other,) = load_obj(file, None, skip_materials=True)["geometry"].values()

    def triangles(vertices, faces, normals):
        corners = np.concatenate([vertices, normals], axis=1)[faces].tolist()
        return Counter(frozenset(map(tuple, triangle)) for triangle in corners)

    faces = triangulate_quads(other["faces"])
    expected = triangles(other["vertices"], faces, other["vertex_normals"])
    assert triangles(*read_obj(path)) == expected
    assert expected.total() == 90 * (sides - 2)
