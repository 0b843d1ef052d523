"""What a near part of a surface hides: where a depth map steps, and the gap behind the step.

A depth map of the front shows an arm before the trunk as a step. Nothing is seen of the arm's
underside, nor of the trunk behind it; joined as they stand, arm and trunk are webbed together, the
failure that section 4.7 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D
Images" shows. Here both are guessed: a part is as thick behind its outline's depth as it is before
it, and what lies behind it goes on smoothly from where it is seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label
from scipy.sparse import coo_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

REACH = 0.12
"""Metres from a step as far as a gap is looked for behind the near part; a forearm is thinner."""

LEAST_GAP = 0.01
"""Metres between a near part and what is behind it; less is no gap."""

DEEPEST = 0.025
"""Metres, half a pixel of 5 mm from the outline of a limb of 25 cm across, before its middle."""

THINNEST = 1e-4
"""Metres of a part from front to back, at least."""

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""Row and column of a pixel's neighbours."""

_ANCHORED = 10.0
"""Weight of a depth that is known beside that of being smooth."""


@dataclass(frozen=True, eq=False)
class Hidden:
    """What lies behind the near parts of a front.

    Attributes:
        there: (H, W) bool, where there is a gap behind what is seen.
        under: (H, W) metres, the near part's back; of meaning where `there`.
        ground: (H, W) metres, the front of what is behind the gap; likewise.
        colors: (H, W, C) of that.
    """

    there: np.ndarray
    under: np.ndarray
    ground: np.ndarray
    colors: np.ndarray


def behind(
    front: np.ndarray,
    back: np.ndarray,
    mask: np.ndarray,
    step: float,
    colors: np.ndarray,
    pixel_size: float,
) -> Hidden:
    """The gaps behind a front's near parts.

    Args:
        front, back: (H, W) metres from the viewer's plane; where the viewer stands behind, both
            negative and in each other's place.
        mask: (H, W) bool.
        step: metres between neighbouring pixels from which on one is a near part's.
        colors: (H, W, C) of the front.
        pixel_size: metres.
    """
    neighbor, neighbor_back = (
        np.stack([_moved(values, side) for side in SIDES]) for values in (front, back)
    )
    both = mask & np.stack([_moved(mask, side) for side in SIDES])
    apart = both & (np.maximum(front, neighbor) - np.minimum(back, neighbor_back) > step)
    stepped = both & ~apart & (np.abs(front - neighbor) > step)
    joined = both & ~apart & ~stepped
    nearer = stepped & (front < neighbor)
    outline = nearer.any(axis=0)
    nothing = Hidden(np.zeros_like(mask), front, front, colors)
    if not outline.any():
        return nothing
    region = _reached(outline, joined, int(np.ceil(REACH / pixel_size)))

    # The near part's outline lies where its depth is that of its middle.
    edge = region & (nearer | ~(joined | stepped)).any(axis=0)
    middle_there = front + _to_outline(front, joined, pixel_size)
    middle = _smooth(region, joined, edge * _ANCHORED, middle_there[..., None])[..., 0]
    under = front + np.maximum(2 * (middle - front), pixel_size)

    # Behind it goes on what is seen beyond the steps, unless that is a near part too.
    seen = nearer & ~np.stack([_moved(region, side) for side in SIDES])
    weight = seen.sum(axis=0)
    if not weight.any():
        return nothing
    values = np.concatenate([front[..., None], colors], axis=2).astype(np.float64)
    total = sum(
        np.where(there[..., None], _moved(values, side), 0)
        for there, side in zip(seen, SIDES, strict=True)
    )
    known = total / np.maximum(weight, 1)[..., None]
    beyond = _smooth(region, joined, weight * _ANCHORED, known)
    ground = beyond[..., 0]
    there = region & (ground - under > LEAST_GAP) & (back - ground > THINNEST)
    there &= middle - front > -pixel_size  # what lies behind its outline's depth is no near part
    # A gap is open somewhere: one that no step leads into is none.
    pieces, _ = label(there)
    opened = np.unique(pieces[outline & there])
    there &= np.isin(pieces, opened[opened > 0])
    return Hidden(there, under, ground, beyond[..., 1:])


def _to_outline(front: np.ndarray, joined: np.ndarray, pixel_size: float) -> np.ndarray:
    """(H, W) metres from a pixel at the outline of a rounded part to the depth of its middle.

    The outline passes half a pixel outside. On a circle, half a pixel and one and a half from its
    outline, depth differs by d pixels where the first is (d + sqrt(3 d^2 + 3)) / 2 pixels before
    the circle's middle. Steeper than at the thickest limb there is another part or noise.
    """
    falls = [
        np.where(joined[(k + 2) % 4], front - _moved(front, SIDES[(k + 2) % 4]), 0)
        for k in range(4)
    ]
    slope = np.maximum(np.max(falls, axis=0), 0) / pixel_size
    return np.minimum(pixel_size / 2 * (slope + np.sqrt(3 * slope**2 + 3)), DEEPEST)


def _reached(start: np.ndarray, joined: np.ndarray, count: int) -> np.ndarray:
    """(H, W) bool: the pixels within so many steps from the start, along joined pixels."""
    reached = start.copy()
    for _ in range(count):
        more = reached.copy()
        for k, side in enumerate(SIDES):
            more |= joined[k] & _moved(reached, side)
        reached = more
    return reached


def _smooth(
    region: np.ndarray, joined: np.ndarray, weight: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """(H, W, C): values as smooth as can be over a region, held at those that are known.

    The membrane: the least sum of squared differences of joined pixels, and of the weighted
    squared differences from what is known. It is 0 outside the region and where nothing is known
    of a whole piece of it.
    """
    number = np.full(region.shape, -1)
    count = int(region.sum())
    number[region] = np.arange(count)
    pairs = []
    for k, side in enumerate(SIDES):
        other = _moved(number, side, fill=-1)
        pair = region & joined[k] & (other >= 0)
        pairs.append((number[pair], other[pair]))
    rows, columns = np.concatenate(pairs, axis=1)
    links = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    _, piece = connected_components(links, directed=False)
    held = weight[region].astype(np.float64)
    found = np.bincount(piece, held)[piece] > 0
    degree = np.bincount(rows, minlength=count)
    matrix = diags(np.where(found, degree + held, degree + 1)) - links
    right = np.where(found[:, None], held[:, None] * known[region], 0)
    result = np.zeros((*region.shape, known.shape[2]))
    result[region] = splu(matrix.tocsc()).solve(right)
    return result


def _moved(values: np.ndarray, side: tuple[int, int], fill: float = 0) -> np.ndarray:
    """At each pixel the value of its neighbour on that side; `fill` beyond the frame."""
    result = np.full_like(values, fill)
    height, width = values.shape[:2]
    row, column = side
    here = (
        slice(max(-row, 0), height - max(row, 0)),
        slice(max(-column, 0), width - max(column, 0)),
    )
    there = (
        slice(max(row, 0), height - max(-row, 0)),
        slice(max(column, 0), width - max(-column, 0)),
    )
    result[here] = values[there]
    return result
