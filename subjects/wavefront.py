"""Writing Wavefront OBJ, fast and with the same bytes everywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray, decimals: int = 6) -> None:
    """A bare mesh: positions to so many decimals (of a metre: micrometres), faces, nothing else."""
    lines = [vertex_lines(vertices, decimals), rows("f %d %d %d", faces + 1)]
    path.write_text("".join(lines), encoding="ascii", newline="\n")


def vertex_lines(vertices: np.ndarray, decimals: int = 6) -> str:
    """The `v` lines of positions (N, 3)."""
    # Adding zero turns -0.0 into 0.0, which prints the same on every path to it.
    form = f"v %.{decimals}f %.{decimals}f %.{decimals}f"
    return rows(form, np.round(vertices, decimals) + 0.0)


def rows(form: str, values: np.ndarray) -> str:
    """Every row of `values` printed by `form`; one formatting call for all."""
    return ((form + "\n") * len(values)) % tuple(values.ravel().tolist())
