"""The similarity that lays one surface onto another."""

from __future__ import annotations

import numpy as np

from surface.distances import nearest, sample
from surface.mesh import TriangleMesh
from surface.truth import Truth

POINTS = 4000
"""Of each surface."""

ROUNDS = 50
"""Of the nearest points, at most."""

ENOUGH = 1e-6
"""Change of the squared distance, in parts of it, below which another round is of no use."""


def best_similarity(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) similarity that takes points (N, 3) to others in the least squares.

    Umeyama, Least-squares estimation of transformation parameters between two point patterns,
    PAMI 1991.
    """
    middle, there = source.mean(axis=0), target.mean(axis=0)
    left, stretch, right = np.linalg.svd((target - there).T @ (source - middle))
    turned = np.diag([1, 1, np.sign(np.linalg.det(left @ right))])
    rotation = left @ turned @ right
    scale = (stretch * np.diag(turned)).sum() / max(((source - middle) ** 2).sum(), 1e-300)
    result = np.eye(4)
    result[:3, :3] = scale * rotation
    result[:3, 3] = there - scale * rotation @ middle
    return result


def align(mesh: TriangleMesh, truth: Truth, rng: np.random.Generator) -> np.ndarray:
    """(4, 4) similarity that lays a mesh onto the truth, which it already lies near.

    Iterated nearest points, from both surfaces to the other: from one alone a mesh would shrink
    into the truth, or swell over it.
    """
    own = sample(mesh, POINTS, rng)
    true = truth.points[:: max(len(truth.points) // POINTS, 1)]
    similarity, before = np.eye(4), np.inf
    for _ in range(ROUNDS):
        placed = mesh.transformed(similarity)
        moved = own @ similarity[:3, :3].T + similarity[:3, 3]
        off, met = nearest(moved, truth.mesh)
        back, found = nearest(true, placed)
        step = best_similarity(np.concatenate([moved, found]), np.concatenate([met, true]))
        # What a step lessens is the sum of squares; the mean may rise on the way.
        now = float((off**2).mean() + (back**2).mean())
        if not before - now > ENOUGH * now:
            break
        similarity, before = step @ similarity, now
    return similarity
