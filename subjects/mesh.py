"""A surface as the pipeline holds it: triangles, texture, colour."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np


class MeshError(ValueError):
    """A surface that cannot be rendered; the message says why and what to do."""


@dataclass(frozen=True, eq=False)
class Material:
    """What a face is covered with: a matte (Lambertian) colour or texture.

    Attributes:
        color: (3,) float, sRGB in [0, 1]; multiplies nothing, used where there is no texture.
        texture: (h, w, 3) uint8 sRGB with row 0 at the top, or None.
    """

    color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    texture: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh with one normal per shared vertex.

    Faces that share a vertex index share its normal there; a hard edge is two vertices at one
    place. Texture coordinates belong to face corners, so a texture seam never splits a normal.

    Attributes:
        vertices: (N, 3) float64, metres once placed in the world.
        faces: (F, 3) int32, counter-clockwise seen from outside.
        uv: (F, 3, 2) float32 per face corner, v upwards, or None.
        materials: what the faces refer to.
        face_material: (F,) int32 index into `materials`.
        vertex_colors: (N, 3) uint8 sRGB; where given, it replaces the materials.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    materials: tuple[Material, ...] = (Material(),)
    face_material: np.ndarray = field(default=None)  # type: ignore[arg-type]
    vertex_colors: np.ndarray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", np.asarray(self.vertices, dtype=np.float64))
        object.__setattr__(self, "faces", np.asarray(self.faces, dtype=np.int32))
        if self.face_material is None:
            object.__setattr__(self, "face_material", np.zeros(len(self.faces), dtype=np.int32))
        self._check()

    def _check(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or len(self.vertices) == 0:
            raise MeshError("the mesh has no vertices; export it again with its geometry")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or len(self.faces) == 0:
            raise MeshError("the mesh has no faces; export a surface, not a point cloud")
        bad = ~np.isfinite(self.vertices).all(axis=1)
        if bad.any():
            raise MeshError(
                f"{int(bad.sum())} of {len(self.vertices)} vertices are NaN or infinite "
                f"(the first is vertex {int(np.argmax(bad))}); clean the mesh"
            )
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise MeshError(
                f"a face names vertex {int(self.faces.max())}, "
                f"but there are {len(self.vertices)}; export it again"
            )
        if self.uv is not None and not np.isfinite(self.uv).all():
            raise MeshError("texture coordinates are NaN or infinite; unwrap the mesh again")

    def transformed(self, similarity: np.ndarray) -> Mesh:
        """The mesh with `similarity` (4, 4) applied to its vertices."""
        return replace(self, vertices=self.vertices @ similarity[:3, :3].T + similarity[:3, 3])

    def flipped(self) -> Mesh:
        """The mesh with its faces turned inside out."""
        uv = None if self.uv is None else self.uv[:, ::-1]
        return replace(self, faces=self.faces[:, ::-1], uv=uv)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner, (3,) each."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)
