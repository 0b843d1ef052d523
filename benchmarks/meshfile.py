"""Seconds to read a textured OBJ of 400,000 faces, against trimesh alone.

python benchmarks/meshfile.py
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))

from subjects.meshfile import check_winding, read_mesh

SIDE = 448
"""The tube has SIDE x SIDE quads and a texture seam along its length."""


def write_obj(folder: Path) -> Path:
    """A wavy tube as scans are stored: v/vt faces, an MTL, a 4096 x 4096 JPEG."""
    u, v = np.meshgrid(np.linspace(0, 1, SIDE + 1), np.linspace(0, 1, SIDE + 1), indexing="ij")
    around = 2 * np.pi * u
    radius = 0.3 + 0.02 * np.sin(20 * around) * np.sin(40 * v)
    points = np.stack([radius * np.sin(around), 1.8 * v, radius * np.cos(around)], axis=-1)

    def triangles(index: np.ndarray) -> np.ndarray:
        a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
        return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)

    texel = 1 + np.arange((SIDE + 1) ** 2).reshape(SIDE + 1, SIDE + 1)
    vertex = texel.copy()
    vertex[-1] = vertex[0]
    path = folder / "tube.obj"
    with path.open("w") as file:
        file.write("mtllib tube.mtl\n")
        np.savetxt(file, points.reshape(-1, 3), fmt="v %.6f %.6f %.6f")
        np.savetxt(file, np.stack([u, v], axis=-1).reshape(-1, 2), fmt="vt %.6f %.6f")
        file.write("usemtl tube\n")
        corners = np.stack([triangles(vertex), triangles(texel)], axis=-1).reshape(-1, 6)
        np.savetxt(file, corners, fmt="f %d/%d %d/%d %d/%d")
    (folder / "tube.mtl").write_text("newmtl tube\nKd 1 1 1\nmap_Kd tube.jpg\n")
    noise = np.random.default_rng(0).integers(0, 256, (256, 256, 3), dtype=np.uint8)
    Image.fromarray(noise).resize((4096, 4096)).save(folder / "tube.jpg")
    return path


def seconds(function: Callable[[], object]) -> float:
    """The best of three calls."""
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        function()
        taken.append(time.perf_counter() - start)
    return min(taken)


def trimesh_alone(path: Path) -> None:
    scene = trimesh.load_scene(path, process=False)
    for geometry in scene.geometry.values():
        geometry.visual.material.image.load()


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write_obj(Path(folder))
        mesh = read_mesh(path)
        ours, theirs = seconds(lambda: read_mesh(path)), seconds(lambda: trimesh_alone(path))
    print(f"{len(mesh.faces)} faces, {len(mesh.vertices)} vertices after joining")
    print(f"read_mesh       {ours:6.2f} s")
    print(f"trimesh alone   {theirs:6.2f} s   ratio {ours / theirs:.2f}")
    print(f"check_winding   {seconds(lambda: check_winding(mesh)):6.2f} s")


if __name__ == "__main__":
    main()
