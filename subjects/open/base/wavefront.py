"""Writing Wavefront OBJ with its material, fast and with the same bytes everywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from subjects.open.base.surface import Piece


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A bare mesh: positions to a micrometre, faces, nothing else."""
    lines = [_vertices(vertices), _rows("f %d %d %d", faces + 1)]
    path.write_text("".join(lines), encoding="ascii", newline="\n")


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
        _vertices(piece.vertices),
        _rows("vt %.6f %.6f", charts),
        f"usemtl {material}\n",
        _rows("f %d/%d %d/%d %d/%d", both),
    ]
    path.write_text("".join(lines), encoding="ascii", newline="\n")


def write_material(path: Path, material: str, texture: str) -> None:
    """The material library: one matte material with a texture."""
    path.write_text(
        f"newmtl {material}\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {texture}\n",
        encoding="ascii",
        newline="\n",
    )


def _vertices(vertices: np.ndarray) -> str:
    # Adding zero turns -0.0 into 0.0, which prints the same on every path to it.
    return _rows("v %.6f %.6f %.6f", np.round(vertices, 6) + 0.0)


def _rows(form: str, values: np.ndarray) -> str:
    """Every row of `values` printed by `form`; one formatting call for all."""
    return ((form + "\n") * len(values)) % tuple(values.ravel().tolist())
