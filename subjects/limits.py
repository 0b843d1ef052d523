"""How large a subject's files may be."""

from __future__ import annotations

from dataclasses import dataclass, fields

from subjects.mesh import MeshError

VERTICES_PER_TRIANGLE = 3
"""Vertices a triangle may come with: three where none is shared, as in STL."""


@dataclass(frozen=True)
class Limits:
    """Bounds on one subject's files, each checked before the memory is taken.

    A few bytes of a file can claim any number of vertices and pixels.
    """

    mesh_mb: float = 1024
    """Most MB to read for one mesh: its file, materials, buffers and images together."""
    triangles: int = 10_000_000
    """Most triangles of a mesh, every instance counted; it may have three times the vertices."""
    texture_megapixels: float = 270
    """Most megapixels of a mesh's textures together; 16384 x 16384 are 268.4."""
    fit_mb: float = 512
    """Most MB that one file of fits or estimates may hold, and may unpack to."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 < value < float("inf"):
                raise ValueError(
                    f"subjects.limits.{field.name}: {value} is no bound; give a number above 0"
                )

    def check_megabytes(self, size: int, what: str) -> None:
        """MeshError where the `size` in bytes of `what` is above `mesh_mb`."""
        if size > self.mesh_mb * 1e6:
            raise MeshError(
                f"{what} {size / 1e6:.4g} MB, more than {self.mesh_mb:g}; "
                "make it smaller or raise subjects.limits.mesh_mb"
            )

    def check_count(self, *, triangles: int = 0, vertices: int = 0) -> None:
        """MeshError where a mesh has more of either than `triangles` allows."""
        for count, most, name in (
            (triangles, self.triangles, "triangles"),
            (vertices, self.triangles * VERTICES_PER_TRIANGLE, "vertices"),
        ):
            if count > most:
                raise MeshError(
                    f"has {count} {name}, more than {most}; "
                    "decimate it or raise subjects.limits.triangles"
                )

    def check_pixels(self, pixels: int, name: str) -> None:
        """MeshError where textures, `name` the last of them, have more than their megapixels."""
        if pixels > self.texture_megapixels * 1e6:
            raise MeshError(
                f"its textures up to '{name}' have {pixels / 1e6:.4g} megapixels, more than "
                f"{self.texture_megapixels:g}; scale them down or raise "
                "subjects.limits.texture_megapixels"
            )
