"""Flat coordinates on a surface, and where in the world their points lie."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

CANDIDATES = 12
"""Triangles nearest to a point of the map that may hold it."""
STEP = 0.012
"""Metres on the template over which a chart's scale is measured."""


@dataclass(frozen=True, eq=False)
class Chart:
    """A flat map of part of a surface, such as a garment's front.

    Attributes:
        faces: (F, 3) the triangles that it shows.
        flat: (F, 3, 2) their corners on the map.
        vertices, normals: (N, 3) of the surface, the normals calmed over some centimetres.
        unit: about how many template metres a unit of the map is, along both of its axes.
    """

    faces: np.ndarray
    flat: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray
    unit: np.ndarray

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.flat.mean(axis=1) * self.unit)

    def _found(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(M,) triangle, (M, 3) barycentric shares in it, (M,) how far inside it."""
        count = min(CANDIDATES, len(self.faces))
        _, near = self._tree.query(points * self.unit, k=count)
        near = near.reshape(len(points), count)
        corner = self.flat[near]
        a, b, p = (
            corner[:, :, 1] - corner[:, :, 0],
            corner[:, :, 2] - corner[:, :, 0],
            points[:, None] - corner[:, :, 0],
        )
        area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        area = np.where(np.abs(area) < 1e-14, 1e-14, area)
        second = (p[..., 0] * b[..., 1] - p[..., 1] * b[..., 0]) / area
        third = (a[..., 0] * p[..., 1] - a[..., 1] * p[..., 0]) / area
        share = np.stack([1.0 - second - third, second, third], axis=-1)
        inside = share.min(axis=-1)
        best = inside.argmax(axis=1)
        row = np.arange(len(points))
        # Off the cloth, the nearest triangle's nearest point.
        kept = np.clip(share[row, best], 0.0, None)
        kept /= kept.sum(axis=1, keepdims=True)
        return near[row, best], kept, inside[row, best]

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (..., 3) in the world and unit normals (..., 3) at `points` (..., 2).

        A point off the map is taken to its border.
        """
        triangle, share, _ = self._found(points.reshape(-1, 2))
        corners = self.faces[triangle]
        where = (share[..., None] * self.vertices[corners]).sum(axis=1)
        out = (share[..., None] * self.normals[corners]).sum(axis=1)
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
        shape = (*points.shape[:-1], 3)
        return where.reshape(shape), out.reshape(shape)

    def holds(self, points: np.ndarray) -> np.ndarray:
        """(...) bool: whether `points` (..., 2) lie on the map."""
        _, _, inside = self._found(points.reshape(-1, 2))
        return (inside > -0.1).reshape(points.shape[:-1])

    def scale(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) metres in the world per unit of the map, along both of its axes."""
        result = []
        for step, unit in zip(STEP * np.eye(2) / self.unit, self.unit, strict=True):
            # At the border of the map one side is cut off: measure what is there.
            ends = [
                np.where(self.holds(points + s)[..., None], points + s, points)
                for s in (-step, step)
            ]
            length = np.linalg.norm(self.at(ends[1])[0] - self.at(ends[0])[0], axis=-1)
            span = np.linalg.norm((ends[1] - ends[0]) * self.unit, axis=-1)
            whole = length / np.maximum(span, 1e-9)
            result.append(np.where(span > 0, np.clip(whole, 0.5, 2.0), 1.0) * unit)
        return np.stack(result, axis=-1)

    def laid(self, points: np.ndarray, height: np.ndarray, calm: int = 0) -> np.ndarray:
        """A grid (R, C, 3) that follows the cloth at `height` (R, C) metres above it.

        Args:
            points: (R, C, 2) on the map.
            calm: variance of the smoothing, in steps of the grid: a stiff trim spans hollows that
                cloth folds into.
        """
        where, out = self.at(points)
        lift = np.zeros(points.shape[:-1])
        if calm:
            smooth = where
            for axis in (0, 1):
                smooth = gaussian_filter1d(smooth, np.sqrt(calm), axis=axis, mode="nearest")
            lift = np.maximum(((smooth - where) * out).sum(axis=-1), 0.0)
            # What is sunk into the cloth stays there.
            lift *= height > 0
        return where + (height + lift)[..., None] * out
