"""Cloth that falls: garments carried from the reference pose into the body's own by a solver."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from subjects.mesh import MeshError
from subjects.open.base.surface import sides
from subjects.open.clothes.outfit import Material

ROOT = Path(__file__).parents[3]
TIME_LIMIT = 1800
"""Seconds after which a solve is given up."""
LARGEST_STRETCH = 2.0
"""Times an edge's length as cut that 99 % of the edges may reach."""
LARGEST_SPEED = 0.012
"""Metres between the last two frames (1/25 s) that 99 % of the vertices may move."""
PIN_LEVELS = 8
"""Steps from free to pinned; the solver takes one weight at a time."""


class DrapeError(RuntimeError):
    """Cloth that tore, exploded or did not come to rest; another draw may do better."""


class SolverError(MeshError):
    """The solver failed, and no cloth: another draw would hide it, and change who is drawn."""


@dataclass(frozen=True, eq=False)
class Layer:
    """One garment before it falls.

    Attributes:
        start: (N, 3) metres, clear of the body's first shape and of the layers below.
        goal: (K, N, 3) where pinned cloth goes while the body moves through its K shapes.
        flat: (N, 3) the shape that it was cut in, which its stretch is measured against.
        faces: (F, 3) int.
        pin: (N,) 0 free to 1 held.
        material: what the cloth is made of.
    """

    start: np.ndarray
    goal: np.ndarray
    flat: np.ndarray
    faces: np.ndarray
    pin: np.ndarray
    material: Material


def drape(
    layers: list[Layer],
    body: np.ndarray,
    faces: np.ndarray,
    scratch: Path,
    *,
    moving: int,
    settling: int,
    reach: float,
) -> list[np.ndarray]:
    """Let garments fall over a moving body, the inner ones first.

    Blender solves in a process of its own, which torch never shares.

    Args:
        layers: from the innermost outwards.
        body: (K, M, 3) the shapes that the body passes through, metres.
        faces: (F, 3) int.
        scratch: folder for what goes to the solver and back; nothing is left in it.
        moving: frames (1/25 s) in which the body does so.
        settling: frames in which it then stands still and the cloth comes to rest.
        reach: metres within which body and cloth feel each other; a limb that moves further in a
            step of the solver goes through.

    Returns:
        (N, 3) of each layer.

    Raises:
        DrapeError: a garment tore, exploded or did not settle.
        SolverError: the solver itself failed.
    """
    packed: dict[str, np.ndarray] = {
        "body": body,
        "body_faces": faces,
        "frames": np.array([moving, settling]),
        "reach": np.array(reach),
        "layers": np.array(len(layers)),
    }
    for i, layer in enumerate(layers):
        packed[f"start_{i}"], packed[f"goal_{i}"] = layer.start, layer.goal
        packed[f"faces_{i}"] = layer.faces
        packed[f"pin_{i}"] = np.rint(layer.pin * PIN_LEVELS) / PIN_LEVELS
        m = layer.material
        packed[f"material_{i}"] = np.array([m.mass, m.stiffness, m.bending, m.slack])
    with tempfile.TemporaryDirectory(prefix=".cloth-", dir=scratch) as name:
        source, target = Path(name) / "in.npz", Path(name) / "out.npz"
        np.savez(source, **packed)
        _solve(source, target)
        with np.load(target) as solved:
            pairs = [
                (solved[f"before_{i}"].astype(np.float64), solved[f"last_{i}"].astype(np.float64))
                for i in range(len(layers))
            ]
    for layer, (before, last) in zip(layers, pairs, strict=True):
        _check(layer, before, last)
    return [last for _, last in pairs]


def _solve(source: Path, target: Path) -> None:
    command = [sys.executable, "-m", "subjects.open.clothes.solver", str(source), str(target)]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    try:
        done = subprocess.run(
            [*command, str(os.getpid())],
            env={**os.environ, "PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SolverError(
            f"the cloth solver took more than {TIME_LIMIT} s; run fewer jobs side by side"
        ) from None
    if done.returncode != 0 or not target.is_file():
        said = done.stderr.strip().splitlines()
        raise SolverError(
            f"the cloth solver ended with {done.returncode}: {said[-1] if said else 'no word'}"
        )


def check_stretch(layer: Layer, shape: np.ndarray) -> None:
    """Raise DrapeError if the layer's cloth, lying at `shape` (N, 3), is torn."""
    edges = sides(layer.faces)

    def lengths(vertices: np.ndarray) -> np.ndarray:
        return np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)

    reached = float(np.quantile(lengths(shape) / np.maximum(lengths(layer.flat), 1e-6), 0.99))
    if reached > LARGEST_STRETCH:
        raise DrapeError(
            f"the cloth is torn: 1 % of its edges are over {reached:.2f} times as long"
        )


def _check(layer: Layer, before: np.ndarray, last: np.ndarray) -> None:
    if not np.isfinite(last).all():
        raise DrapeError("the cloth exploded")
    check_stretch(layer, last)
    speed = float(np.quantile(np.linalg.norm(last - before, axis=1), 0.99))
    if speed > LARGEST_SPEED:
        raise DrapeError(f"the cloth did not settle: it moves {speed * 1e3:.0f} mm a frame")
