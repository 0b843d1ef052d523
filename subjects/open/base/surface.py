"""Pieces of a surface and what is done to them: normals, smoothing, cutting, hems, push-out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree


@dataclass(frozen=True, eq=False)
class Piece:
    """A triangle mesh with a chart.

    Attributes:
        vertices: (N, 3) float64 metres, world frame.
        faces: (F, 3) int, counter-clockwise seen from outside.
        uv: (F, 3, 2) float64 atlas coordinates of the corners.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray


@dataclass(frozen=True, eq=False)
class Solid:
    """What cloth must stay outside of: (N, 3) vertices, normals, template coordinates."""

    vertices: np.ndarray
    normals: np.ndarray
    place: np.ndarray


def both(a: Solid, b: Solid) -> Solid:
    """Two solids as one."""
    return Solid(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.normals, b.normals]),
        np.concatenate([a.place, b.place]),
    )


def joined(pieces: list[Piece]) -> Piece:
    """All pieces as one mesh; nothing is welded."""
    start = np.cumsum([0] + [len(p.vertices) for p in pieces[:-1]])
    return Piece(
        np.concatenate([p.vertices for p in pieces]),
        np.concatenate([p.faces + s for p, s in zip(pieces, start, strict=True)]),
        np.concatenate([p.uv for p in pieces]),
    )


def compact(piece: Piece) -> Piece:
    """The piece without vertices that no face uses."""
    used, faces = np.unique(piece.faces, return_inverse=True)
    return Piece(piece.vertices[used], faces.reshape(-1, 3), piece.uv)


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N, 3) unit vertex normals, weighted by area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    index = faces.ravel()
    result = np.stack(
        [
            np.bincount(index, weights=np.repeat(face[:, k], 3), minlength=len(vertices))
            for k in range(3)
        ],
        axis=1,
    )
    return result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-12)


