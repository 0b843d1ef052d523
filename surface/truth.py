"""The surface that others are measured against."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene

from shards.dataset import Dataset
from surface.distances import sample
from surface.mesh import TriangleMesh, read_mesh

SAMPLES = 50_000
"""Points of a surface whose distance is measured, about; twice as many of a truth are looked at."""

DIRECTIONS = 64
"""In which a point looks for the open."""

_OFF = 1e-4
"""Of the surface's longest side: how far from it a look begins."""


@dataclass(frozen=True, eq=False)
class Truth:
    """A subject's own surface.

    Attributes:
        mesh: all of it.
        points: (N, 3) spread evenly over the part of it that is in the open.
    """

    mesh: TriangleMesh
    points: np.ndarray

    @classmethod
    def of(cls, mesh: TriangleMesh, rng: np.random.Generator, samples: int = SAMPLES) -> Truth:
        """The truth of a mesh.

        Open humans wear clothes over bodies and one garment over another. What lies between them
        can be seen from nowhere and belongs to no scan: it is no part of what is to be found.

        Args:
            samples: about how many points; as many as are in the open of twice that.

        Raises:
            SurfaceError: the surface has no area.
        """
        points = sample(mesh, 2 * samples, rng)
        return cls(mesh, points[exposed(points, mesh)])

    def transformed(self, similarity: np.ndarray) -> Truth:
        """With a (4, 4) similarity applied."""
        moved = self.points @ similarity[:3, :3].T + similarity[:3, 3]
        return replace(self, mesh=self.mesh.transformed(similarity), points=moved)


def true_surface(dataset: Dataset, subject: str) -> TriangleMesh:
    """A subject's own surface in its world, metres.

    Raises:
        SurfaceError: its file cannot be used.
    """
    meta = dataset.shard(subject).meta
    return read_mesh(dataset.path(meta["mesh"])).transformed(np.array(meta["mesh_to_world"]))


def exposed(points: np.ndarray, mesh: TriangleMesh) -> np.ndarray:
    """(N,) bool: the points from which something else than the surface can be seen.

    Each looks in `DIRECTIONS` directions, spread evenly over the sphere; one that is free counts.

    Args:
        points: (N, 3) on the surface.
    """
    low, high = mesh.bounds
    scene = EmbreeScene(robust=True)
    EmbreeMesh(scene, mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    found = np.zeros(len(points), dtype=bool)
    for direction in _sphere(DIRECTIONS):
        left = np.flatnonzero(~found)
        origins = (points[left] + _OFF * float((high - low).max()) * direction).astype(np.float32)
        looks = np.ascontiguousarray(np.broadcast_to(direction.astype(np.float32), origins.shape))
        found[left] = scene.run(origins, looks) < 0
    return found


def _sphere(count: int) -> np.ndarray:
    """(count, 3) unit vectors on a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    y, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - y**2)
    return np.stack([across * np.cos(turn), y, across * np.sin(turn)], axis=1)
