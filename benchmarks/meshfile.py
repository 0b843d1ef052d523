"""Seconds and memory to read a THuman2.0-like OBJ on one core, against trimesh alone.

The aim is 3 s and 1.5 GB for 400,000 faces and a 4096 x 4096 texture.

python benchmarks/meshfile.py
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import trimesh
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))

from subjects.meshfile import check_winding, read_mesh

SIDE = 448
"""The tube has SIDE x SIDE quads, 401,408 triangles and about 200,000 vertices."""

CHARTS = 32
"""Strips of the tube with texture coordinates of their own: a scan's atlas has many seams."""

TEXTURE = 4096
"""Pixels of the texture's side."""

REPEATS = 3


def write_obj(folder: Path, *, normals: bool) -> Path:
    """A wavy tube in the files of a THuman2.0 scan: an OBJ, material0.mtl, material0.jpeg.

    Args:
        folder: where the files go.
        normals: `v/vt/vn` faces with one smooth normal a vertex, else `v/vt`.
    """
    around, up = np.linspace(0, 2 * np.pi, SIDE + 1), np.linspace(0, 1, SIDE + 1)
    u, v = np.meshgrid(around, up, indexing="ij")
    radius = 0.3 + 0.02 * np.sin(20 * u) * np.sin(40 * v)
    outward = np.stack([np.sin(u), np.zeros_like(u), np.cos(u)], axis=-1)
    points = radius[..., None] * outward + 1.8 * v[..., None] * [0, 1, 0]
    vn = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    vn /= np.linalg.norm(vn, axis=-1, keepdims=True)

    corner = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"), axis=-1)
    corner = corner[:, :, None] + [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)]
    corner = corner.reshape(-1, 2)  # (i around, j up) of every face's corners
    vertex = 1 + corner[:, 0] % SIDE * (SIDE + 1) + corner[:, 1]
    chart = np.repeat(np.arange(SIDE) * CHARTS // SIDE, SIDE * 6)
    texel, vt_index = np.unique(np.stack([chart, *corner.T], axis=1), axis=0, return_inverse=True)
    gutter = texel[:, 0] / CHARTS * 0.1
    uv = np.stack([texel[:, 1] / SIDE * 0.9 + gutter, texel[:, 2] / SIDE], axis=1)
    names = [vertex, 1 + vt_index.ravel(), vertex] if normals else [vertex, 1 + vt_index.ravel()]

    path = folder / "scan.obj"
    with path.open("w") as file:
        file.write("mtllib material0.mtl\n")
        np.savetxt(file, points[:-1].reshape(-1, 3), fmt="v %.6f %.6f %.6f")
        np.savetxt(file, uv, fmt="vt %.6f %.6f")
        if normals:
            np.savetxt(file, vn[:-1].reshape(-1, 3), fmt="vn %.6f %.6f %.6f")
        file.write("usemtl material_0\n")
        one = "/".join(["%d"] * len(names))
        rows = np.stack(names, axis=-1).reshape(-1, 3 * len(names))
        np.savetxt(file, rows, fmt=f"f {one} {one} {one}")
    (folder / "material0.mtl").write_text("newmtl material_0\nKd 1\nmap_Kd material0.jpeg\n")
    write_texture(folder / "material0.jpeg")
    return path


def write_texture(path: Path) -> None:
    """A JPEG with a photograph's spectrum: detail of every size, the finer the fainter."""
    rng = np.random.default_rng(0)
    image = np.zeros((TEXTURE, TEXTURE, 3), dtype=np.float32)
    size = 8
    while size <= TEXTURE:
        noise = Image.fromarray(rng.integers(0, 256, (size, size, 3), dtype=np.uint8))
        detail = noise.resize((TEXTURE, TEXTURE), Image.Resampling.BICUBIC)
        image += (np.asarray(detail, dtype=np.float32) - 127.5) * (8 / size) ** 0.5
        size *= 2
    Image.fromarray(np.clip(127.5 + image, 0, 255).astype(np.uint8)).save(path, quality=90)


def ours(path: Path) -> Any:
    return read_mesh(path)


def ours_and_winding(path: Path) -> Any:
    mesh = read_mesh(path)
    check_winding(mesh)
    return mesh


def trimesh_alone(path: Path) -> Any:
    """trimesh's mesh of the same file, its texture decoded; it takes `Kd 1` for a broken MTL."""
    (geometry,) = trimesh.load_scene(path, process=False).geometry.values()
    with Image.open(path.with_name("material0.jpeg")) as image:
        image.convert("RGB")
    return geometry


READINGS = {
    "read_mesh": ours,
    "and check_winding": ours_and_winding,
    "trimesh alone": trimesh_alone,
}


def measure(what: str, path: Path) -> None:
    """In a process of its own: one reading on one core, its figures as JSON."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    start = time.perf_counter()
    mesh = READINGS[what](path)
    seconds = time.perf_counter() - start
    # ru_maxrss would be no less than the memory of the process that started this one
    (peak,) = re.findall(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    counts = {"faces": len(mesh.faces), "vertices": len(mesh.vertices)}
    print(json.dumps({"seconds": seconds, "gigabytes": int(peak) * 1024 / 1e9, **counts}))


def main() -> None:
    for normals in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            path = write_obj(Path(folder), normals=normals)
            size = path.stat().st_size / 1e6
            print(f"faces of {'v/vt/vn' if normals else 'v/vt'}, {size:.0f} MB")
            runs: dict[str, list[dict[str, Any]]] = {what: [] for what in READINGS}
            for _ in range(REPEATS):  # in turn, as a machine's speed changes
                for what, figures in runs.items():
                    command = [sys.executable, __file__, what, str(path)]
                    figures.append(json.loads(subprocess.check_output(command)))
        middle = {what: median(run["seconds"] for run in figures) for what, figures in runs.items()}
        for what, figures in runs.items():
            print(
                f"  {what:18}{min(run['seconds'] for run in figures):5.2f} s best,"
                f"{middle[what]:5.2f} s median,"
                f"{max(run['gigabytes'] for run in figures):5.2f} GB peak; "
                f"{figures[0]['faces']} faces, {figures[0]['vertices']} vertices"
            )
        print(f"  ratio of medians  {middle['read_mesh'] / middle['trimesh alone']:5.2f}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        measure(sys.argv[1], Path(sys.argv[2]))
    else:
        main()
