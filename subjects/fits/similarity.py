"""A similarity that stands in a file: how a posed body gets into its scan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from subjects.fits.parameters import read_values
from subjects.mesh import MeshError

TOLERANCE = 1e-3
"""On R^T R = 1: numbers in text files are rounded."""


def compose(scale: float, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """(4, 4) of `scale * rotation @ v + translation`."""
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    matrix[:3, 3] = translation
    return matrix


def read_similarity(path: Path) -> np.ndarray:
    """(4, 4) from a JSON file: {"scale", "rotation", "translation"} or {"matrix"}.

    Raises:
        MeshError: the file cannot be read, or what it says is no similarity.
    """
    values = read_values(path)
    try:
        if "matrix" in values:
            matrix = _array(values["matrix"], (4, 4))
        else:
            matrix = compose(
                float(_array(values.get("scale", 1.0), ())),
                _array(values.get("rotation", np.eye(3)), (3, 3)),
                _array(values.get("translation", np.zeros(3)), (3,)),
            )
    except (TypeError, ValueError, OverflowError) as error:
        raise MeshError(f"{path}: {error}; give a scale, a 3x3 rotation, a translation") from None
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    square = np.trace(gram) / 3
    turned = square > 0 and np.abs(gram / square - np.eye(3)).max() <= TOLERANCE
    if not turned or np.linalg.det(matrix[:3, :3]) <= 0 or not (matrix[3] == (0, 0, 0, 1)).all():
        raise MeshError(
            f"{path}: is no similarity (one scale above 0, a rotation without a mirror, a "
            "translation); correct it"
        )
    return matrix


def _array(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"holds {array.shape} numbers where {shape} finite ones are due")
    return array
