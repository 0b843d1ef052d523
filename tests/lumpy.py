"""Scans that no one has to share: lumpy ellipsoids with a texture of noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from PIL import Image


def write_lumpy(path: Path, seed: int, radii: ArrayLike, center: ArrayLike = (0, 0, 0)) -> None:
    """One scan of 5,120 triangles, in the units and with the axes of `radii`."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=4)
    bumps = 1 + 0.08 * np.sin(ball.vertices @ rng.normal(0, 6, (3, 3))).prod(axis=1)
    vertices = ball.vertices * bumps[:, None] * radii + center
    texture = Image.fromarray(rng.integers(0, 256, (64, 64, 3), dtype=np.uint8))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=texture)
    uv = ball.vertices[:, :2] * 0.5 + 0.5
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    trimesh.Trimesh(vertices, ball.faces, visual=visual, process=False).export(path)
