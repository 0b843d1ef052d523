"""A surface of triangles, and the files it goes into and comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from augment.srgb import linear
from shards.geometry import read_geometry
from storage.atomic import atomic_write

FORMATS = (".obj", ".glb", ".ply")
"""What `write_mesh` writes."""

ENDINGS = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")
"""Of the files that are taken for meshes and read."""


class SurfaceError(ValueError):
    """A surface that cannot be measured or made; one line: what, where, the cure."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A triangle mesh.

    Attributes:
        vertices: (N, 3) float64, metres where the maker knows them.
        faces: (F, 3) int64, counter-clockwise seen from outside.
        colors: (N, 3) uint8 sRGB of the vertices, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colors: np.ndarray | None = None

    def transformed(self, similarity: np.ndarray) -> TriangleMesh:
        """With a (4, 4) similarity applied to its vertices."""
        return replace(self, vertices=self.vertices @ similarity[:3, :3].T + similarity[:3, 3])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner, (3,) each."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


def mesh_name(subject: str, view: int) -> str:
    """The name of a view's mesh, less its ending."""
    return f"{subject}_{view:02d}"


def read_mesh(path: Path) -> TriangleMesh:
    """The triangles of an OBJ, PLY, GLB, glTF, STL or OFF file, without its colours.

    Vertices that no face names are left out.

    Raises:
        SurfaceError: the file is missing, damaged, without faces, or has vertices that are not
            finite.
    """
    try:
        vertices, faces, _ = read_geometry(path)
    except OSError as error:
        raise SurfaceError(f"{path} cannot be opened ({error.strerror or error})") from None
    except ValueError as error:
        raise SurfaceError(str(error)) from None
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise SurfaceError(
            f"{path}: {int(bad.sum())} of {len(vertices)} vertices are NaN or infinite"
        )
    return TriangleMesh(vertices.astype(np.float64), faces.astype(np.int64))


def write_mesh(path: Path, mesh: TriangleMesh) -> None:
    """Write a mesh with its vertex colours, whole or not at all; the ending names the format.

    Colours of OBJ and PLY are sRGB, as their readers expect, those of GLB linear, as glTF 2.0 has
    them.

    Raises:
        ValueError: the ending is none of `FORMATS`.
    """
    import trimesh  # slow to start, and whatever runs a stage comes by here

    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise ValueError(f"{path}: '{path.suffix}' is no format; give {', '.join(FORMATS)}")
    colors = mesh.colors
    if colors is not None and kind == ".glb":
        colors = np.rint(255 * linear(colors / 255)).astype(np.uint8)
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colors, process=False)
    data = made.export(file_type=kind[1:], **({"include_normals": False} if kind == ".obj" else {}))
    with atomic_write(path) as file:
        file.write(data.encode() if isinstance(data, str) else data)
