"""Open humans: the same everywhere, in the world's frame, posed without penetration, covered."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.ray.ray_pyembree import RayMeshIntersector

import seeds
from subjects.open import OpenHumans
from subjects.subject import Subject

ROOT = Path(__file__).resolve().parents[3]
SEED = 5
STANDING = ["stand", "a_pose", "arms_open"]


@dataclass(frozen=True, eq=False)
class Read:
    """An OBJ file as arrays."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None
    text: str


def read(path: Path) -> Read:
    text = path.read_text()
    rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "f": []}
    for line in text.splitlines():
        key, _, rest = line.partition(" ")
        if key in rows:
            rows[key].append(rest.split())
    corner = np.array([[c.split("/") for c in f] for f in rows["f"]], dtype=int) - 1
    uv = np.array(rows["vt"], dtype=float)[corner[..., 1]] if rows["vt"] else None
    return Read(np.array(rows["v"], dtype=float), corner[..., 0], uv, text)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    folder = tmp_path_factory.mktemp("open")
    return OpenHumans(count=3, poses=STANDING, cloth="laid").make("open_0001", SEED, folder)


@pytest.fixture(scope="module")
def rest() -> Any:
    from subjects.open.bodies import body

    _, phenotype = body.draw_phenotype(seeds.generator(SEED, "open_0002", "phenotype"), 18, 75)
    return body.rest_body(phenotype)


def pose_draw(subject: str) -> np.random.Generator:
    return seeds.generator(SEED, subject, "pose")


def digests(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir())}


def test_ids_do_not_depend_on_the_count_and_load_no_torch() -> None:
    assert OpenHumans(count=2).ids() == ["open_0000", "open_0001"]
    assert OpenHumans(count=50).ids()[:2] == OpenHumans(count=2).ids()
    code = (
        "import sys; from subjects.open import OpenHumans; OpenHumans().ids(); "
        "print([m for m in ('torch', 'anny', 'bpy') if m in sys.modules])"
    )
    shown = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert shown.stdout.strip() == "[]", shown.stderr


def test_another_process_writes_the_same_bytes(made: Subject, tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from subjects.open import OpenHumans\n"
        f"source = OpenHumans(count=999, poses={STANDING}, cloth='laid')\n"
        f"source.make('open_0001', {SEED}, Path(sys.argv[1]))"
    )
    # Another hash seed and thread count, and another count of humans: none may show.
    environment = {**os.environ, "PYTHONHASHSEED": "77", "OMP_NUM_THREADS": "1"}
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, env=environment, check=True
    )
    assert digests(tmp_path) == digests(made.mesh.parent)
    assert set(digests(tmp_path)) == {
        "open_0001.obj",
        "body.obj",
        "material0.mtl",
        "material0.jpeg",
        "parameters.json",
    }


def test_no_global_random_state_is_touched(made: Subject, tmp_path: Path) -> None:
    import torch

    torch.manual_seed(3)
    before, threads = torch.get_rng_state(), torch.get_num_threads()
    other = OpenHumans(poses=STANDING, cloth="laid").make("open_0000", SEED, tmp_path)
    assert torch.equal(before, torch.get_rng_state())
    assert torch.get_num_threads() == threads
    assert (
        digests(other.mesh.parent)["material0.jpeg"] != digests(made.mesh.parent)["material0.jpeg"]
    )


def test_frame_is_metres_upright_facing_plus_z(made: Subject) -> None:
    dressed, bare = read(made.mesh), read(made.body)
    assert dressed.vertices[:, 1].min() == pytest.approx(0.0, abs=1e-6)
    height = bare.vertices[:, 1].max() - bare.vertices[:, 1].min()
    assert 1.4 < height < 2.1
    assert height == pytest.approx(made.body_parameters["height_m"], abs=0.05)
    assert np.allclose(made.mesh_to_world, np.eye(4))
    # The root is the axis: the trunk stands around it.
    middle = bare.vertices[np.abs(bare.vertices[:, 1] - 0.6 * height) < 0.03]
    trunk = middle[np.abs(middle[:, 0]) < 0.15]
    assert np.abs(trunk[:, [0, 2]].mean(axis=0)).max() < 0.08
    # The nose is the foremost point of the head, and toes point forward.
    head = bare.vertices[bare.vertices[:, 1] > 0.88 * height]
    nose = head[head[:, 2].argmax()]
    assert nose[2] > head[:, 2].mean() + 0.05
    assert abs(nose[0] - head[:, 0].mean()) < 0.03
    feet = bare.vertices[bare.vertices[:, 1] < 0.04]
    ankles = bare.vertices[np.abs(bare.vertices[:, 1] - 0.11) < 0.01]
    ankle = ankles[:, 2].mean()
    assert feet[:, 2].max() - ankle > 1.5 * (ankle - feet[:, 2].min())


