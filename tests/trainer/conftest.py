"""A dataset of ellipsoids, each with a slimmer body inside, small enough to learn from."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from augment.sensors import NormalGAN, read
from shards.archive import write_shard
from shards.dataset import DatasetWriter
from shards.verify import camera_to_world

HEIGHT, WIDTH, PIXEL, DISTANCE = 72, 96, 0.02, 2.0
SUBJECTS, VIEWS = 5, 2


def ellipsoid(radii: np.ndarray, middle: np.ndarray) -> dict[str, np.ndarray]:
    """Mask, depths and normals of an upright ellipsoid before the camera."""
    i, j = np.mgrid[:HEIGHT, :WIDTH]
    x = (j + 0.5 - WIDTH / 2) * PIXEL - middle[0]
    y = (HEIGHT / 2 - i - 0.5) * PIXEL - middle[1]
    inside = 1 - (x / radii[0]) ** 2 - (y / radii[1]) ** 2
    mask = inside > 0
    bulge = np.sqrt(np.maximum(inside, 0))
    outward = np.stack([x / radii[0] ** 2, y / radii[1] ** 2, bulge / radii[2]], axis=-1)
    outward /= np.maximum(np.linalg.norm(outward, axis=-1, keepdims=True), 1e-9)
    normals = {"front": outward, "back": outward * [1, 1, -1]}
    depths = {"front": DISTANCE - radii[2] * bulge, "back": DISTANCE + radii[2] * bulge}
    maps = {"mask": mask}
    for side in ("front", "back"):
        maps[f"normal_{side}"] = np.where(mask[..., None], normals[side], 0).astype("<f2")
        maps[f"depth_{side}"] = np.where(mask, depths[side], 0).astype("<f4")
    return maps


def subject_arrays(subject: str, meta: dict, seed: int) -> dict[str, np.ndarray]:
    """A shard's members."""
    rng = np.random.default_rng(seed)
    views = []
    for view in range(VIEWS):
        radii = np.array([0.3, 0.55, 0.2]) * rng.uniform(0.8, 1.1, 3)
        middle = rng.uniform(-0.1, 0.1, 2)
        maps = ellipsoid(radii, middle)
        body = ellipsoid(radii * 0.85, middle)
        color = rng.integers(1, 256, (*maps["mask"].shape, 3), dtype=np.uint8)
        maps["rgb_front"] = np.where(maps["mask"][..., None], color, 0).astype("u1")
        maps["rgb_back"] = maps["rgb_front"] // 2
        maps["body_depth_front"] = body["depth_front"]
        maps["body_depth_back"] = body["depth_back"]
        maps["depth_sensor"] = read(maps, meta, view).depth
        views.append(maps)
    arrays = {name: np.stack([view[name] for view in views]) for name in views[0]}
    arrays["yaw_deg"] = np.zeros(VIEWS, "<f4")
    arrays["camera_to_world"] = np.stack([camera_to_world(0.0, DISTANCE, 0.0)] * VIEWS)
    return arrays


def subject_meta(subject: str) -> dict:
    """A shard's meta data."""
    sensor = NormalGAN(noise=5.0)  # at pixels of 2 cm little noise would not show in normals
    return {
        "schema_version": 2,
        "subject": subject,
        "source": "closed form",
        "licence": "CC0-1.0",
        "mesh": "subjects/none.obj",
        "mesh_to_world": np.eye(4).tolist(),
        "mesh_sha256": 64 * "0",
        "body": None,
        "body_parameters": {},
        "camera": {
            "size": [HEIGHT, WIDTH],
            "pixel_size": PIXEL,
            "distance": DISTANCE,
            "center_height": 0.0,
        },
        "light": {"power": 100.0, "position": [0.0, 0.0, 0.0], "exposure": 1.0},
        "cycles": {"samples": 1},
        "sensor": {"model": sensor.name, **asdict(sensor)},
        "seed": 3,
        "dropped_pixels": [0] * VIEWS,
        "versions": {"numpy": np.__version__},
    }


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished dataset of five subjects of two views, one of them for testing."""
    folder = tmp_path_factory.mktemp("ellipsoids") / "data"
    names = [f"e{i}" for i in range(SUBJECTS)]
    with DatasetWriter(folder, {"made": "here"}, names, 0, {"numpy": np.__version__}) as writer:
        for i, name in enumerate(names):
            meta = subject_meta(name)
            written = write_shard(writer.shard_path(name), subject_arrays(name, meta, i), meta)
            writer.add(name, *written, 0.1, "CC0-1.0")
        writer.finish()
    return folder
