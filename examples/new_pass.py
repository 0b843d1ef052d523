"""A pass of one's own: texture coordinates, pixel by pixel, in the grid of a finished dataset.

python -m examples.new_pass out/demo --output out/uv

They tell which place of the surface a pixel shows, from the front and from behind and in every
view: dense correspondence. OUTPUT/SUBJECT.npz holds uv_front and uv_back, (V, H, W, 2) float32 in
[0, 1], v upwards, 0 outside the shard's mask.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from engine.tasks import read_subject, subject_folder
from engine.workers import cpu_count, run
from render.camera import Camera
from render.capture import shoot
from render.cycles import CyclesConfig
from shards.dataset import Dataset


def texture_coordinates(folder: Path, subject: str) -> dict[str, np.ndarray]:
    """Both sides of one subject; in a worker process, because Blender comes into it."""
    from render.scene import Scene, Surface, reset

    shard = Dataset(folder).shard(subject)
    mesh = read_subject(subject_folder(folder, subject)).surface()
    camera = Camera.of(shard.meta["camera"])
    reset()
    shown = Surface(mesh, textured=True)
    # One sample through each pixel's centre, as depth and normals are rendered.
    scene = Scene("uv", shown, camera, CyclesConfig(), light_position=None, threads=2)
    scene.layer.use_pass_uv = True
    mask = shard["mask"]
    maps = {name: np.zeros((*mask.shape, 2), np.float32) for name in ("uv_front", "uv_back")}
    with tempfile.TemporaryDirectory() as name:
        for i, yaw in enumerate(np.radians(shard["yaw_deg"].astype(np.float64))):
            place = camera.rectangle(mesh.vertices, yaw)
            inside = mask[i][place]
            for back, whole in ((False, maps["uv_front"]), (True, maps["uv_back"])):
                channels = shoot(scene, yaw, back, place, Path(name))
                uv = np.stack([channels["UV.U"], channels["UV.V"]], axis=-1)
                whole[i][place][inside] = uv[inside]
    return maps


def main() -> int:
    """Write the maps of all subjects; 1 if one has none."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of the dataset")
    parser.add_argument("--output", type=Path, required=True, help="folder of the maps")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    work = partial(texture_coordinates, options.data)
    failed = 0
    for subject, maps in run(work, Dataset(options.data).subjects(), cpu_count()):
        if isinstance(maps, BaseException):
            print(f"{subject}: {maps}", file=sys.stderr)
            failed = 1
            continue
        np.savez(options.output / f"{subject}.npz", **maps)
        print(options.output / f"{subject}.npz")
    return failed


if __name__ == "__main__":
    sys.exit(main())