def averaging(faces: np.ndarray, count: int) -> sparse.csr_matrix:
    """(N, N) matrix that replaces each vertex by the mean of its neighbours.

    A vertex on the border takes the mean of its border neighbours alone, so hems stay hems.
    """
    edges = sides(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    pairs = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
    rim = (pairs == 1).astype(float).tocsr()
    on_rim = np.asarray(rim.sum(axis=1)).ravel() > 0
    pairs.data[:] = 1.0
    chosen = (
        sparse.diags((~on_rim).astype(float)) @ pairs + sparse.diags(on_rim.astype(float)) @ rim
    )
    total = np.asarray(chosen.sum(axis=1)).ravel()
    return (sparse.diags(1.0 / np.maximum(total, 1.0)) @ chosen).tocsr()


def evened(
    vertices: np.ndarray,
    faces: np.ndarray,
    mean: sparse.csr_matrix,
    origin: np.ndarray,
    times: int,
    where: np.ndarray | float = 1.0,
) -> np.ndarray:
    """`vertices` smoothed, and hardly shifted within the surface: what is printed there stays.

    Along the normal each takes its neighbours' mean; within the surface, only the mean of how far
    they have come from `origin`, as uneven triangles would make them creep otherwise.

    Args:
        mean: from `averaging`.
        origin: (N, 3) where the print is undistorted.
        where: (N,) in [0, 1], how much each vertex takes part.
    """
    share = 0.5 * np.broadcast_to(where, len(vertices))[:, None]
    for _ in range(times):
        step = mean @ vertices - vertices
        moved = vertices - origin
        drag = mean @ moved - moved
        outward = normals(vertices, faces)
        lift = ((step - drag) * outward).sum(axis=1, keepdims=True) * outward
        vertices = vertices + share * (drag + lift)
    return vertices


def pushed_out(
    vertices: np.ndarray, place: np.ndarray, gap: np.ndarray, solid: Solid
) -> np.ndarray:
    """`vertices` moved so that each keeps at least `gap` (N,) metres from a solid.

    Args:
        place: (N, 3) template coordinates; a sleeve looks for the arm, not for the hip that the
            arm hangs beside, because both places count in the search.
    """
    tree = cKDTree(np.concatenate([solid.vertices, 0.6 * solid.place], axis=1))
    _, near = tree.query(np.concatenate([vertices, 0.6 * place], axis=1), k=3)
    height = ((vertices[:, None] - solid.vertices[near]) * solid.normals[near]).sum(axis=2)
    # The closest three share one tangent plane or disagree at a crease: the mean serves both.
    direction = solid.normals[near].mean(axis=1)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    lack = np.maximum(gap - height.min(axis=1), 0.0)
    return vertices + direction * lack[:, None]


@dataclass(frozen=True, eq=False)
class Pattern:
    """A cut piece of a refined base-mesh group, before it has a shape.

    Attributes:
        matrix: (N, 19158) sparse; vertices = matrix @ base mesh.
        faces: (F, 3) int.
        uv: (F, 3, 2) atlas coordinates.
    """

    matrix: sparse.csr_matrix
    faces: np.ndarray
    uv: np.ndarray


NEAR_HEM = 0.3
"""Share of an edge within which a vertex is moved onto the hem: slivers make cloth crumple."""


def cut(matrix: sparse.csr_matrix, faces: np.ndarray, uv: np.ndarray, field: np.ndarray) -> Pattern:
    """Keep where `field` (N,) is below zero, cutting triangles along its zero line.

    The hem is the zero line itself, so it is as smooth as the field, whatever the mesh.
    """
    matrix, uv, field = _onto_hem(matrix, faces, uv, field)
    inside = field <= 0
    count = inside[faces].sum(axis=1)
    whole = (count == 3) & (field[faces] < 0).any(axis=1)
    new_faces, new_uv = [faces[whole]], [uv[whole]]
    rows: list[np.ndarray] = []
    for kept in (1, 2):
        some = np.flatnonzero(count == kept)
        f, t = faces[some], uv[some]
        # Turn each triangle so that the odd vertex comes first.
        odd = (inside[f] if kept == 1 else ~inside[f]).argmax(axis=1)
        turn = (odd[:, None] + np.arange(3)) % 3
        f = np.take_along_axis(f, turn, axis=1)
        t = np.take_along_axis(t, turn[:, :, None], axis=1)
        a, b, c = f.T
        ab = field[a] / (field[a] - field[b])
        ac = field[a] / (field[a] - field[c])
        t_ab = t[:, 0] + ab[:, None] * (t[:, 1] - t[:, 0])
        t_ac = t[:, 0] + ac[:, None] * (t[:, 2] - t[:, 0])
        first = len(field) + sum(map(len, rows))
        p = first + np.arange(len(f))
        q = p + len(f)
        rows += [np.stack([a, b], axis=1), np.stack([a, c], axis=1)]
        if kept == 1:
            new_faces.append(np.stack([a, p, q], axis=1))
            new_uv.append(np.stack([t[:, 0], t_ab, t_ac], axis=1))
        else:
            new_faces += [np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)]
            new_uv += [
                np.stack([t_ab, t[:, 1], t[:, 2]], axis=1),
                np.stack([t_ab, t[:, 2], t_ac], axis=1),
            ]
    all_faces, all_uv = np.concatenate(new_faces), np.concatenate(new_uv)
    # Both triangles of an edge made the same vertex: keep one.
    edge, merged = np.unique(np.sort(np.concatenate(rows), axis=1), axis=0, return_inverse=True)
    i, j = edge.T
    share = field[i] / (field[i] - field[j])
    n, k = len(field), np.arange(len(edge))
    # Where an end lies on the hem, the edge is cut at that end.
    at = np.where(field[i] == 0, i, np.where(field[j] == 0, j, n + k))
    all_faces = np.concatenate([np.arange(n), at[merged.ravel()]])[all_faces]
    a, b, c = all_faces.T
    flat = (a == b) | (b == c) | (c == a)
    all_faces, all_uv = all_faces[~flat], all_uv[~flat]
    lerp = sparse.csr_matrix(
        (np.concatenate([1 - share, share]), (np.concatenate([k, k]), np.concatenate([i, j]))),
        shape=(len(edge), n),
    )
    full = sparse.vstack([matrix, lerp @ matrix]).tocsr()
    used, compacted = np.unique(all_faces, return_inverse=True)
    return Pattern(full[used], compacted.reshape(-1, 3), all_uv)