def test_files_hold_what_the_format_promises(made: Subject) -> None:
    dressed, bare = read(made.mesh), read(made.body)
    assert made.licence == "CC0-1.0"
    assert all(p.is_file() for p in (made.mesh, made.body, *made.files))
    assert dressed.uv is not None
    assert dressed.uv.min() >= 0.0
    assert dressed.uv.max() <= 1.0
    assert 100_000 <= len(dressed.faces) <= 400_000
    assert "\nvn " not in dressed.text
    with Image.open(made.mesh.parent / "material0.jpeg") as image:
        assert image.size == (2048, 2048)
        assert image.mode == "RGB"
    closed = trimesh.Trimesh(bare.vertices, bare.faces, process=False)
    assert closed.is_watertight
    assert closed.is_winding_consistent
    assert 0.03 < closed.volume < 0.25


def cast(mesh: trimesh.Trimesh, back: bool) -> tuple[np.ndarray, np.ndarray]:
    """First faces hit by a grid of rays along z, and the grid's index of each."""
    low, high = mesh.bounds
    x, y = np.meshgrid(np.arange(low[0], high[0], 0.006), np.arange(low[1], high[1], 0.006))
    start = np.stack([x.ravel(), y.ravel(), np.full(x.size, -3.0 if back else 3.0)], axis=1)
    along = np.tile([0.0, 0.0, 1.0 if back else -1.0], (len(start), 1))
    # A hair off the grid, so that no ray runs along an edge.
    face = RayMeshIntersector(mesh).intersects_first(start + np.array([1.3e-4, 1.7e-4, 0.0]), along)
    return face[face >= 0], np.flatnonzero(face >= 0)


def test_surfaces_seen_from_outside_face_outward(made: Subject) -> None:
    dressed = read(made.mesh)
    mesh = trimesh.Trimesh(dressed.vertices, dressed.faces, process=False)
    for back in (False, True):
        face, _ = cast(mesh, back)
        toward = mesh.face_normals[face, 2] * (-1 if back else 1)
        assert (toward > -1e-6).mean() > 0.998


def test_front_and_back_differ_in_shape_and_colour(made: Subject) -> None:
    dressed = read(made.mesh)
    with Image.open(made.mesh.parent / "material0.jpeg") as image:
        picture = np.asarray(image).astype(float)
    mesh = trimesh.Trimesh(dressed.vertices, dressed.faces, process=False)
    views = []
    for back in (False, True):
        face, ray = cast(mesh, back)
        at = dressed.uv[face].mean(axis=1) * [1, -1] + [0, 1]
        column, row = (np.minimum(at * 2048, 2047)).astype(int).T
        views.append((ray, picture[row, column], np.abs(mesh.triangles_center[face, 2])))
    (ray_f, colour_f, depth_f), (ray_b, colour_b, depth_b) = views
    both, f, b = np.intersect1d(ray_f, ray_b, return_indices=True)
    assert len(both) > 0.999 * len(ray_f)
    assert (np.abs(colour_f[f] - colour_b[b]).max(axis=1) > 20).mean() > 0.10
    assert (np.abs(depth_f[f] - depth_b[b]) > 0.02).mean() > 0.30


def test_subdivision_reproduces_a_plane_and_rounds_a_cube() -> None:
    from subjects.open.base.subdivision import refine, triangles

    grid = np.array([[x, y, 0.0] for y in range(4) for x in range(4)])
    quads = np.array(
        [
            [r * 4 + c, r * 4 + c + 1, r * 4 + c + 5, r * 4 + c + 4]
            for r in range(3)
            for c in range(3)
        ]
    )
    fine = refine(quads, grid[quads][..., :2], len(grid), 2)
    at = fine.matrix @ grid
    assert np.asarray(fine.matrix.sum(axis=1)).ravel() == pytest.approx(1.0)
    assert np.abs(at[:, 2]).max() == 0.0
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    sides = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    ball = refine(sides, np.zeros((6, 4, 2)), 8, 3)
    shape = trimesh.Trimesh(ball.matrix @ corners, triangles(ball.quads), process=False)
    assert shape.is_watertight
    # The corners, at a distance of 1.73, are cut off; the middle of the sides stays.
    assert np.linalg.norm(shape.vertices, axis=1).max() < 1.2
    assert 1.0 < shape.volume < 8.0


