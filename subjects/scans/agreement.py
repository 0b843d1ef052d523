"""Whether a scan and a body are of one person."""

from __future__ import annotations

import numpy as np

from subjects.fits.body import Body, surface_distance
from subjects.mesh import Mesh, MeshError

HEIGHTS = (0.6, 1.1)
"""A body's height over its scan's: hair and what is held up add to a scan, little to a body."""


def check_size(mesh: Mesh, body: Body, mesh_to_world: np.ndarray, what: str) -> None:
    """Refuse a body that has not the scan's size, or whose middle is outside of its box.

    Args:
        mesh: the scan.
        body: of the scan.
        mesh_to_world: (4, 4) from the scan's coordinates.
        what: names the body and how it was placed, for the message.

    Raises:
        MeshError: it is another one's, or in another unit.
    """
    scan, placed = mesh.transformed(mesh_to_world), body.in_scan().transformed(mesh_to_world)
    (low, high), (scan_low, scan_high) = placed.bounds, scan.bounds
    height, scan_height = high[1] - low[1], scan_high[1] - scan_low[1]
    centre = (low + high) / 2
    if not HEIGHTS[0] <= height / scan_height <= HEIGHTS[1]:
        fault = "is of another size"
    elif not ((scan_low <= centre) & (centre <= scan_high)).all():
        fault = "lies elsewhere"
    else:
        return
    raise MeshError(
        f"its body {what} {fault} than the scan ({height:.4g} m high, the scan "
        f"{scan_height:.4g} m); export it in the scan's coordinates and unit"
    )


def distances(mesh: Mesh, body: Body, mesh_to_world: np.ndarray) -> dict[str, float]:
    """How far a scan and a body are apart, JSON-ready.

    Args:
        mesh: the scan.
        body: of the scan.
        mesh_to_world: (4, 4) from the scan's coordinates.

    Returns:
        "scan_to_body_mm", the mean over the scan's surface of the distance from the nearest point
        of the body, and "body_to_scan_mm", the same the other way.
    """
    scan, placed = mesh.transformed(mesh_to_world), body.in_scan().transformed(mesh_to_world)
    return {
        "scan_to_body_mm": round(1000 * surface_distance(scan, placed), 2),
        "body_to_scan_mm": round(1000 * surface_distance(placed, scan), 2),
    }
