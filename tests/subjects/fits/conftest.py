"""Files in SMPL-X's and THuman2.0's formats, made: the real ones are licensed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from subjects.meshfile import read_mesh
from subjects.open import OpenHumans

VERTICES, FACES, JOINTS = 10475, 20908, 55
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15]
for wrist in (20, 21):
    for _ in range(5):
        PARENTS += [wrist, len(PARENTS), len(PARENTS) + 1]
ROUGH = np.array(
    [
        *([0, 0.53, 0], [0.06, 0.5, 0], [-0.06, 0.5, 0], [0, 0.58, 0], [0.07, 0.28, 0]),
        *([-0.07, 0.28, 0], [0, 0.65, 0], [0.08, 0.05, 0], [-0.08, 0.05, 0], [0, 0.7, 0]),
        *([0.08, 0.02, 0.06], [-0.08, 0.02, 0.06], [0, 0.84, 0], [0.04, 0.8, 0], [-0.04, 0.8, 0]),
        *([0, 0.9, 0], [0.1, 0.8, 0], [-0.1, 0.8, 0], [0.15, 0.65, 0], [-0.15, 0.65, 0]),
        *([0.17, 0.5, 0.02], [-0.17, 0.5, 0.02], [0, 0.88, 0.02], [0.02, 0.93, 0.04]),
        [-0.02, 0.93, 0.04],
    ]
)
"""Where SMPL-X's first 25 joints are, in heights."""


@dataclass(frozen=True, eq=False)
class Fit:
    """An open human's body as SMPL-X parameters: `model` posed by `values` is `body`."""

    model: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    body: trimesh.Trimesh


