"""Locks of hair: paths given a body, a groove between one strand and the next, and a chart."""

from __future__ import annotations

import numpy as np

from subjects.open.base.atlas import HAIR, cell
from subjects.open.base.surface import Piece

# A lock's section from one edge over the top to the other and back below: across, outwards.
SECTION = np.array(
    [
        (-1.0, 0.0),
        (-0.66, 0.62),
        (-0.36, 0.50),
        (-0.02, 1.0),
        (0.34, 0.58),
        (0.64, 0.70),
        (1.0, 0.0),
        (0.0, -0.55),
    ]
)
# A cheaper one, for curls: they are many and thin.
CURL = np.array([(-1.0, 0.0), (-0.45, 0.85), (0.35, 0.75), (1.0, 0.0), (0.0, -0.6)])
BREADTH = 0.16
"""Share of the hair's cell that one lock shows."""


def locks(
    path: np.ndarray,
    outward: np.ndarray,
    width: np.ndarray,
    thickness: np.ndarray,
    generator: np.random.Generator,
    section: np.ndarray = SECTION,
) -> Piece:
    """N closed locks, flat on what lies below them.

    Args:
        path: (N, K, 3) middle lines, from root to tip.
        outward: (N, K, 3) away from the head.
        width: (N, K) metres from edge to edge.
        thickness: (N, K) metres.
        section: (M, 2), see SECTION.
    """
    n, k, _ = path.shape
    m = len(section)
    along = np.gradient(path, axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    # With the path coming towards us, outward is up and the lock's left to our left.
    aside = np.cross(along, outward)
    aside /= np.maximum(np.linalg.norm(aside, axis=2, keepdims=True), 1e-9)
    out = np.cross(aside, along)
    across, high = section.T
    # No two locks have the same grooves, and they wander along them.
    sway = 0.10 * generator.uniform(-1, 1, (n, k, m)) * (np.abs(across) < 0.9)
    deep = 1.0 + 0.30 * generator.uniform(-1, 1, (n, 1, m))
    flip = generator.choice([-1.0, 1.0], (n, 1))
    u = across + sway
    h = high * deep
    h = np.where(flip[:, :, None] > 0, h, h[..., [*range(m - 2, -1, -1), m - 1]])
    rings = (
        path[:, :, None]
        + (0.5 * width[..., None] * u)[..., None] * aside[:, :, None]
        + (0.6 * thickness[..., None] * h)[..., None] * out[:, :, None]
    )
    ends = path[:, [0, -1]] + np.stack([-along[:, 0], along[:, -1]], axis=1) * 0.004
    vertices = np.concatenate([rings.reshape(n, k * m, 3), ends], axis=1)

    at = np.arange(k * m).reshape(k, m)
    a, b = at[:-1], np.roll(at[:-1], -1, axis=1)
    c, d = np.roll(at[1:], -1, axis=1), at[1:]
    sides = np.concatenate(
        [np.stack([a, c, d], axis=-1).reshape(-1, 3), np.stack([a, b, c], axis=-1).reshape(-1, 3)]
    )
    root, tip = np.full(m, k * m), np.full(m, k * m + 1)
    caps = np.concatenate(
        [
            np.stack([np.roll(at[0], -1), at[0], root], axis=1),
            np.stack([at[-1], np.roll(at[-1], -1), tip], axis=1),
        ]
    )
    one = np.concatenate([sides, caps])
    faces = one + (np.arange(n) * (k * m + 2))[:, None, None]

    start = generator.uniform(0.0, 1.0 - BREADTH, n)
    flat = np.broadcast_to(0.5 + 0.5 * across, (k, m))
    v = np.broadcast_to(np.linspace(0.97, 0.03, k)[:, None], (k, m))
    chart = np.stack([flat, v], axis=-1).reshape(-1, 2)
    chart = np.concatenate([chart, [[0.5, 1.0], [0.5, 0.0]]])
    corner = chart[one]
    u = start[:, None, None] + BREADTH * corner[..., 0]
    uv = cell(HAIR, u, np.broadcast_to(corner[..., 1], u.shape))
    return Piece(vertices.reshape(-1, 3), faces.reshape(-1, 3), uv.reshape(-1, 3, 2))


def taper(count: int, root: float, tip: float, body: float = 0.25) -> np.ndarray:
    """(K,) share of full width: `root` at first, 1 from `body` on, down to `tip`."""
    t = np.linspace(0.0, 1.0, count)
    rising = root + (1.0 - root) * np.clip(t / body, 0.0, 1.0) ** 0.7
    falling = tip + (1.0 - tip) * np.clip((1.0 - t) / 0.40, 0.0, 1.0) ** 0.8
    return np.minimum(rising, falling)
