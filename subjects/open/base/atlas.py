"""One texture for the whole subject: where each chart lies, and what each texel shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from subjects.open.base.subdivision import refine, triangles
from subjects.open.base.template import BODY, EYES, SKIRT, TIGHTS, template

HAIR = "hair"
OUTER = "outer"
"""The tights charted once more, for a jacket over a top; the part that a jacket can cover."""
REFINED = {TIGHTS: 2, OUTER: 2, SKIRT: 2}
"""How often the charts' groups are refined before they are baked."""
OUTER_LOWEST = -0.2
"""Template height down to which OUTER is charted; what lies below falls outside its rectangle."""
Rectangle = tuple[float, float, float, float]
# Island k of a group (by falling chart area) fills a rectangle u0, v0, u1, v1 of the atlas.
PLACES: dict[str, tuple[Rectangle, ...]] = {
    TIGHTS: (
        (0.000, 0.500, 0.440, 1.000),
        (0.440, 0.120, 0.600, 0.238),
        (0.440, 0.002, 0.600, 0.120),
    ),
    OUTER: ((0.000, 0.112, 0.440, 0.500),),
    BODY: (
        (0.700, 0.660, 1.000, 1.000),
        (0.440, 0.508, 0.700, 1.000),
        (0.600, 0.120, 0.724, 0.238),
        (0.600, 0.002, 0.724, 0.120),
        (0.850, 0.186, 0.920, 0.238),
        (0.700, 0.512, 0.850, 0.656),
        (0.850, 0.512, 1.000, 0.656),
        (0.925, 0.186, 0.962, 0.238),
        (0.963, 0.186, 1.000, 0.238),
    ),
    SKIRT: ((0.440, 0.240, 0.840, 0.508),),
    EYES[0]: ((0.726, 0.180, 0.786, 0.238), (0.726, 0.122, 0.786, 0.180)),
    EYES[1]: ((0.788, 0.180, 0.848, 0.238), (0.788, 0.122, 0.848, 0.180)),
}
# Rectangles for what has no chart of its own: hair, and what is sewn on or worn with the clothes.
CELLS: dict[str, Rectangle] = {
    HAIR: (0.840, 0.240, 1.000, 0.508),
    "belt": (0.000, 0.000, 0.440, 0.024),
    "sole": (0.000, 0.026, 0.220, 0.056),
    "collar": (0.000, 0.058, 0.220, 0.084),
    "jacket_collar": (0.000, 0.086, 0.220, 0.112),
    "lace": (0.222, 0.026, 0.262, 0.056),
    "button": (0.222, 0.058, 0.262, 0.084),
    "metal": (0.222, 0.086, 0.262, 0.112),
    "pocket": (0.264, 0.026, 0.350, 0.112),
    "back_pocket": (0.352, 0.026, 0.438, 0.112),
    "jacket_pocket": (0.726, 0.062, 0.840, 0.118),
    "lining": (0.726, 0.002, 0.840, 0.060),
    "hood": (0.842, 0.002, 1.000, 0.118),
    "cap": (0.850, 0.120, 1.000, 0.184),
}
GROUPS = (BODY, TIGHTS, OUTER, SKIRT, *EYES, *CELLS)
MARGIN = 0.002
"""Left free inside each rectangle, so that neighbours do not bleed into each other."""


def chart(group: str) -> np.ndarray:
    """Atlas coordinates (F, 4, 2) of a group's quad corners, in [0, 1].

    OUTER has the quads of TIGHTS; those below OUTER_LOWEST lie anywhere and show nothing.
    """
    return _charts()[group]


def cell(name: str, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Atlas coordinates (..., 2) in the cell `name` of CELLS, of `u`, `v` in [0, 1]."""
    u0, v0, u1, v1 = CELLS[name]
    wide, high = u1 - u0 - 2 * MARGIN, v1 - v0 - 2 * MARGIN
    return np.stack([u0 + MARGIN + u * wide, v0 + MARGIN + v * high], axis=-1)


@lru_cache(maxsize=1)
def _charts() -> dict[str, np.ndarray]:
    result = {}
    for name, group in template().groups.items():
        island = _islands(group.quads, group.uv)
        placed = np.empty_like(group.uv)
        for k, place in enumerate(PLACES[name]):
            placed[island == k] = _fitted(group.uv[island == k], group.uv[island == k], place)
        result[name] = placed
    tights = template().groups[TIGHTS]
    result[OUTER] = _fitted(tights.uv, tights.uv[_covered_by_jacket()], PLACES[OUTER][0])
    return result


def _fitted(corners: np.ndarray, within: np.ndarray, place: Rectangle) -> np.ndarray:
    """`corners` moved and scaled as brings those `within` into the middle of a rectangle."""
    u0, v0, u1, v1 = place
    low, high = within.min(axis=(0, 1)), within.max(axis=(0, 1))
    room = np.array([u1 - u0, v1 - v0]) - 2 * MARGIN
    scale = (room / (high - low)).min()
    shift = np.array([u0, v0]) + MARGIN + (room - scale * (high - low)) / 2
    return (corners - low) * scale + shift


def _covered_by_jacket() -> np.ndarray:
    """(F,) bool: the quads of TIGHTS that OUTER shows."""
    quads = template().groups[TIGHTS].quads
    return (template().vertices[quads][..., 1] > OUTER_LOWEST).any(axis=1)


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
        source: (T, 2) the group's own chart coordinates (the base mesh's), v upwards; of a cell
            its u, v in [0, 1], and its place is the origin.
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
    groups = template().groups
    quads = {name: np.ones(len(group.quads), dtype=bool) for name, group in groups.items()}
    for name, shown in {**quads, OUTER: _covered_by_jacket()}.items():
        group = groups[TIGHTS if name == OUTER else name]
        # Clothes are refined when they are cut: a stripe is as straight as their surface is.
        levels = REFINED.get(name, 0)
        uv = np.concatenate([chart(name), group.uv], axis=2)
        fine = refine(group.quads, uv, len(template().vertices), levels)
        kept = np.repeat(shown, 4**levels)
        place = (fine.matrix @ template().vertices)[fine.quads]
        corners.append(triangles(fine.corners[..., :2][kept]))
        values.append(triangles(np.concatenate([place, fine.corners[..., 2:]], axis=2)[kept]))
        owner.append(np.full(len(corners[-1]), GROUPS.index(name)))
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    flat = np.concatenate([np.zeros((4, 3)), unit], axis=1)[None]
    for name in CELLS:
        corners.append(triangles(cell(name, unit[:, 0], unit[:, 1])[None]))
        values.append(triangles(flat))
        owner.append(np.full(2, GROUPS.index(name)))
    xy = np.concatenate(corners) * [size, -size] + [0.0, size]
    face_of, weights, pixel = _rasterise(xy, size)
    seen = (weights[..., None] * np.concatenate(values)[face_of]).sum(axis=1)
    covered = np.zeros(size * size, dtype=bool)
    covered[pixel] = True
    index = np.zeros(size * size, dtype=np.int64)
    index[pixel] = np.arange(len(pixel))
    rows, columns = distance_transform_edt(
        ~covered.reshape(size, size), return_distances=False, return_indices=True
    )
    nearest = index[(rows * size + columns).ravel()]
    return Texels(size, pixel, np.concatenate(owner)[face_of], seen[:, :3], seen[:, 3:], nearest)


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