@pytest.mark.parametrize("pose", ["walk", "arms_overhead"])
def test_skin_under_garments_is_not_seen(rest: Any, pose: str) -> None:
    """What is taken away would not have been seen, and something is."""
    from subjects.open.base.subdivision import refine, triangles
    from subjects.open.base.template import BODY, template
    from subjects.open.bodies.posed import draw_pose
    from subjects.open.clothes.dressing import bare_solid, dress, hidden
    from subjects.open.clothes.garments import arm_share
    from subjects.open.clothes.outfit import draw_outfit

    posed = draw_pose([pose], 0.0, 3.0, "open_0002", pose_draw("open_0002"), rest)
    group = template().groups[BODY]
    skin = refine(group.quads, group.uv, len(template().vertices), 1)
    vertices, faces = skin.matrix @ posed.vertices, triangles(skin.quads)
    place, arm = skin.matrix @ template().vertices, arm_share(skin.matrix)
    bare = bare_solid(skin, posed.vertices)
    for k in range(4):
        outfit = draw_outfit(seeds.generator(SEED, f"x{k}", "outfit"), True, 0.9)
        generator = seeds.generator(SEED, "x", "cloth")
        clothes, _ = dress(outfit, posed.vertices[None], skin, bare, generator, Path())
        # All the skin stays, so what pokes through would be seen; figure.py takes it away.
        whole = [trimesh.Trimesh(vertices, faces, process=False)]
        for worn in clothes:
            piece = worn.hemmed(np.zeros(len(worn.vertices), dtype=bool))
            whole.append(trimesh.Trimesh(piece.vertices, piece.faces, process=False))
        mesh = trimesh.util.concatenate(whole)
        under = hidden(outfit, place, arm, vertices, clothes)[faces].all(axis=1)
        assert under.mean() > 0.10
        for back in (False, True):
            face, _ = cast(mesh, back)
            bare_seen = face[face < len(faces)]
            assert under[bare_seen].sum() <= 0.002 * len(face)


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"count": 0}, "subjects.count"),
        ({"min_age": 50.0, "max_age": 40.0}, "subjects.min_age"),
        ({"max_age": 200.0}, "max_age"),
        ({"texture_size": 3}, "subjects.texture_size"),
        ({"poses": ["stand", "moonwalk"]}, "moonwalk"),
        ({"poses": []}, "subjects.poses"),
        ({"hard_share": 1.5}, "subjects.hard_share"),
    ],
)
def test_a_wrong_configuration_is_named_in_one_line(fields: dict, named: str) -> None:
    with pytest.raises(ValueError, match=named) as caught:
        OpenHumans(**fields)
    assert "\n" not in str(caught.value)


def test_an_estimators_body_lies_beside_the_exact_one(made: Subject, tmp_path: Path) -> None:
    source = OpenHumans(poses=STANDING, cloth="laid", estimate="pixie")
    guessed = source.make("open_0001", SEED, tmp_path)
    assert guessed.body == tmp_path / "estimated.obj"
    assert tmp_path / "body.obj" in guessed.files
    # The clothed surface and the exact body know nothing of it.
    assert (tmp_path / "body.obj").read_bytes() == made.body.read_bytes()
    assert guessed.mesh.read_bytes() == made.mesh.read_bytes()
    exact, estimate = read(made.body), read(guessed.body)
    assert (exact.faces == estimate.faces).all()
    off = 1000 * np.linalg.norm(exact.vertices - estimate.vertices, axis=1).mean()
    assert 15 < off < 150
    record = guessed.body_parameters["estimate"]
    assert record["vertex_error_mm"] == pytest.approx(off, rel=0.3)


def test_a_licence_and_a_card_lie_beside_the_humans() -> None:
    papers = OpenHumans().papers()
    assert set(papers) == {"LICENSE", "README.md"}
    assert "CC0 1.0 Universal" in papers["LICENSE"]
    assert "parameters.json" in papers["README.md"]


def test_an_unknown_id_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="open_0000"):
        OpenHumans().make("someone", SEED, tmp_path)
