"""How far humans are from their own bodies, and from bodies that were put wrong.

    python -m benchmarks.fits DIR

DIR is a dataset of open humans, whose bodies are exact. The bounds on the two distances,
`Scans.max_scan_to_body` and `max_body_to_scan`, have to lie above what clothes and hair make and
below what a wrong fit makes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.fits.body import surface_distance
from subjects.mesh import Material, Mesh
from subjects.meshfile import read_mesh
from subjects.scans import Scans


def moved(
    scale: float = 1.0, yaw_deg: float = 0.0, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Callable[[Mesh], Mesh]:
    """A similarity about a body's middle."""
    turn = scale * Rotation.from_euler("y", yaw_deg, degrees=True).as_matrix()

    def move(body: Mesh) -> Mesh:
        low, high = body.bounds
        middle = (low + high) / 2
        return Mesh((body.vertices - middle) @ turn.T + middle + shift, body.faces)

    return move


BODIES = {
    "its own": moved(),
    "10 cm to a side": moved(shift=(0.1, 0, 0)),
    "10 cm up": moved(shift=(0, 0.1, 0)),
    "turned by 30 deg": moved(yaw_deg=30),
    "turned by 180 deg": moved(yaw_deg=180),
    "10 % too small": moved(scale=0.9),
    "10 % too large": moved(scale=1.1),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="dataset of open humans")
    folders = sorted(
        path.parent for path in (parser.parse_args().data / "subjects").glob("*/body.obj")
    )
    distances = np.zeros((len(folders), len(BODIES), 2))
    for row, folder in zip(distances, folders, strict=True):
        scan = read_mesh(folder / f"{folder.name}.obj", material=Material())
        body = read_mesh(folder / "body.obj")
        for pair, move in zip(row, BODIES.values(), strict=True):
            pair[:] = surface_distance(scan, move(body)), surface_distance(move(body), scan)
    bounds = np.array([Scans.max_scan_to_body, Scans.max_body_to_scan])
    print(f"{len(folders)} humans: least, median and most millimetres, and who is set aside by")
    print("{:g} mm from scan to body, and by that or {:g} mm back".format(*1000 * bounds))
    print(f"{'body':20}{'scan to body':>21}{'body to scan':>23}{'one':>8}{'either':>8}")
    for name, both in zip(BODIES, distances.transpose(1, 0, 2), strict=True):
        figures = [
            "{:7.1f}{:7.1f}{:7.1f}".format(*1000 * np.quantile(d, (0, 0.5, 1))) for d in both.T
        ]
        beyond = both > bounds
        shares = f"{beyond[:, 0].mean():8.0%}{beyond.any(axis=1).mean():8.0%}"
        print(f"{name:20}{'  '.join(figures)}{shares}")


if __name__ == "__main__":
    main()