def _onto_hem(
    matrix: sparse.csr_matrix, faces: np.ndarray, uv: np.ndarray, field: np.ndarray
) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """The mesh with vertices near the zero line moved onto it, and the field, 0 at those."""
    n = len(field)
    corners = np.arange(3)
    start = faces[:, [0, 1, 2, 1, 2, 0]].ravel()
    end = faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    crosses = np.flatnonzero(field[start] * field[end] < 0)
    v, w = start[crosses], end[crosses]
    share = field[v] / (field[v] - field[w])
    # Of each vertex' edges, the one that is cut nearest to it; equals by the other end's number.
    order = np.lexsort((w, share, v))
    v, w, share = v[order], w[order], share[order]
    first = np.concatenate([[True], v[1:] != v[:-1]]) & (share < NEAR_HEM)
    v, w, share = v[first], w[first], share[first]

    moved_by = np.zeros(n)
    toward = np.full(n, -1)
    moved_by[v], toward[v] = share, w
    keep = sparse.diags(1 - moved_by)
    step = sparse.csr_matrix((share, (v, w)), shape=(n, n))
    # A corner's chart moves along the same edge, where its triangle has that edge or shares the
    # chart there with one that has.
    shift = np.zeros_like(uv)
    knows = np.zeros(faces.shape, dtype=bool)
    for a in corners:
        for b in corners[corners != a]:
            has = toward[faces[:, a]] == faces[:, b]
            shift[has, a] = moved_by[faces[has, a], None] * (uv[has, b] - uv[has, a])
            knows[has, a] = True
    code = np.concatenate([faces[..., None], np.round(uv * 1e7)], axis=2).reshape(-1, 3)
    _, code = np.unique(code, axis=0, return_inverse=True)
    code = code.ravel()
    of_code = np.zeros((code.max() + 1, 2))
    of_code[code[knows.ravel()]] = shift[knows]
    shift = np.where(knows[..., None], shift, of_code[code].reshape(uv.shape))
    field = np.where(moved_by > 0, 0.0, field)
    return ((keep + step) @ matrix).tocsr(), uv + shift, field


def hemmed(piece: Piece, thickness: float, rings: int, reach: float) -> Piece:
    """The piece with its borders turned in, so that an opening shows cloth and not the void.

    Args:
        thickness: metres between the outer layer and the inner one.
        rings: how many triangles deep the inner layer goes, 1 or more.
        reach: metres that it goes on from there towards the limb.
    """
    n = len(piece.vertices)
    outward = normals(piece.vertices, piece.faces)
    mean = averaging(piece.faces, n)
    for _ in range(4):  # a crumpled hem is turned in as a whole
        outward = 0.5 * outward + 0.5 * (mean @ outward)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    near = np.zeros(n, dtype=bool)
    near[border(piece.faces).ravel()] = True
    for _ in range(rings):
        strip = near[piece.faces].any(axis=1)
        near[piece.faces[strip]] = True
    inner, turned = np.unique(piece.faces[strip][:, ::-1], return_inverse=True)
    below = np.full(n, -1)
    below[inner] = n + np.arange(len(inner))
    inside = piece.vertices[inner] - thickness * outward[inner]
    lip, lip_uv = _band(*_border(piece.faces, piece.uv), below)
    vertices = np.concatenate([piece.vertices, inside])
    faces = np.concatenate([piece.faces, n + turned.reshape(-1, 3), lip])
    uv = np.concatenate([piece.uv, piece.uv[strip][:, ::-1], lip_uv])

    rim, rim_uv = _border(faces, uv)
    end = np.unique(rim)
    assert (end >= n).all(), "a hem was not turned in: a border vertex has no inner one"
    beyond = np.full(len(vertices), -1)
    beyond[end] = len(vertices) + np.arange(len(end))
    flange, flange_uv = _band(rim, rim_uv, beyond)
    source = inner[end - n]
    deep = vertices[end] - reach * outward[source]
    return Piece(
        np.concatenate([vertices, deep]),
        np.concatenate([faces, flange]),
        np.concatenate([uv, flange_uv]),
    )


