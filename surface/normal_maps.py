"""Orthographic normal maps of a surface, by ray casting, from any side."""

from __future__ import annotations

import numpy as np

from shards.raycast import Surface, merged
from surface.cloud import lines_of_sight
from surface.mesh import TriangleMesh

SIZE = 512
"""Pixels of a map's side (section 4.2 of the paper)."""


def castable(mesh: TriangleMesh) -> Surface:
    """A mesh ready for rays; vertices at one place share their normal, so seams do not show."""
    return Surface(mesh.vertices, mesh.faces, merged(mesh.vertices, np.zeros_like(mesh.vertices)))


def around(angle_deg: float) -> np.ndarray:
    """(4, 4) camera to world, round the vertical axis: 0 looks from +z, 90 from +x."""
    angle = np.radians(angle_deg)
    camera = np.eye(4)
    camera[0, 0] = camera[2, 2] = np.cos(angle)
    camera[0, 2], camera[2, 0] = np.sin(angle), -np.sin(angle)
    return camera


def normal_map(
    surface: Surface, angle_deg: float, half: float, size: int = SIZE
) -> tuple[np.ndarray, np.ndarray]:
    """What a camera sees that went round the vertical axis by an angle.

    Args:
        surface: around the origin.
        angle_deg: as `around` has it.
        half: half of the window's side, in the surface's unit.
        size: pixels of the side.

    Returns:
        (size, size, 3) float64 unit normals in that camera's frame, on the side that is seen,
        between the vertices' normals, 0 where nothing is hit; and (size, size) bool, where it is.
    """
    camera = around(angle_deg)
    x, y = lines_of_sight((size, size), 2 * half / size)
    low, high = surface.bounds(camera)
    near = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
    normals = np.zeros((size, size, 3))
    hit = np.zeros((size, size), dtype=bool)
    if near.any():
        hits = surface.cast(np.stack([x[near], y[near]], axis=1), camera, -1)
        hit[near] = hits.hit
        normals[hit] = hits.normal[hits.hit]
    return normals, hit


def encoded(normals: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """Normals from -1..1 to the 0..1 of an image, 0 where there is nothing."""
    return np.where(hit[..., None], (normals + 1) / 2, 0)
