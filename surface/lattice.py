"""How a layered depth map hangs together: cells of 2 x 2 pixels, closed by rims.

A pixel is a line of sight. It passes one part of the solid after the other, none outside of the
silhouette, one as a rule, more where a near part hides a gap behind itself. Where it enters a part
and where it leaves it is a node; nodes 0, 2, 4 look towards the viewer, 1, 3, 5 away.

Between two neighbouring pixels every node is tied to one other: to a node of the neighbour, where
the sheet goes on, or to the next node of its own pixel, where it ends. There a rim, a column of
vertices, runs from one to the other and bulges towards the neighbour. Rims between 0 and 1 close a
part, those between 1 and 2 the gap behind it.

So in a cell each node has two ties, the ties of a cell form closed loops, and every tie belongs to
just two cells. Filling each loop with a disk gives a surface that is closed, manifold and oriented,
whatever the parts are and however they are tied.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

PARTS = 3
"""That a line of sight passes, at most."""

RIMS = ((0, 1), (2, 3), (4, 5), (2, 1), (4, 3))
"""Pairs of nodes that a rim may tie, the one that faces the viewer first."""

CORNERS = ((1, 0), (1, 1), (0, 1), (0, 0))
"""Row and column of a cell's corners, counter-clockwise for the viewer."""


class Matching(NamedTuple):
    """A way to tie the nodes of two neighbouring pixels p and q; no two ties cross.

    Attributes:
        across: (node of p, node of q) of every tie between them.
        rims: for p and for q the first node of every two that a rim ties.
    """

    across: tuple[tuple[int, int], ...]
    rims: tuple[tuple[int, ...], tuple[int, ...]]

    def turned(self) -> Matching:
        """The same from q to p."""
        return Matching(tuple((j, i) for i, j in self.across), self.rims[::-1])


@cache
def matchings(parts: int, others: int) -> tuple[Matching, ...]:
    """All ways to tie a pixel of so many parts to one of so many others."""
    found: dict[Matching, None] = {}

    def extend(i: int, j: int, across: tuple, rims: tuple, others_rims: tuple) -> None:
        if i == 2 * parts and j == 2 * others:
            found[Matching(across, (rims, others_rims))] = None
        if i < 2 * parts and j < 2 * others:
            extend(i + 1, j + 1, (*across, (i, j)), rims, others_rims)
        if i + 2 <= 2 * parts:
            extend(i + 2, j, across, (*rims, i), others_rims)
        if j + 2 <= 2 * others:
            extend(i, j + 2, across, rims, (*others_rims, j))

    extend(0, 0, (), (), ())
    return tuple(found)


class Node(NamedTuple):
    """A node of a cell: the corner's number, and which of the corner's nodes."""

    corner: int
    kind: int


class Rim(NamedTuple):
    """A rim of a cell: its pixel's corner, the corner it bulges towards, which of `RIMS`.

    Attributes:
        falling: whether a loop runs along it from the node that faces the viewer to the other.
    """

    corner: int
    towards: int
    pair: int
    falling: bool


@dataclass(frozen=True)
class Loop:
    """Ties of a cell that close: chains of nodes, each followed by a rim, or one ring of nodes.

    Attributes:
        chains: nodes in order; the first chain of those with rims faces the viewer, the next looks
            away, and so on.
        rims: the rim after each chain; none for a ring.
    """

    chains: tuple[tuple[Node, ...], ...]
    rims: tuple[Rim, ...]


@cache
def loops(parts: tuple[int, ...], ties: tuple[int, ...]) -> tuple[Loop, ...]:
    """The loops of a cell, counter-clockwise seen from outside the solid.

    Args:
        parts: how many each of its four `CORNERS` has.
        ties: from each corner to the next, which of their `matchings`.
    """
    tied = [_ends(matchings(parts[c], parts[(c + 1) % 4])[ties[c]]) for c in range(4)]
    left = {Node(c, kind) for c in range(4) for kind in range(2 * parts[c])}
    found = []
    while left:
        node = min(left)
        pieces: list[Node | Rim] = []
        while node in left:
            left.remove(node)
            pieces.append(node)
            rim, node = _next(node, tied)
            if rim is not None:
                pieces.append(rim)
        found.append(_loop(pieces))
    return tuple(found)


_End = tuple[int, int]
"""Of a tie on the edge from one corner to the next: 0 or 1 for the corner, and the node."""


def _ends(matching: Matching) -> dict[_End, _End]:
    """Each end of each tie to its other end."""
    ends: dict[_End, _End] = {}
    for i, j in matching.across:
        ends[0, i], ends[1, j] = (1, j), (0, i)
    for side, rims in enumerate(matching.rims):
        for i in rims:
            ends[side, i], ends[side, i + 1] = (side, i + 1), (side, i)
    return ends


def _next(node: Node, tied: list[dict[_End, _End]]) -> tuple[Rim | None, Node]:
    """What follows a node: on the edge ahead of it if it faces the viewer, else on that behind."""
    corner, kind = node
    facing = kind % 2 == 0
    towards = (corner + (1 if facing else -1)) % 4
    edge, own = (corner, 0) if facing else (towards, 1)
    side, other = tied[edge][own, kind]
    if side != own:
        return None, Node(towards, other)
    pair = RIMS.index((kind, other) if facing else (other, kind))
    return Rim(corner, towards, pair, facing), Node(corner, other)


def _loop(pieces: list[Node | Rim]) -> Loop:
    """Pieces in order, turned so that a chain that faces the viewer comes first."""
    rising = [i for i, piece in enumerate(pieces) if isinstance(piece, Rim) and not piece.falling]
    if rising:
        pieces = pieces[rising[0] + 1 :] + pieces[: rising[0] + 1]
    chains: list[tuple[Node, ...]] = []
    rims: list[Rim] = []
    chain: list[Node] = []
    for piece in pieces:
        if isinstance(piece, Node):
            chain.append(piece)
        else:
            chains.append(tuple(chain))
            rims.append(piece)
            chain = []
    return Loop(tuple(chains), tuple(rims)) if rims else Loop((tuple(chain),), ())