def border(faces: np.ndarray) -> np.ndarray:
    """Directed edges (E, 2) of one face only."""
    edges = sides(faces)
    return edges[_single(edges)]


def _border(faces: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `border`, and the edges' chart coordinates (E, 2, 2)."""
    edges = sides(faces)
    single = _single(edges)
    return edges[single], sides(uv)[single]


def sides(corners: np.ndarray) -> np.ndarray:
    """(3F, 2, ...) both ends of each triangle's sides, from its corners (F, 3, ...)."""
    return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])


def _single(edges: np.ndarray) -> np.ndarray:
    """(E,) bool: directed edges that no other runs against."""
    size = int(edges.max()) + 1
    code = edges[:, 0].astype(np.int64) * size + edges[:, 1]
    return ~np.isin(edges[:, 1].astype(np.int64) * size + edges[:, 0], code)


def _band(edges: np.ndarray, uv: np.ndarray, partner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles from border `edges` to the `partner` of each of their vertices."""
    (a, b), (ua, ub) = edges.T, uv.transpose(1, 0, 2)
    first = np.stack([b, a, partner[a]], axis=1)
    second = np.stack([b, partner[a], partner[b]], axis=1)
    first_uv, second_uv = np.stack([ub, ua, ua], axis=1), np.stack([ub, ua, ub], axis=1)
    return np.concatenate([first, second]), np.concatenate([first_uv, second_uv])


def sewn(upper: Pattern, lower: Pattern, rims: tuple[np.ndarray, np.ndarray]) -> Pattern:
    """Two patterns as one, joined by a strip of triangles between two closed rims.

    Args:
        rims: vertex indices of the upper's rim and of the lower's, each once around, counter-
            clockwise seen from above, from the same side.
    """
    (up, low), n = rims, upper.matrix.shape[0]
    # Each rim at its share of the way around; the strip steps along whichever lags behind.
    k = np.argsort(
        np.concatenate(
            [np.arange(1, len(up) + 1) / len(up), np.arange(1, len(low) + 1) / len(low)]
        ),
        kind="stable",
    )
    on_upper = k < len(up)
    i = np.concatenate([[0], np.cumsum(on_upper)[:-1]])
    j = np.concatenate([[0], np.cumsum(~on_upper)[:-1]])
    a, b = up[i % len(up)], n + low[j % len(low)]
    c = np.where(on_upper, up[(i + 1) % len(up)], n + low[(j + 1) % len(low)])
    strip = np.stack([a, b, c], axis=1)
    # The strip is a seam, of one colour from top to bottom.
    corner = np.empty((n, 2))
    corner[upper.faces.ravel()] = upper.uv.reshape(-1, 2)
    return Pattern(
        sparse.vstack([upper.matrix, lower.matrix]).tocsr(),
        np.concatenate([upper.faces, n + lower.faces, strip]),
        np.concatenate([upper.uv, lower.uv, np.repeat(corner[a][:, None], 3, axis=1)]),
    )


def on_border(faces: np.ndarray) -> np.ndarray:
    """(N,) bool: vertices on the border."""
    result = np.zeros(int(faces.max()) + 1, dtype=bool)
    result[border(faces).ravel()] = True
    return result


def rim(faces: np.ndarray, start: int) -> np.ndarray:
    """The closed border that vertex `start` lies on: indices in the order of its directed edges."""
    following = dict(border(faces).tolist())
    loop = [start]
    while (after := following[loop[-1]]) != start:
        loop.append(after)
    return np.array(loop)
