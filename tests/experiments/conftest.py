"""Five lumps with arms, whose meshes, bodies and light are all there, made in seconds."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import trimesh

from augment.sensors import NormalGAN, read
from shards.archive import write_shard
from shards.dataset import DatasetWriter
from shards.raycast import Surface
from shards.verify import camera_to_world

HEIGHT, WIDTH, PIXEL, DISTANCE, LEVEL = 72, 96, 0.02, 2.0, 0.6
YAWS_DEG = (0.0, 20.0)
SUBJECTS = 5


def lump(seed: int, slim: float = 1.0) -> trimesh.Trimesh:
    """A trunk with bumps, and an arm that stands forward."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=4)
    bumps = rng.normal(size=(4, 3)) * 3
    height = 1 + 0.05 * slim * np.cos(ball.vertices @ bumps.T).sum(axis=1)
    trunk = trimesh.Trimesh(
        ball.vertices * height[:, None] * np.array([0.25, 0.55, 0.18]) * slim + [0, LEVEL, 0],
        ball.faces,
        process=False,
    )
    arm = trimesh.creation.icosphere(subdivisions=3)
    arm.apply_scale(np.array([0.05, 0.05, 0.25]) * slim)
    arm.apply_translation([0.1 + 0.05 * rng.random(), LEVEL + 0.2, 0.3])
    return trimesh.util.concatenate([trunk, arm])


def seen(mesh: trimesh.Trimesh, camera: np.ndarray) -> dict[str, np.ndarray]:
    """Mask, depths and normals."""
    i, j = np.mgrid[:HEIGHT, :WIDTH]
    xy = np.stack([(j + 0.5 - WIDTH / 2) * PIXEL, (HEIGHT / 2 - i - 0.5) * PIXEL], axis=-1)
    surface = Surface(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces))
    hits = {s: surface.cast(xy.reshape(-1, 2), camera, t) for s, t in (("front", -1), ("back", 1))}
    mask = (hits["front"].hit & hits["back"].hit).reshape(HEIGHT, WIDTH)
    maps = {"mask": mask}
    for side, found in hits.items():
        depth, normal = -found.z.reshape(mask.shape), found.normal.reshape(*mask.shape, 3)
        # Shading normals may lean away from who looks; shards lay them onto the outline.
        normal[..., 2] = normal[..., 2].clip(0) if side == "front" else normal[..., 2].clip(max=0)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        maps[f"depth_{side}"] = np.where(mask, depth, 0).astype("<f4")
        maps[f"normal_{side}"] = np.where(mask[..., None], normal, 0).astype("<f2")
    return maps


def view(mesh: trimesh.Trimesh, body: trimesh.Trimesh, camera: np.ndarray) -> dict[str, np.ndarray]:
    """A view's members but for the sensor's."""
    maps = seen(mesh, camera)
    for side, depth in seen(body, camera).items():
        if side.startswith("depth"):
            maps[f"body_{side}"] = depth
    for side in ("front", "back"):
        light = np.abs(maps[f"normal_{side}"][..., 2:]).astype("f4") * [0.8, 0.5, 0.3]
        maps[f"radiance_{side}"] = (50 * light).astype("<f2")
        coded = np.clip(light, 0.02, 1) ** (1 / 2.4)
        maps[f"rgb_{side}"] = np.where(maps["mask"][..., None], 255 * coded, 0).astype("u1")
    return maps


@pytest.fixture(scope="session")
def people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five subjects of two views, one of them for testing."""
    folder = tmp_path_factory.mktemp("lumps") / "data"
    names = [f"lump_{k}" for k in range(SUBJECTS)]
    sensor = NormalGAN(noise=5.0)
    with DatasetWriter(folder, {"made": "here"}, names, 0, {"numpy": np.__version__}) as writer:
        for k, name in enumerate(names):
            mesh, body = lump(k), lump(k, 0.85)
            place = folder / "subjects" / name
            place.mkdir()
            mesh.export(place / "surface.ply")
            body.export(place / "body.ply")
            meta = {
                "schema_version": 2,
                "subject": name,
                "source": "made",
                "licence": "CC0-1.0",
                "mesh": f"subjects/{name}/surface.ply",
                "mesh_to_world": np.eye(4).tolist(),
                "mesh_sha256": hashlib.sha256((place / "surface.ply").read_bytes()).hexdigest(),
                "body": f"subjects/{name}/body.ply",
                "body_parameters": {"pose": "upright", "hard": k % 2 == 1},
                "camera": {
                    "size": [HEIGHT, WIDTH],
                    "pixel_size": PIXEL,
                    "distance": DISTANCE,
                    "center_height": LEVEL,
                },
                "light": {"power": 1000.0, "position": [0.0, 0.0, 0.0], "exposure": 2.0},
                "color_camera": None,
                "cycles": {"samples": 1},
                "sensor": {"model": sensor.name, **asdict(sensor)},
                "seed": 3,
                "dropped_pixels": [0] * len(YAWS_DEG),
                "versions": {"numpy": np.__version__},
            }
            cameras = [camera_to_world(yaw, DISTANCE, LEVEL) for yaw in YAWS_DEG]
            views = [view(mesh, body, camera) for camera in cameras]
            for index, maps in enumerate(views):
                maps["depth_sensor"] = read(maps, meta, index).depth
            arrays = {member: np.stack([maps[member] for maps in views]) for member in views[0]}
            arrays["yaw_deg"] = np.array(YAWS_DEG, "<f4")
            arrays["camera_to_world"] = np.stack(cameras)
            written = write_shard(writer.shard_path(name), arrays, meta)
            writer.add(name, *written, 0.1, "CC0-1.0")
        writer.finish()
    return folder