def resampled(body: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """(10475, 3) and (20908, 3): the surface of `body` with SMPL-X's numbers of both.

    A closed surface of so many triangles has 10456 vertices; the others belong to none.
    """
    vertices, faces = fast_simplification.simplify(
        body.vertices, body.faces, target_count=FACES - 200
    )
    vertices, faces = list(vertices.astype(np.float64)), list(faces)
    while len(faces) < FACES:
        a, b, c = faces.pop(0)
        faces += [[a, b, len(vertices)], [b, c, len(vertices)], [c, a, len(vertices)]]
        vertices.append((vertices[a] + vertices[b] + vertices[c]) / 3)
    assert len(faces) == FACES
    assert len(vertices) <= VERTICES
    vertices += [vertices[0]] * (VERTICES - len(vertices))
    return np.array(vertices), np.array(faces)


def fitted(body: trimesh.Trimesh, yaw: float, generator: np.random.Generator) -> Fit:
    """A model and parameters that together are `body` turned by `yaw` (radians) about y.

    The model is made backwards: the body, bent back by the parameters' pose, is its template.
    """
    vertices, faces = resampled(body)
    target = vertices @ Rotation.from_rotvec([0, yaw, 0]).as_matrix().T

    def small(*shape: int, size: float) -> np.ndarray:
        return generator.normal(0, size, shape).astype(np.float32)

    lean = Rotation.from_rotvec([0.25, 0, 0])
    values = {
        "betas": small(1, 10, size=1.0),
        "global_orient": (Rotation.from_rotvec([0, yaw, 0]) * lean)
        .as_rotvec()[None]
        .astype(np.float32),
        "body_pose": small(1, 63, size=0.15),
        "left_hand_pose": small(1, 12, size=0.3),
        "right_hand_pose": small(1, 12, size=0.3),
        "jaw_pose": small(1, 3, size=0.1),
        "leye_pose": small(1, 3, size=0.1),
        "reye_pose": small(1, 3, size=0.1),
        "expression": small(1, 10, size=1.0),
    }
    components = {
        side: np.linalg.qr(generator.normal(size=(45, 45)))[0] for side in ("left", "right")
    }
    means = {side: generator.normal(0, 0.1, 45) for side in ("left", "right")}
    hands = [
        values[f"{side}_hand_pose"][0] @ components[side][:12] + means[side]
        for side in ("left", "right")
    ]
    names = ("global_orient", "body_pose", "jaw_pose", "leye_pose", "reye_pose")
    whole = np.concatenate([*(values[name][0] for name in names), *hands])
    turns = Rotation.from_rotvec(whole.reshape(-1, 3)).as_matrix()

    height = np.ptp(vertices[:, 1])
    joints = np.concatenate([ROUGH, np.zeros((30, 3))]) * height
    for joint in range(25, JOINTS):
        out = 0.03 if joint < 40 else -0.03
        joints[joint] = joints[PARENTS[joint]] + [out, -0.01, 0.002 * (joint % 5)]

    placed = np.tile(np.eye(4), (JOINTS, 1, 1))
    for joint, parent in enumerate(PARENTS):
        own = np.eye(4)
        own[:3, :3] = turns[joint]
        own[:3, 3] = joints[joint] - (joints[parent] if joint else 0)
        placed[joint] = placed[parent] @ own if joint else own
    apart = np.linalg.norm(target[:, None] - placed[None, :, :3, 3], axis=2)
    weights = np.exp(-((apart / (0.08 * height)) ** 2)) + 1e-9
    weights /= weights.sum(axis=1, keepdims=True)
    relative = placed.copy()
    relative[:, :3, 3] -= np.einsum("jab,jb->ja", placed[:, :3, :3], joints)
    blended = np.einsum("vj,jab->vab", weights, relative)
    bare = np.linalg.solve(blended[:, :3, :3], (target - blended[:, :3, 3])[..., None])[..., 0]

    shapedirs = generator.normal(0, 0.002, (VERTICES, 3, 400))
    posedirs = generator.normal(0, 0.0005, (VERTICES, 3, 486))
    feature = (turns[1:] - np.eye(3)).ravel()
    shape = np.concatenate([values["betas"][0], values["expression"][0]])
    shaped = bare - posedirs @ feature
    template = shaped - np.concatenate([shapedirs[..., :10], shapedirs[..., 300:310]], 2) @ shape
    regressor = np.zeros((JOINTS, VERTICES))
    for joint, near in enumerate(cKDTree(shaped).query(joints, 40)[1]):
        near = np.unique(near)
        ones = np.concatenate([shaped[near].T, np.ones((1, len(near)))])
        regressor[joint, near] = np.linalg.lstsq(ones, [*joints[joint], 1], rcond=None)[0]
    model = {
        "v_template": template,
        "f": faces.astype(np.uint32),
        "shapedirs": shapedirs,
        "posedirs": posedirs,
        "J_regressor": regressor,
        "kintree_table": np.array([[2**32 - 1, *PARENTS[1:]], range(JOINTS)], dtype=np.int64),
        "weights": weights,
        "lmk_faces_idx": np.arange(51),
        "lmk_bary_coords": np.full((51, 3), 1 / 3),
        "dynamic_lmk_faces_idx": np.zeros((79, 17), dtype=int),
        "dynamic_lmk_bary_coords": np.full((79, 17, 3), 1 / 3),
        **{f"hands_components{side[0]}": components[side] for side in components},
        **{f"hands_mean{side[0]}": means[side] for side in means},
        # the released file has such members, pickled
        "joint2num": np.array({"Pelvis": 0}, dtype=object),
    }
    return Fit(model, values, trimesh.Trimesh(target, faces, process=False))


@pytest.fixture(scope="session")
def open_human(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one open human, its clothes laid."""
    folder = tmp_path_factory.mktemp("open") / "open_0000"
    source = OpenHumans(count=1, cloth="laid", texture_size=256, poses=["walk"])
    source.make("open_0000", 0, folder)
    return folder


@pytest.fixture(scope="session")
def fit(open_human: Path) -> Fit:
    """A fit of the open human's body, turned by 127 degrees."""
    mesh = read_mesh(open_human / "body.obj")
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return fitted(body, np.radians(127.0), np.random.default_rng(0))


@pytest.fixture(scope="session")
def models(fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with SMPLX_MALE.npz, as the licensed archive unpacks."""
    folder = tmp_path_factory.mktemp("models")
    (folder / "smplx").mkdir()
    np.savez(folder / "smplx" / "SMPLX_MALE.npz", **fit.model)
    return folder
