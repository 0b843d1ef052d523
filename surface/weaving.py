"""A layered depth map woven into one closed mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from surface.lattice import CORNERS, PARTS, RIMS, Loop, Matching, Rim, loops, matchings
from surface.mesh import TriangleMesh

SEGMENTS = 6
"""Of a rim, from the node that faces the viewer to the other."""

BULGE = 0.5
"""Pixels that a rim reaches towards the neighbour: as far as the outline, on average."""

GAP_WEIGHT = 0.5
"""Of the length of a rim that closes a gap: gaps are guesses, and end before a part does."""

_TURNS = ((0, 1), (-1, 0), (0, -1), (1, 0))
"""Rows and columns to the neighbour that a rim may bulge towards."""

_EVEN = 1e-9
"""Metres by which diagonals have to differ for one to be the better."""

Chain = Sequence[np.ndarray]
"""(N,) codes of vertices, one array for each place along a line, the same line in N cells."""


@dataclass(frozen=True, eq=False)
class Layers:
    """The solid's parts on every line of sight; no pixel at the border has any.

    Attributes:
        depth: (6, H, W) metres of `surface.lattice`'s nodes; of meaning up to twice the parts.
        colors: (6, H, W, 3) float from 0 to 255, or None.
        parts: (H, W) int, how many.
    """

    depth: np.ndarray
    colors: np.ndarray | None
    parts: np.ndarray


def woven(
    layers: Layers, origin: tuple[float, float], pixel_size: float, cutting: float
) -> TriangleMesh:
    """The surface through all nodes.

    Neighbours are tied so that the walls between them are the shortest: a tie has the length of the
    step in depth that it makes, a rim that of the part or gap that it closes.

    Args:
        origin: x and y of the centre of the pixel in row 0, column 0, metres.
        pixel_size: metres.
        cutting: metres that a rim counts besides its length; infinite where neighbours of the
            silhouette are never to be parted.
    """
    loom = _Loom(layers)
    for corners, found in _cells(layers, cutting):
        for loop in found:
            loom.fill(corners, loop)
    codes, faces = np.unique(np.concatenate(loom.faces), return_inverse=True)
    vertices, colors = loom.vertices(codes, origin, pixel_size)
    return TriangleMesh(vertices, faces.reshape(-1, 3).astype(np.int64), colors)


def _cells(layers: Layers, cutting: float) -> Iterator[tuple[np.ndarray, tuple[Loop, ...]]]:
    """Cells of one kind together: (4, N) numbers of their corners' pixels, and the kind's loops."""
    height, width = layers.parts.shape
    at = [(slice(i, height - 1 + i), slice(j, width - 1 + j)) for i, j in CORNERS]
    numbers = np.arange(height * width).reshape(height, width)
    corners = np.stack([numbers[where].ravel() for where in at])
    parts = layers.parts.reshape(-1)
    corners = corners[:, parts[corners].any(axis=0)]
    depth = layers.depth.reshape(len(layers.depth), -1)
    marks = [parts[corner] for corner in corners]
    marks += [_tied(depth, parts, corners[c], corners[(c + 1) % 4], cutting) for c in range(4)]
    cells, which = np.unique(np.stack(marks), axis=1, return_inverse=True)
    which = which.reshape(-1)
    order = np.argsort(which, kind="stable")
    ends = np.cumsum(np.bincount(which))
    for mark, members in zip(cells.T.tolist(), np.split(order, ends[:-1]), strict=True):
        yield corners[:, members], loops(tuple(mark[:4]), tuple(mark[4:]))


def _tied(
    depth: np.ndarray, parts: np.ndarray, p: np.ndarray, q: np.ndarray, cutting: float
) -> np.ndarray:
    """(N,) which of their matchings ties each two pixels best.

    Both cells of an edge ask for it, in opposite directions: the answers have to agree even where
    two matchings are as good, so the pixel that comes first is always p of the question.
    """
    turned = p > q
    first, second = np.where(turned, q, p), np.where(turned, p, q)
    chosen = np.zeros(len(p), dtype=np.int64)
    for i, j in product(range(1, PARTS + 1), repeat=2):
        here = np.flatnonzero((parts[first] == i) & (parts[second] == j))
        if len(here):
            ways = matchings(i, j)
            ends = depth[:, first[here]], depth[:, second[here]]
            best = np.argmin([_length(way, *ends, cutting) for way in ways], axis=0)
            back = np.array([matchings(j, i).index(way.turned()) for way in ways])
            chosen[here] = np.where(turned[here], back[best], best)
    return chosen


def _length(matching: Matching, ours: np.ndarray, theirs: np.ndarray, cutting: float) -> np.ndarray:
    """(N,) metres of the walls that a matching makes."""
    total = np.zeros(ours.shape[1])
    for i, j in matching.across:
        total += np.abs(ours[i] - theirs[j])
    for depth, rims in zip((ours, theirs), matching.rims, strict=True):
        for i in rims:
            weight = GAP_WEIGHT if i % 2 else 1.0
            total += weight * np.abs(depth[i + 1] - depth[i]) + cutting
    return total


class _Loom:
    """Makes faces whose corners are codes: a number for every vertex that there may be.

    Cells that share a vertex so name it alike without knowing of each other. Nodes come first: node
    k of pixel n is k H W + n. Then the inner vertices of rims, by the pair of nodes, by the turn to
    the side on which the rim bulges, by pixel; then the centres of loops.

    Attributes:
        faces: arrays of (N, 3) codes.
    """

    def __init__(self, layers: Layers) -> None:
        self._layers = layers
        self._pixels = layers.parts.size
        self._depth = layers.depth.reshape(-1)
        self._rims = len(self._depth)
        self._centers = self._rims + len(RIMS) * len(_TURNS) * self._pixels * (SEGMENTS - 1)
        self._means: list[np.ndarray] = []  # for each centre the codes that it is the mean of
        self._next = self._centers
        self.faces: list[np.ndarray] = []

    def fill(self, corners: np.ndarray, loop: Loop) -> None:
        """Span a loop with triangles, in all cells that have it.

        Two rims bound a strip, closed at its ends by the chains between them. No triangle's side
        may join two vertices that the cell beyond might join too: where both rims stand between the
        same two pixels, or a chain goes all round the cell, a third column runs down the middle.

        Args:
            corners: (4, N) numbers of the cells' pixels.
        """
        chains = [
            [node.kind * self._pixels + corners[node.corner] for node in chain]
            for chain in loop.chains
        ]
        if not loop.rims:
            self._ring(chains[0])
            return
        columns = [self._rim(corners, rim) for rim in loop.rims]
        if len(loop.rims) > 2:
            self._fan(
                [v for pair in zip(chains, columns, strict=True) for one in pair for v in one]
            )
            return
        ahead, behind = chains
        right = [ahead[-1], *columns[0], behind[0]]
        left = [ahead[0], *columns[1][::-1], behind[-1]]
        between = [{rim.corner, rim.towards} for rim in loop.rims]
        if max(len(ahead), len(behind)) <= 3 and between[0] != between[1]:
            self._strip(left, right)
            self._around(ahead[0], ahead[1:])
            self._around(behind[0], behind[1:])
            return
        ends = [chain[0] if len(chain) == 1 else self._mean(chain) for chain in (ahead, behind)]
        inner = [self._mean(pair) for pair in zip(left[1:-1], right[1:-1], strict=True)]
        middle = [ends[0], *inner, ends[1]]
        self._strip(left, middle)
        self._strip(middle, right)
        self._around(ends[0], ahead)
        self._around(ends[1], behind)

    def vertices(
        self, codes: np.ndarray, origin: tuple[float, float], pixel_size: float
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """(N, 3) positions and (N, 3) colours of sorted codes."""
        depth, colors = self._layers.depth, self._layers.colors
        values = depth.reshape(-1, 1)
        if colors is not None:
            values = np.concatenate([values, colors.reshape(-1, 3)], axis=1)
        first, second = np.searchsorted(codes, [self._rims, self._centers])
        width = self._layers.parts.shape[1]

        def place(pixel: np.ndarray) -> np.ndarray:
            row, column = np.divmod(pixel, width)
            x, y = origin[0] + column * pixel_size, origin[1] - row * pixel_size
            return np.stack([x, y], axis=1)

        nodes = np.concatenate([place(codes[:first] % self._pixels), values[codes[:first]]], axis=1)

        rest, step = np.divmod(codes[first:second] - self._rims, SEGMENTS - 1)
        rest, pixel = np.divmod(rest, self._pixels)
        pair, turn = np.divmod(rest, len(_TURNS))
        ends = [values[np.array(RIMS)[pair, end] * self._pixels + pixel] for end in (0, 1)]
        angle = np.pi * (step + 1) / SEGMENTS
        share = ((1 - np.cos(angle)) / 2)[:, None]
        towards = np.array([(column, -row) for row, column in _TURNS], dtype=np.float64)[turn]
        out = place(pixel) + (BULGE * pixel_size * np.sin(angle))[:, None] * towards
        rims = np.concatenate([out, ends[0] + share * (ends[1] - ends[0])], axis=1)

        made = np.concatenate([nodes, rims])
        # A centre is a mean of nodes and of rims, never of centres.
        means = np.concatenate(
            [made[np.searchsorted(codes, of)].mean(axis=1) for of in self._means]
            or [np.empty((0, made.shape[1]))]
        )
        made = np.concatenate([made, means[codes[second:] - self._centers]])
        made[:, 2] *= -1
        shades = None if colors is None else np.rint(made[:, 3:]).clip(0, 255).astype(np.uint8)
        return made[:, :3], shades

    def _rim(self, corners: np.ndarray, rim: Rim) -> Chain:
        """The inner vertices of a rim, in the order in which the loop runs along it."""
        (row, column), (other_row, other_column) = CORNERS[rim.corner], CORNERS[rim.towards]
        turn = _TURNS.index((other_row - row, other_column - column))
        first = (rim.pair * len(_TURNS) + turn) * self._pixels + corners[rim.corner]
        first = self._rims + first * (SEGMENTS - 1)
        inner = [first + step for step in range(SEGMENTS - 1)]
        return inner if rim.falling else inner[::-1]

    def _ring(self, ring: Chain) -> None:
        """A piece of one sheet; of a square's two diagonals the one that bends the least."""
        if len(ring) != 4:
            self._fan(ring)
            return
        bend = [abs(self._depth[ring[k]] - self._depth[ring[k + 2]]) for k in (0, 1)]
        square = np.stack(ring, axis=1)
        first = bend[0] <= bend[1] + _EVEN
        for turn, chosen in ((0, first), (1, ~first)):
            turned = np.roll(square[chosen], -turn, axis=1)
            self.faces += [turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]]

    def _fan(self, around: Chain) -> None:
        self._around(self._mean(around), [*around, around[0]])

    def _around(self, center: np.ndarray, chain: Chain) -> None:
        for one, other in pairwise(chain):
            self.faces.append(np.stack([center, one, other], axis=1))

    def _strip(self, left: Chain, right: Chain) -> None:
        """Between two columns, which may begin and end in the same vertices.

        Diagonals fall to the middle from both ends, so that the strip mirrored is a strip.
        """
        for t in range(len(left) - 1):
            corners = [left[t], right[t], right[t + 1], left[t + 1]]
            first = 0 if 2 * t < len(left) - 1 else 1
            for triangle in ((0, 1, 2), (0, 2, 3)):
                made = [corners[(first + k) % 4] for k in triangle]
                if not any(np.array_equal(made[k], made[k - 1]) for k in range(3)):
                    self.faces.append(np.stack(made, axis=1))

    def _mean(self, of: Chain) -> np.ndarray:
        """Codes of new vertices in the middle of others."""
        self._means.append(np.stack(of, axis=1))
        made = self._next + np.arange(len(of[0]))
        self._next += len(made)
        return made
