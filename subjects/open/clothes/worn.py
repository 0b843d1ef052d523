"""A garment on a body: the cut cloth, where it lies, and which way is out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from subjects.open.base import surface
from subjects.open.base.surface import Pattern, Piece, Solid
from subjects.open.clothes.outfit import Bottom, Top

FLANGE = 0.012
"""Metres that a hem's lining goes on inwards."""


@dataclass(frozen=True, eq=False)
class Worn:
    """One garment as it came to lie, before hems and trims.

    Attributes:
        garment: how it is cut.
        cloth: the pattern; its `faces` and `uv` are those of the vertices.
        place: (N, 3) template coordinates.
        arm: (N,) how much each vertex follows an arm.
        vertices: (N, 3) metres, the outer side.
    """

    garment: Top | Bottom
    cloth: Pattern
    place: np.ndarray
    arm: np.ndarray
    vertices: np.ndarray

    @cached_property
    def normals(self) -> np.ndarray:
        """(N, 3) outward unit normals."""
        return surface.normals(self.vertices, self.cloth.faces)

    @property
    def solid(self) -> Solid:
        """What the next layer must stay outside of."""
        return Solid(self.vertices, self.normals, self.place)

    def hemmed(self, hidden: np.ndarray) -> Piece:
        """The garment with its borders turned in, as thick as its cloth.

        Args:
            hidden: (N,) bool, vertices that need not be there, being under other cloth.
        """
        outer = Piece(self.vertices, self.cloth.faces, self.cloth.uv)
        whole = surface.hemmed(outer, self.garment.material.thickness, rings=6, reach=FLANGE)
        shown = np.ones(len(whole.faces), dtype=bool)
        shown[: len(outer.faces)] = ~hidden[outer.faces].all(axis=1)
        return Piece(whole.vertices, whole.faces[shown], whole.uv[shown])
