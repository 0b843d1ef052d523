"""One texture for the whole subject: where each chart lies, and what each texel shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from subjects.open.subdivision import triangles
from subjects.open.template import BODY, EYES, SKIRT, TIGHTS, template

HAIR = "hair"
GROUPS = (BODY, TIGHTS, SKIRT, *EYES, HAIR)
Rectangle = tuple[float, float, float, float]
# Island k of a group (by falling chart area) fills a rectangle u0, v0, u1, v1 of the atlas.
PLACES: dict[str, tuple[Rectangle, ...]] = {
    TIGHTS: (
        (0.000, 0.380, 0.545, 1.000),
        (0.550, 0.330, 0.700, 0.450),
        (0.705, 0.330, 0.855, 0.450),
    ),
    BODY: (
        (0.000, 0.000, 0.310, 0.375),
        (0.550, 0.455, 0.835, 1.000),
        (0.840, 0.590, 0.920, 0.690),
        (0.920, 0.590, 1.000, 0.690),
        (0.860, 0.420, 0.930, 0.480),
        (0.840, 0.850, 1.000, 1.000),
        (0.840, 0.695, 1.000, 0.845),
        (0.930, 0.420, 0.965, 0.480),
        (0.965, 0.420, 1.000, 0.480),
    ),
    SKIRT: ((0.315, 0.000, 0.800, 0.325),),
    EYES[0]: ((0.840, 0.540, 0.885, 0.585), (0.840, 0.490, 0.885, 0.535)),
    EYES[1]: ((0.890, 0.540, 0.935, 0.585), (0.890, 0.490, 0.935, 0.535)),
    HAIR: ((0.805, 0.000, 1.000, 0.325),),
}
MARGIN = 0.004
"""Left free inside each rectangle, so that neighbours do not bleed into each other."""


def chart(group: str) -> np.ndarray:
    """Atlas coordinates (F, 4, 2) of a group's quad corners, in [0, 1]."""
    return _charts()[group]


def strip(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Atlas coordinates (..., 2) in the hair's rectangle of `u`, `v` in [0, 1]."""
    u0, v0, u1, v1 = PLACES[HAIR][0]
    wide, high = u1 - u0 - 2 * MARGIN, v1 - v0 - 2 * MARGIN
    return np.stack([u0 + MARGIN + u * wide, v0 + MARGIN + v * high], axis=-1)


@lru_cache(maxsize=1)
def _charts() -> dict[str, np.ndarray]:
    result = {}
    for name, group in template().groups.items():
        island = _islands(group.quads, group.uv)
        placed = np.empty_like(group.uv)
        for k, (u0, v0, u1, v1) in enumerate(PLACES[name]):
            corners = group.uv[island == k]
            low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
            room = np.array([u1 - u0, v1 - v0]) - 2 * MARGIN
            scale = (room / (high - low)).min()
            shift = np.array([u0, v0]) + MARGIN + (room - scale * (high - low)) / 2
            placed[island == k] = (corners - low) * scale + shift
        result[name] = placed
    return result


def _islands(quads: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Each face's chart, numbered by falling area."""
    corners = np.concatenate([quads[..., None], np.round(uv * 1e6)], axis=2).reshape(-1, 3)
    _, corner = np.unique(corners, axis=0, return_inverse=True)
    face = np.repeat(np.arange(len(quads)), 4)
    corner = corner.ravel()
    size = len(quads) + int(corner.max()) + 1
    graph = coo_matrix((np.ones(len(face)), (face, corner + len(quads))), shape=(size, size))
    label = connected_components(graph, directed=False)[1][: len(quads)]
    x, y = uv[..., 0], uv[..., 1]
    area = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
    names, label = np.unique(label, return_inverse=True)
    total = np.bincount(label, weights=area, minlength=len(names))
    rank = np.empty(len(names), dtype=int)
    rank[np.argsort(-total, kind="stable")] = np.arange(len(names))
    return rank[label]


@dataclass(frozen=True, eq=False)
class Texels:
    """What the atlas shows at each of the T covered texels.

    Attributes:
        size: side of the square image in pixels.
        pixel: (T,) flat index into the image, row 0 at the top.
        group: (T,) index into GROUPS.
        place: (T, 3) template coordinates.
        source: (T, 2) the group's own chart coordinates (the base mesh's), v upwards.
        nearest: (size * size,) index of the covered texel whose colour a pixel takes.
    """

    size: int
    pixel: np.ndarray
    group: np.ndarray
    place: np.ndarray
    source: np.ndarray
    nearest: np.ndarray


@lru_cache(maxsize=2)
def texels(size: int) -> Texels:
    """Bake the atlas once per process and size."""
    corners, values, owner = [], [], []
    for name, group in template().groups.items():
        place = template().vertices[group.quads]
        corners.append(triangles(chart(name)))
        values.append(triangles(np.concatenate([place, group.uv], axis=2)))
        owner.append(np.full(len(corners[-1]), GROUPS.index(name)))
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    hair = strip(unit[:, 0], unit[:, 1])[None]
    flat = np.concatenate([np.zeros((4, 3)), unit], axis=1)[None]
    corners.append(triangles(hair))
    values.append(triangles(flat))
    owner.append(np.full(2, GROUPS.index(HAIR)))
    xy = np.concatenate(corners) * [size, -size] + [0.0, size]
    face_of, weights, pixel = _rasterise(xy, size)
    shown = (weights[..., None] * np.concatenate(values)[face_of]).sum(axis=1)
    covered = np.zeros(size * size, dtype=bool)
    covered[pixel] = True
    index = np.zeros(size * size, dtype=np.int64)
    index[pixel] = np.arange(len(pixel))
    rows, columns = distance_transform_edt(
        ~covered.reshape(size, size), return_distances=False, return_indices=True
    )
    nearest = index[(rows * size + columns).ravel()]
    return Texels(size, pixel, np.concatenate(owner)[face_of], shown[:, :3], shown[:, 3:], nearest)


def _rasterise(xy: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle, barycentric weights (T, 3) and flat index of every pixel centre covered."""
    # A quad with a doubled corner (the pole of an eye) leaves a triangle without area.
    area = np.abs(_cross(xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]))
    low = np.floor(xy.min(axis=1) - 0.5).astype(int).clip(0, size - 1)
    span = np.ceil(xy.max(axis=1) + 0.5).astype(int).clip(1, size) - low
    faces, pixels, weights = [], [], []
    # Triangles of one bounding box size are done together.
    side = 2 ** np.ceil(np.log2(span.max(axis=1))).astype(int)
    for n in np.unique(side):
        chosen = np.flatnonzero((side == n) & (area > 1e-6))
        dy, dx = (g.ravel() for g in np.mgrid[0:n, 0:n])
        for some in np.array_split(chosen, max(1, len(chosen) * n * n // 2_000_000)):
            column, row = low[some, 0, None] + dx, low[some, 1, None] + dy
            p = np.stack([column + 0.5, row + 0.5], axis=2)
            a, b, c = (xy[some, k][:, None] for k in range(3))
            whole = _cross(b - a, c - a)
            w = (
                np.stack([_cross(b - p, c - p), _cross(c - p, a - p), _cross(a - p, b - p)], axis=2)
                / whole[..., None]
            )
            inside = (w >= -1e-9).all(axis=2) & (column < size) & (row < size)
            face, k = np.nonzero(inside)
            faces.append(some[face])
            pixels.append((row * size + column)[face, k])
            weights.append(w[face, k])
    pixel, first = np.unique(np.concatenate(pixels), return_index=True)
    return np.concatenate(faces)[first], np.concatenate(weights)[first], pixel


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
