"""A posed head: its own axes, and what hair and hats lie on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from subjects.open.base.surface import Solid

MIDDLE = np.array([0.0, 0.745, 0.05])
"""The middle of the skull in template coordinates."""


@dataclass(frozen=True, eq=False)
class Head:
    """Where hair grows and what is around it, in the world.

    Attributes:
        scalp: where hair grows, raised as `hair.raised` has it.
        solid: what hair and hats must stay outside of: head and clothes.
    """

    scalp: Solid
    solid: Solid

    @cached_property
    def _frame(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Rotation and scale from template axes to the world, and the skull's middle in it.

        Source: Umeyama 1991, least squares over the scalp.
        """
        place, vertices = self.scalp.place, self.scalp.vertices
        a, b = place - place.mean(axis=0), vertices - vertices.mean(axis=0)
        u, s, vt = np.linalg.svd((b[:, :, None] * a[:, None, :]).sum(axis=0))
        flip = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        rotation = (u * flip) @ vt
        scale = float((s * flip).sum() / (a * a).sum())
        middle = vertices.mean(axis=0) + scale * rotation @ (MIDDLE - place.mean(axis=0))
        return rotation, middle, scale

    @property
    def scale(self) -> float:
        """How large the head is against the template's."""
        return self._frame[2]

    def turned(self, direction: np.ndarray) -> np.ndarray:
        """Directions (..., 3) in the head's axes (y up, facing +z) as the world's."""
        return direction @ self._frame[0].T

    def local(self, point: np.ndarray) -> np.ndarray:
        """World points (..., 3) as template coordinates, the skull's middle at MIDDLE."""
        rotation, middle, scale = self._frame
        return (point - middle) @ rotation / scale + MIDDLE

    def world(self, place: np.ndarray) -> np.ndarray:
        """Template coordinates (..., 3) around the head as world points."""
        rotation, middle, scale = self._frame
        return scale * (place - MIDDLE) @ rotation.T + middle

    @cached_property
    def _directions(self) -> cKDTree:
        away = self.local(self.scalp.vertices) - MIDDLE
        return cKDTree(away / np.linalg.norm(away, axis=1, keepdims=True))

    def on_scalp(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where unit rays (N, 3) from the middle leave the scalp: points, normals, both (N, 3).

        The third result, (N,), is how far in radians the ray passes from where hair grows.
        """
        angle, near = self._directions.query(direction, k=6)
        weight = 1.0 / (angle + 0.01) ** 2
        weight /= weight.sum(axis=1, keepdims=True)
        away = self.local(self.scalp.vertices) - MIDDLE
        reach = (weight * np.linalg.norm(away, axis=1)[near]).sum(axis=1)
        normal = (weight[..., None] * self.scalp.normals[near]).sum(axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return self.world(MIDDLE + reach[:, None] * direction), normal, angle[:, 0]

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.solid.vertices)

    def above(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heights (N,) of points (N, 3) over the solid, and its normals (N, 3) there."""
        distance, near = self._tree.query(point, k=5)
        weight = 1.0 / (distance + 0.004) ** 2
        weight /= weight.sum(axis=1, keepdims=True)
        normal = (weight[..., None] * self.solid.normals[near]).sum(axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        foot = (weight[..., None] * self.solid.vertices[near]).sum(axis=1)
        return ((point - foot) * normal).sum(axis=1), normal

    def reach(self, direction: np.ndarray) -> np.ndarray:
        """(N,) template metres from the middle to the outermost skin or hair near unit rays."""
        away = self.local(self.solid.vertices) - MIDDLE
        length = np.linalg.norm(away, axis=1)
        own = length < 0.17
        tree = cKDTree(away[own] / length[own, None])
        _, near = tree.query(direction, k=10)
        return length[own][near].max(axis=1)
