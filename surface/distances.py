"""Exact distances between surfaces: points of one to the nearest points of the other."""

from __future__ import annotations

import igl
import numpy as np

from surface.mesh import SurfaceError, TriangleMesh


def sample(mesh: TriangleMesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) points spread evenly over a surface's area.

    Of every count-th part of the area there is one point: the spread is that of a uniform draw,
    with less chance in it.

    Raises:
        SurfaceError: the surface has no area.
    """
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upto = np.cumsum(np.linalg.norm(cross, axis=1))
    if not upto[-1] > 0:
        raise SurfaceError("the surface has no area; all its triangles are flat")
    place = (np.arange(count) + rng.random(count)) / count * upto[-1]
    chosen = corners[np.minimum(np.searchsorted(upto, place, side="right"), len(upto) - 1)]
    root, share = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (
        (1 - root) * chosen[:, 0] + root * (1 - share) * chosen[:, 1] + root * share * chosen[:, 2]
    )


def nearest(points: np.ndarray, mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """How far points are from a surface, and its points that are nearest to them.

    Args:
        points: (N, 3).

    Returns:
        (N,) distances to the triangles, exact but for rounding, and (N, 3) points on them.
    """
    squared, _, closest = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points, dtype=np.float64), mesh.vertices, mesh.faces
    )
    return np.sqrt(np.maximum(squared, 0)), closest
