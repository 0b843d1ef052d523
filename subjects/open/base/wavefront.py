"""An open human's textured surface as Wavefront OBJ with its material."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from subjects.open.base.surface import Piece
from subjects.wavefront import rows, vertex_lines


def write_textured(path: Path, piece: Piece, library: str, material: str) -> None:
    """A mesh with texture coordinates per corner (`f v/vt`) and no normals.

    Positions stay shared across chart seams, so a reader that makes its own normals gets smooth
    ones.
    """
    corners = np.round(piece.uv.reshape(-1, 2), 6)
    charts, index = np.unique(corners, axis=0, return_inverse=True)
    both = np.stack([piece.faces + 1, index.reshape(-1, 3) + 1], axis=2).reshape(-1, 6)
    lines = [
        f"mtllib {library}\n",
        vertex_lines(piece.vertices),
        rows("vt %.6f %.6f", charts),
        f"usemtl {material}\n",
        rows("f %d/%d %d/%d %d/%d", both),
    ]
    path.write_text("".join(lines), encoding="ascii", newline="\n")


def write_material(path: Path, material: str, texture: str) -> None:
    """The material library: one matte material with a texture."""
    path.write_text(
        f"newmtl {material}\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {texture}\n",
        encoding="ascii",
        newline="\n",
    )
