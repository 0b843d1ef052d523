"""The reference that `verify` holds a shard against: Embree rays on the mesh file itself.

The renderer has no part in it: the hits come from Embree, and which vertices are one, the
similarity to the world, the camera's rays, depths and normals are worked out here again, in
double precision on the triangles that were hit. Files are read by `shards.geometry`: a fault of
trimesh's parsers for PLY, glTF and STL would show on both sides and so remain unseen.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from shards.geometry import read_geometry

_CLEARANCE = 0.1
"""Metres between the rays' start and the surface: near, for single precision's sake."""

_NORMAL_TOLERANCE = 1e-3
"""On each coordinate of a file's own unit normals: text files round them."""


@dataclass(frozen=True)
class Hits:
    """What parallel rays meet first.

    Attributes:
        hit: (N,) bool.
        z: (N,) float64, camera frame, metres; NaN where nothing is hit.
        normal: (N, 3) float64, unit, camera frame, interpolated between the vertices, on the side
            of the surface that the ray came from; NaN where nothing is hit.
    """

    hit: np.ndarray
    z: np.ndarray
    normal: np.ndarray


class Surface:
    """Triangles in the subject's world, ready for rays; their tree is built once.

    Args:
        vertices: (N, 3) metres.
        faces: (F, 3) int.
        shared: (N,) index of the vertex that each is one with, for normals; by default none are.

    Raises:
        ValueError: vertices are not finite.
    """

    def __init__(
        self, vertices: np.ndarray, faces: np.ndarray, shared: np.ndarray | None = None
    ) -> None:
        if not np.abs(vertices).max() <= np.finfo(np.float32).max:
            raise ValueError("vertices that are not finite")
        self._vertices, self._faces = vertices, faces
        extent = np.array([vertices.min(axis=0), vertices.max(axis=0)])
        self._box = np.array([extent[corner, (0, 1, 2)] for corner in np.ndindex(2, 2, 2)])
        self._plane = _planes(vertices, faces)
        shared = np.arange(len(vertices)) if shared is None else shared
        self._normals = _vertex_normals(vertices, faces, self._plane, shared)
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, vertices.astype(np.float32), faces.astype(np.int32))

    @classmethod
    def read(cls, path: Path, mesh_to_world: np.ndarray) -> Self:
        """A mesh file's surface.

        Args:
            path: an OBJ file, or any other that trimesh reads.
            mesh_to_world: (4, 4) similarity from the file's coordinates to metres.

        Raises:
            ValueError: if the file cannot be parsed or holds no triangles, or vertices that are
                not finite; one line that names it.
            OSError: if it cannot be opened.
        """
        vertices, faces, own_normals = read_geometry(path)
        # Merged by the file's own numbers, before the similarity rounds them.
        shared = merged(vertices, own_normals)
        placed = vertices @ mesh_to_world[:3, :3].T + mesh_to_world[:3, 3]
        try:
            return cls(placed, faces, shared)
        except ValueError as error:
            raise ValueError(f"{path} has {error}") from None

    def bounds(self, camera_to_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner in the camera's frame, metres, (3,) each."""
        inside = (self._vertices - camera_to_world[:3, 3]) @ camera_to_world[:3, :3]
        return inside.min(axis=0), inside.max(axis=0)

    def cast(self, xy: np.ndarray, camera_to_world: np.ndarray, towards: int) -> Hits:
        """Cast rays along the camera's z axis.

        Args:
            xy: (N, 2) where the rays pass, camera frame, metres.
            camera_to_world: (4, 4) rigid.
            towards: -1 as the front camera looks, +1 from behind towards it.
        """
        rotation, position = camera_to_world[:3, :3], camera_to_world[:3, 3]
        depths = (self._box - position) @ rotation[:, 2]
        start = depths.max() + _CLEARANCE if towards < 0 else depths.min() - _CLEARANCE
        origins = np.column_stack([xy, np.full(len(xy), start)]) @ rotation.T + position
        direction = towards * rotation[:, 2]
        directions = np.broadcast_to(direction.astype(np.float32), origins.shape)
        triangle = self._scene.run(origins.astype(np.float32), np.ascontiguousarray(directions))
        hit = triangle >= 0
        z = np.full(len(xy), np.nan)
        normal = np.full((len(xy), 3), np.nan)
        distance, world_normal = self._meet(triangle[hit], origins[hit], direction)
        z[hit] = start + towards * distance
        normal[hit] = world_normal @ rotation
        return Hits(hit, z, normal)

    def _meet(
        self, triangle: np.ndarray, origins: np.ndarray, direction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distance and oriented normal where each ray meets its triangle, in double precision."""
        corners = self._vertices[self._faces[triangle]]  # (N, 3, 3): corner, axis
        plane = self._plane[triangle]
        slope = plane @ direction
        offset = np.einsum("ni,ni->n", plane, corners[:, 0] - origins)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = offset / slope
        along = (corners - origins[:, None]) @ direction
        # A triangle seen edge-on has no single distance: keep to its extent.
        near = along.min(axis=1)
        distance = np.where(np.isfinite(distance), distance, near)
        distance = np.clip(distance, near, along.max(axis=1))
        weights = _barycentric(corners, plane, origins + distance[:, None] * direction)
        normal = np.einsum("nc,nci->ni", weights, self._normals[self._faces[triangle]])
        normal[slope > 0] *= -1
        return distance, _unit(normal)


def merged(vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(N,) index of the shared vertex: one for equal positions whose own normals agree."""
    order = np.lexsort(vertices.T)
    moved = np.any(np.diff(vertices[order], axis=0) != 0, axis=1)
    place = np.empty(len(vertices), dtype=np.int64)
    place[order] = np.concatenate([[0], np.cumsum(moved)])
    normals = _unit(normals)
    shared = np.empty(len(vertices), dtype=np.int64)
    rest, count = np.arange(len(vertices)), 0
    while len(rest):  # once for each different normal at one place
        _, first, group = np.unique(place[rest], return_index=True, return_inverse=True)
        apart = np.abs(normals[rest] - normals[rest[first[group]]]).max(axis=1)
        alike = apart < _NORMAL_TOLERANCE
        shared[rest[alike]] = count + group[alike]
        rest, count = rest[~alike], count + len(first)
    return shared


def _planes(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F, 3) unit normals of the triangles; 0 for those without area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return _unit(np.cross(b - a, c - a))


def _vertex_normals(
    vertices: np.ndarray, faces: np.ndarray, planes: np.ndarray, shared: np.ndarray
) -> np.ndarray:
    """(N, 3) unit normals: the mean of the faces around, weighted by their angle there."""
    count = int(shared.max()) + 1
    total = np.zeros((count, 3))
    for corner in range(3):
        here, ahead, behind = (vertices[faces[:, (corner + step) % 3]] for step in range(3))
        cosine = np.einsum("ni,ni->n", _unit(ahead - here), _unit(behind - here))
        weighted = planes * np.arccos(np.clip(cosine, -1, 1))[:, None]
        owner = shared[faces[:, corner]]
        for axis in range(3):
            total[:, axis] += np.bincount(owner, weighted[:, axis], minlength=count)
    return _unit(total)[shared]


def _barycentric(corners: np.ndarray, plane: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(N, 3) weights of the corners at each point, within [0, 1], sum 1."""
    areas = [
        np.einsum(
            "ni,ni->n",
            np.cross(corners[:, (c + 1) % 3] - point, corners[:, (c + 2) % 3] - point),
            plane,
        )
        for c in range(3)
    ]
    weights = np.clip(np.column_stack(areas), 0, None)
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, out=np.full_like(weights, 1 / 3), where=total > 0)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """The vectors at length 1; those of length 0 stay 0."""
    length = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))[:, None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
