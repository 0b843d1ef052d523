"""The reference that `verify` holds a shard against: Embree rays on the mesh file itself.

The renderer has no part in it: the hits come from Embree, and which vertices are one, the
similarity to the world, the camera's rays, depths and normals are worked out here again, in
double precision on the triangles that were hit. An OBJ file is parsed by `shards.wavefront`. For
PLY, glTF and STL files the parser is trimesh's, as it is for the surfaces that are rendered: a
fault in it would show on both sides and so remain unseen.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from shards.wavefront import read_obj

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
    """A mesh file in the subject's world, ready for rays; its tree is built once.

    Args:
        path: an OBJ file, or any other that trimesh reads.
        mesh_to_world: (4, 4) similarity from the file's coordinates to metres.

    Raises:
        ValueError: if the file cannot be parsed or holds no triangles; one line that names it.
        OSError: if it cannot be opened.
    """

    def __init__(self, path: Path, mesh_to_world: np.ndarray) -> None:
        vertices, faces, own_normals = _read_mesh(path)
        # Merged by the file's own numbers, before the similarity rounds them.
        shared = _merge(vertices, own_normals)
        self._vertices = vertices @ mesh_to_world[:3, :3].T + mesh_to_world[:3, 3]
        if not np.abs(self._vertices).max() <= np.finfo(np.float32).max:
            raise ValueError(f"{path} has vertices that are not finite")
        self._faces = faces
        extent = np.array([self._vertices.min(axis=0), self._vertices.max(axis=0)])
        self._box = np.array([extent[corner, (0, 1, 2)] for corner in np.ndindex(2, 2, 2)])
        self._plane = _planes(self._vertices, faces)
        self._normals = _vertex_normals(self._vertices, faces, self._plane, shared)
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, self._vertices.astype(np.float32), faces.astype(np.int32))

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


def _read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (N, 3), triangles (F, 3) and the file's own normals (N, 3), 0 where it has none.

    The normals tell which vertices are one; their frame is their part's.
    """
    try:
        vertices, faces, normals = (read_obj if path.suffix.lower() == ".obj" else _read_any)(path)
    except OSError:
        raise
    except Exception as error:  # a parser meets damage in too many ways to list
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ValueError(f"{path} is damaged or no surface ({reason})") from error
    if len(faces) == 0:
        raise ValueError(f"{path} holds no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"{path} is damaged: a face names a vertex that it does not have")
    used, faces = np.unique(faces, return_inverse=True)
    normals = np.where(np.isfinite(normals), normals, 0)
    return vertices[used], faces.reshape(-1, 3), normals[used]


def _read_any(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same by trimesh's parser, every part where the file's scene graph puts it."""
    scene = trimesh.load_scene(path, process=False, skip_materials=True)
    vertices, faces, normals = [np.empty((0, 3))], [np.empty((0, 3), int)], [np.empty((0, 3))]
    count = 0
    for node in scene.graph.nodes_geometry:
        placed, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh) or len(part.faces) == 0:
            continue
        # trimesh makes up the normals that a file lacks; only its cache tells which are given.
        given = "vertex_normals" in part._cache
        vertices.append(np.asarray(part.vertices) @ placed[:3, :3].T + placed[:3, 3])
        normals.append(np.array(part.vertex_normals) if given else np.zeros_like(vertices[-1]))
        faces.append(np.asarray(part.faces) + count)
        count += len(vertices[-1])
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals)


def _merge(vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
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
