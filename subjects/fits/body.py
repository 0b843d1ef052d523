"""A person's parametric body, and where it stands in a scan."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.crossings import extents
from subjects.mesh import Mesh, MeshError

SAMPLES = 50_000
"""Triangles of a surface at whose middles its distance to another is taken, spread evenly."""


@dataclass(frozen=True, eq=False)
class Body:
    """A posed body and the similarity that puts it into a scan.

    Whatever it was made from (SMPL-X parameters, a posed mesh, an estimator's output), this is all
    that the pipeline knows of it.

    Attributes:
        vertices: (N, 3) float64 metres, in the body's own frame.
        faces: (F, 3) int32, counter-clockwise seen from outside.
        to_scan: (4, 4) similarity from the body's frame to the coordinates of the scan's file.
        orientation: (3, 3) rotation of the pelvis, from the model's frame (y up, facing +z) to the
            body's own; None where it is not known, as of a mesh alone.
        upright: (3,) unit direction from its feet to its head, in its own frame; None likewise.
        parameters: what made it, JSON-ready.
    """

    vertices: np.ndarray
    faces: np.ndarray
    to_scan: np.ndarray = field(default_factory=lambda: np.eye(4))
    orientation: np.ndarray | None = None
    upright: np.ndarray | None = None
    parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def scan_units_per_metre(self) -> float:
        """The similarity's scale."""
        return float(np.cbrt(np.linalg.det(self.to_scan[:3, :3])))

    def in_scan(self) -> Mesh:
        """The body in the coordinates of the scan's file."""
        return Mesh(self.vertices, self.faces).transformed(self.to_scan)

    def orientation_in_scan(self) -> np.ndarray:
        """(3, 3) rotation of the pelvis, from the model's frame to the scan's coordinates.

        Raises:
            MeshError: it is not known.
        """
        if self.orientation is None:
            raise MeshError(
                "has a body that is a mesh alone, which does not say where it faces; "
                "give its parameters too (subjects.fits.parameters), or subjects.front as an axis"
            )
        turn: np.ndarray = self._rotation @ self.orientation
        return turn

    def upright_in_scan(self) -> np.ndarray:
        """(3,) unit direction from feet to head in the scan's coordinates.

        Raises:
            MeshError: it is not known.
        """
        if self.upright is None:
            raise MeshError(
                "has a body that is a mesh alone, which does not say which way is up; "
                "give its parameters too (subjects.fits.parameters), or subjects.up as an axis"
            )
        direction: np.ndarray = self._rotation @ self.upright
        return direction

    @property
    def _rotation(self) -> np.ndarray:
        rotation: np.ndarray = self.to_scan[:3, :3] / self.scan_units_per_metre
        return rotation

    def depth_maps(
        self, xy: np.ndarray, scan_to_camera: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Front and back depth maps, by exact rays; the silhouette is where they are not 0.

        Args:
            xy: (..., 2) metres in the camera's frame, where lines of sight pass.
            scan_to_camera: (4, 4) similarity from the scan's coordinates to the camera's frame
                (OpenGL, metres).

        Returns:
            (...) float32 each: the nearest and the farthest surface's distance from the camera's
            plane, metres; 0 where the line of sight misses the body.
        """
        seen = self.in_scan().transformed(scan_to_camera)
        highest, lowest = extents(xy.reshape(-1, 2), seen.vertices, seen.faces)
        shape = xy.shape[:-1]
        front, back = (np.nan_to_num(-z).astype(np.float32) for z in (highest, lowest))
        return front.reshape(shape), back.reshape(shape)


def yaw_of(turn: np.ndarray) -> float:
    """The angle about y, radians, by which a rotation (3, 3) turns what faces +z.

    It is the twist of the rotation about y: what is left is a lean about a horizontal axis. The
    heading of a person who bends forward or to a side is unchanged by the bend.

    Args:
        turn: not near a half turn about a horizontal axis, which has no yaw.
    """
    _, y, _, w = Rotation.from_matrix(turn).as_quat()
    return float(2 * np.arctan2(y, w))


def surface_distance(surface: Mesh, other: Mesh) -> float:
    """Mean distance of the points of `surface` from the nearest point of `other`.

    The mean is over area, from at most `SAMPLES` triangles' middles.
    """
    import igl

    corners = surface.vertices[surface.faces[:: len(surface.faces) // SAMPLES + 1]]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    squared, _, _ = igl.point_mesh_squared_distance(
        corners.mean(axis=1), other.vertices, other.faces.astype(np.int64)
    )
    return float((np.sqrt(squared) * area).sum() / max(area.sum(), 1e-300))
