"""A small dataset whose every map is known in closed form: a tilted box, seen from V sides."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shards.archive import write_shard
from shards.dataset import DatasetWriter

HEIGHT, WIDTH, PIXEL = 64, 96, 0.02
DISTANCE, CENTER_HEIGHT = 2.0, 0.6
YAWS = np.array([0.0, 37.5, 201.25], dtype="<f4")
TILT = Rotation.from_euler("xyz", (17, 23, 31), degrees=True).as_matrix()
CENTER = np.array([0.02, 0.6, 0.01])
HALF, BODY_HALF = np.array([0.25, 0.4, 0.15]), np.array([0.2, 0.35, 0.1])
# The mesh's file is in centimetres, and shifted.
MESH_TO_WORLD = np.array([[0.01, 0, 0, 0.1], [0, 0.01, 0, -0.2], [0, 0, 0.01, 0.3], [0, 0, 0, 1]])
CONFIG = {"camera": {"size": [HEIGHT, WIDTH], "pixel_size": PIXEL}, "seed": 7}


def box_obj(half: np.ndarray) -> str:
    """The tilted box as OBJ text, one vertex for each corner of each face, with flat normals."""
    lines, faces = [], []
    for axis in range(3):
        for sign in (-1, 1):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            normal = sign * np.eye(3)[axis]
            corners = [normal + su * u + sv * v for su, sv in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            first = 4 * len(faces) // 2 + 1
            for corner in corners[::sign]:
                world = TILT @ (corner * half) + CENTER
                x, y, z = (world - MESH_TO_WORLD[:3, 3]) / 0.01
                lines.append(f"v {float(x)!r} {float(y)!r} {float(z)!r}")
            x, y, z = TILT @ normal
            lines.append(f"vn {float(x)!r} {float(y)!r} {float(z)!r}")
            n = len(faces) // 2 + 1
            faces += [
                f"f {first}//{n} {first + 1}//{n} {first + 2}//{n}",
                f"f {first}//{n} {first + 2}//{n} {first + 3}//{n}",
            ]
    return "\n".join(lines + faces) + "\n"


def box_maps(half: np.ndarray, camera_to_world: np.ndarray) -> dict[str, np.ndarray]:
    """Mask, depths and normals of the box by the slab equations, in the camera's frame."""
    i, j = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = (j + 0.5 - WIDTH / 2) * PIXEL, (HEIGHT / 2 - i - 0.5) * PIXEL
    rotation, position = camera_to_world[:3, :3], camera_to_world[:3, 3]
    origin = (np.stack([x, y, 0 * x], -1) @ rotation.T + position - CENTER) @ TILT
    direction = -rotation[:, 2] @ TILT
    near_far = np.sort(np.stack([(s * half - origin) / direction for s in (-1, 1)]), axis=0)
    entry, leave = near_far[0].argmax(-1), near_far[1].argmin(-1)
    front, back = near_far[0].max(-1), near_far[1].min(-1)
    mask = front < back
    axes = np.sign(direction)[:, None] * TILT.T @ rotation  # row: an axis, along the ray
    return {
        "mask": mask,
        "depth_front": np.where(mask, front, 0).astype("<f4"),
        "depth_back": np.where(mask, back, 0).astype("<f4"),
        "normal_front": np.where(mask[..., None], -axes[entry], 0).astype("<f2"),
        "normal_back": np.where(mask[..., None], axes[leave], 0).astype("<f2"),
    }


def closed_form_arrays(views: int = len(YAWS)) -> dict[str, np.ndarray]:
    """Every member of the box's shard but `meta`."""
    cameras, maps, bodies = [], [], []
    for yaw in np.radians(YAWS[:views].astype(float)):
        # R_y(-yaw) T(0, center_height, distance), multiplied out by hand
        c, s = np.cos(yaw), np.sin(yaw)
        cameras.append(
            [
                [c, 0, -s, -s * DISTANCE],
                [0, 1, 0, CENTER_HEIGHT],
                [s, 0, c, c * DISTANCE],
                [0, 0, 0, 1],
            ]
        )
        maps.append(box_maps(HALF, np.array(cameras[-1])))
        bodies.append(box_maps(BODY_HALF, np.array(cameras[-1])))
    arrays = {name: np.stack([m[name] for m in maps]) for name in maps[0]}
    color = np.where(arrays["mask"][..., None], (200, 120, 40), 0).astype("u1")
    return {
        **arrays,
        "yaw_deg": YAWS[:views],
        "camera_to_world": np.array(cameras),
        "rgb_front": color,
        "rgb_back": color // 2,
        "depth_sensor": arrays["depth_front"] * np.float32(1.001),
        "body_depth_front": np.stack([b["depth_front"] for b in bodies]),
        "body_depth_back": np.stack([b["depth_back"] for b in bodies]),
    }


def closed_form_meta(subject: str, views: int = len(YAWS)) -> dict:
    """The box's meta data."""
    return {
        "schema_version": 2,
        "subject": subject,
        "source": "closed form",
        "licence": "CC0-1.0",
        "mesh": "subjects/box.obj",
        "mesh_to_world": MESH_TO_WORLD.tolist(),
        "mesh_sha256": hashlib.sha256(box_obj(HALF).encode()).hexdigest(),
        "body": "subjects/body.obj",
        "body_parameters": {},
        "camera": {
            "size": [HEIGHT, WIDTH],
            "pixel_size": PIXEL,
            "distance": DISTANCE,
            "center_height": CENTER_HEIGHT,
        },
        "light": {"power": 100.0, "position": [0.0, 0.0, 0.0], "exposure": 1.0},
        "cycles": {"samples": 16},
        "sensor": {"model": "none"},
        "seed": 7,
        "yaw": "fixed",
        "dropped_pixels": [0] * views,
        "versions": {"numpy": np.__version__},
    }


def write_surfaces(folder: Path) -> None:
    """The files that `closed_form_meta` names, below the dataset's folder."""
    (folder / "subjects" / "box.obj").write_text(box_obj(HALF))
    (folder / "subjects" / "body.obj").write_text(box_obj(BODY_HALF))


@pytest.fixture
def surfaces() -> Callable[[Path], None]:
    """surfaces(folder) writes the box and its body into a dataset."""
    return write_surfaces


@pytest.fixture
def arrays() -> dict[str, np.ndarray]:
    """The box's members."""
    return closed_form_arrays()


@pytest.fixture
def meta() -> dict:
    """The box's meta data, subject "box"."""
    return closed_form_meta("box")


@pytest.fixture
def build(tmp_path: Path) -> Callable[..., Path]:
    """build(arrays, meta, compression): a finished dataset of that one shard; its folder."""

    def build(arrays: dict[str, np.ndarray], meta: dict, compression="stored") -> Path:
        folder = tmp_path / "dataset"
        subject = meta["subject"]
        with DatasetWriter(folder, CONFIG, [subject], 7, meta["versions"]) as writer:
            write_surfaces(folder)
            written = write_shard(writer.shard_path(subject), arrays, meta, compression)
            writer.add(subject, *written, 1.25, meta["licence"])
            writer.finish()
        return folder

    return build
