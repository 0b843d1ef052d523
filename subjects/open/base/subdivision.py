"""Catmull-Clark subdivision of quads as one sparse matrix, reused for every shape and pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse


@dataclass(frozen=True, eq=False)
class Refinement:
    """A finer mesh of a quad mesh.

    Attributes:
        matrix: (M, N) sparse; fine vertices = matrix @ coarse vertices.
        quads: (F', 4) int32 fine faces.
        corners: (F', 4, D) float64, values of the fine corners (bilinear), such as charts.
    """

    matrix: sparse.csr_matrix
    quads: np.ndarray
    corners: np.ndarray


def refine(quads: np.ndarray, corners: np.ndarray, count: int, levels: int) -> Refinement:
    """Subdivide `levels` times.

    Args:
        quads: (F, 4) int into `count` vertices; vertices of no face stay out of the result.
        corners: (F, 4, D) values per face corner, interpolated bilinearly.
        count: number of coarse vertices.
        levels: how often; 0 only drops the vertices of no face.

    Source: Catmull and Clark 1978; boundaries as cubic B-splines (Hoppe et al. 1994).
    """
    used = np.unique(quads)
    renumber = np.full(count, -1)
    renumber[used] = np.arange(len(used))
    matrix = sparse.csr_matrix(
        (np.ones(len(used)), (np.arange(len(used)), used)), shape=(len(used), count)
    )
    quads = renumber[quads]
    for _ in range(levels):
        step, quads, corners = _once(quads, corners)
        matrix = (step @ matrix).tocsr()
    return Refinement(matrix, quads.astype(np.int32), corners)


def _once(
    quads: np.ndarray, corners: np.ndarray
) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    n, f = int(quads.max()) + 1, len(quads)
    following = np.roll(quads, -1, axis=1)
    half = np.sort(np.stack([quads.ravel(), following.ravel()], axis=1), axis=1)
    edges, edge_of = np.unique(half, axis=0, return_inverse=True)
    edge_of = edge_of.reshape(f, 4)
    e = len(edges)
    uses = np.bincount(edge_of.ravel(), minlength=e)

    face_row = np.repeat(np.arange(f), 4)
    face = sparse.csr_matrix((np.full(4 * f, 0.25), (face_row, quads.ravel())), shape=(f, n))
    middle = sparse.csr_matrix(
        (np.full(2 * e, 0.5), (np.repeat(np.arange(e), 2), edges.ravel())), shape=(e, n)
    )
    edge_face = sparse.csr_matrix((np.ones(4 * f), (edge_of.ravel(), face_row)), shape=(e, f))
    inner = sparse.diags((uses == 2).astype(float))
    border = sparse.diags((uses != 2).astype(float))
    edge = inner @ (0.5 * middle + 0.25 * edge_face @ face) + border @ middle

    valence = np.bincount(quads.ravel(), minlength=n).astype(float)
    vertex_face = sparse.csr_matrix((np.ones(4 * f), (quads.ravel(), face_row)), shape=(n, f))
    vertex_edge = sparse.csr_matrix(
        (np.ones(2 * e), (edges.ravel(), np.repeat(np.arange(e), 2))), shape=(n, e)
    )
    over = sparse.diags(1.0 / valence)
    identity = sparse.identity(n)
    smooth = (
        over @ over @ (vertex_face @ face + 2.0 * vertex_edge @ middle)
        + sparse.diags((valence - 3.0) / valence) @ identity
    )
    on_border = np.zeros(n, dtype=bool)
    on_border[edges[uses != 2].ravel()] = True
    rim = 0.5 * identity + 0.25 * vertex_edge @ border @ middle
    keep, change = sparse.diags((~on_border).astype(float)), sparse.diags(on_border.astype(float))
    step = sparse.vstack([keep @ smooth + change @ rim, edge, face]).tocsr()

    before = np.roll(edge_of, 1, axis=1)
    centre = np.broadcast_to((n + e + np.arange(f))[:, None], (f, 4))
    fine = np.stack([quads, n + edge_of, centre, n + before], axis=2).reshape(4 * f, 4)
    next_corner = 0.5 * (corners + np.roll(corners, -1, axis=1))
    centre_corner = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    values = np.stack(
        [corners, next_corner, centre_corner, np.roll(next_corner, 1, axis=1)], axis=2
    )
    return step, fine, values.reshape(4 * f, 4, corners.shape[2])


def triangles(quads: np.ndarray) -> np.ndarray:
    """Each (F, 4, ...) quad as two triangles, (2F, 3, ...); neighbours stay neighbours."""
    return np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(
        -1, 3, *quads.shape[2:]
    )


def loop(faces: np.ndarray, uv: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Each triangle as four: the matrix (M, N) of the vertices, (4F, 3) faces, (4F, 3, 2) charts.

    Args:
        faces: (F, 3) int that use each of the N vertices.
        uv: (F, 3, 2), halved linearly.

    Source: Loop 1987 with Warren's weights; boundaries as cubic B-splines.
    """
    n = int(faces.max()) + 1
    following = np.roll(faces, -1, axis=1)
    half = np.sort(np.stack([faces.ravel(), following.ravel()], axis=1), axis=1)
    edges, edge_of = np.unique(half, axis=0, return_inverse=True)
    edge_of = edge_of.reshape(-1, 3)
    e = len(edges)
    rim = np.bincount(edge_of.ravel(), minlength=e) == 1
    rows = np.repeat(np.arange(e), 2)
    ends = sparse.csr_matrix((np.ones(2 * e), (rows, edges.ravel())), shape=(e, n))
    # The vertex across from each side of a triangle.
    across = np.roll(faces, 1, axis=1)
    wings = sparse.csr_matrix(
        (np.ones(edge_of.size), (edge_of.ravel(), across.ravel())), shape=(e, n)
    )
    inner = sparse.diags((~rim).astype(float))
    middle = inner @ (0.375 * ends + 0.125 * wings) + 0.5 * sparse.diags(rim.astype(float)) @ ends

    links = (ends.T @ ends).tocsr()
    links.setdiag(0.0)
    links.eliminate_zeros()
    valence = np.asarray((links > 0).sum(axis=1)).ravel()
    share = np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))
    smooth = sparse.diags(1 - share * valence) + sparse.diags(share) @ links
    on_rim = np.zeros(n, dtype=bool)
    on_rim[edges[rim].ravel()] = True
    rim_ends = sparse.diags(rim.astype(float)) @ ends
    rim_links = (rim_ends.T @ rim_ends).tocsr()
    rim_links.setdiag(0.0)
    border = 0.75 * sparse.identity(n) + 0.125 * rim_links
    keep, change = sparse.diags((~on_rim).astype(float)), sparse.diags(on_rim.astype(float))
    matrix = sparse.vstack([keep @ smooth + change @ border, middle]).tocsr()

    a, b, c = faces.T
    ab, bc, ca = (n + edge_of).T
    fine = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    ua, ub, uc = uv.transpose(1, 0, 2)
    uab, ubc, uca = (ua + ub) / 2, (ub + uc) / 2, (uc + ua) / 2
    fine_uv = np.stack([[ua, uab, uca], [uab, ub, ubc], [uca, ubc, uc], [uab, ubc, uca]])
    return (
        matrix,
        fine.transpose(2, 0, 1).reshape(-1, 3),
        fine_uv.transpose(2, 0, 1, 3).reshape(-1, 3, 2),
    )
