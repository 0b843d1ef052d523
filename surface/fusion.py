"""Fusion: a front's and a back's depth become one closed surface.

Section 3.5 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images" joins both
clouds by their nearest neighbours, with interpolation where they stand apart. The nearest
neighbours of points on one grid are those of the grid, so the surface is woven there
(`surface.lattice`): it is closed, manifold and oriented for any maps, and mirroring the depths
mirrors it, triangle for triangle, as long as no two ways to tie neighbours are equally short.
"""

from __future__ import annotations

import math

import numpy as np

from surface.hidden import THINNEST, behind
from surface.mesh import SurfaceError, TriangleMesh
from surface.weaving import Layers, woven

STEP = 0.1
"""Metres between neighbouring pixels that part them, by default."""


def fuse(
    depth_front: np.ndarray,
    depth_back: np.ndarray,
    mask: np.ndarray,
    pixel_size: float,
    rgb_front: np.ndarray | None = None,
    rgb_back: np.ndarray | None = None,
    step: float | None = STEP,
) -> TriangleMesh:
    """The closed surface through a front's and a back's depth maps.

    Every pixel of the silhouette is a vertex of the front and one of the back. The outline is
    closed by rims that bulge half a pixel beyond it.

    Args:
        depth_front, depth_back: (H, W) metres from the front camera's plane.
        mask: (H, W) bool, the silhouette.
        pixel_size: metres.
        rgb_front, rgb_back: (H, W, 3) uint8 sRGB in the same grid; both or none.
        step: metres of depth between neighbouring pixels from which on the nearer one is no more
            joined to the farther one: the surface turns round behind it, and what is behind goes
            on below. None joins all neighbours, the paper's way.

    Returns:
        A mesh in the front camera's frame, metres; closed, edge-manifold and vertex-manifold, its
        faces counter-clockwise seen from outside. Its Euler characteristic without `step` is twice
        that of the silhouette's pixels joined along rows and columns.

    Raises:
        SurfaceError: the maps' sizes differ, the silhouette is empty, or a depth inside it is no
            positive number.
    """
    _check(depth_front, depth_back, mask, pixel_size, rgb_front, rgb_back, step)
    crop = _extent(mask)
    colored = rgb_front is not None and rgb_back is not None
    maps = [depth_front, depth_back, mask, *((rgb_front, rgb_back) if colored else ())]
    cut = [np.pad(m[crop], ((1, 1), (1, 1), *((0, 0),) * (m.ndim - 2))) for m in maps]
    front, back, inside = cut[0].astype(np.float64), cut[1].astype(np.float64), cut[2]
    # A back may be predicted before the front: then both stand at their middle.
    middle = (front + back) / 2
    thin = inside & (back - front < THINNEST)
    front = np.where(thin, middle - THINNEST / 2, front)
    back = np.where(thin, middle + THINNEST / 2, back)
    colors = tuple(np.asarray(c, np.float64) for c in cut[3:])
    layers = _layers(front, back, inside, colors, pixel_size, step)
    # The crop's first pixel, of the padding, in the grid of the whole view.
    height, width = mask.shape
    left = (crop[1].start - 1 + 0.5 - width / 2) * pixel_size
    top = (height / 2 - (crop[0].start - 1) - 0.5) * pixel_size
    return woven(layers, (left, top), pixel_size, math.inf if step is None else step)


def _check(
    front: np.ndarray,
    back: np.ndarray,
    mask: np.ndarray,
    pixel_size: float,
    rgb_front: np.ndarray | None,
    rgb_back: np.ndarray | None,
    step: float | None,
) -> None:
    if (
        mask.ndim != 2
        or mask.dtype != bool
        or front.shape != mask.shape
        or back.shape != mask.shape
    ):
        raise SurfaceError(
            f"depth maps of {front.shape} and {back.shape} with a mask of {mask.shape} "
            f"({mask.dtype}); give (H, W) of all three, the mask bool"
        )
    if (rgb_front is None) != (rgb_back is None):
        raise SurfaceError("colours of one side only; give rgb_front and rgb_back, or neither")
    for name, rgb in (("rgb_front", rgb_front), ("rgb_back", rgb_back)):
        if rgb is not None and rgb.shape != (*mask.shape, 3):
            raise SurfaceError(f"{name} is {rgb.shape}; give {(*mask.shape, 3)}")
    if not 0 < pixel_size < math.inf:
        raise SurfaceError(f"pixel_size: {pixel_size}; give metres, such as 0.005")
    if step is not None and not step > 0:
        raise SurfaceError(f"step: {step}; give metres, such as {STEP}, or null")
    if not mask.any():
        raise SurfaceError("the silhouette is empty; there is no surface to fuse")
    for name, depth in (("front", front), ("back", back)):
        bad = mask & ~(np.isfinite(depth) & (depth > 0))
        if bad.any():
            i, j = np.argwhere(bad)[0]
            raise SurfaceError(
                f"the {name}'s depth is {depth[i, j]} at row {i}, column {j}, and no number above "
                f"0 at {int(bad.sum())} of {int(mask.sum())} pixels; give depth in all the mask"
            )


def _extent(mask: np.ndarray) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _layers(
    front: np.ndarray,
    back: np.ndarray,
    inside: np.ndarray,
    colors: tuple[np.ndarray, ...],
    pixel_size: float,
    step: float | None,
) -> Layers:
    """The parts of every line of sight: what is seen of them, and what is guessed behind steps."""
    seen = colors or (np.zeros((*front.shape, 0)),) * 2
    if step is None:
        depth, shades = np.stack([front, back]), np.stack(seen)
        return Layers(depth, shades if colors else None, inside.astype(np.int64))
    # The back is a front to who looks from behind.
    near = behind(front, back, inside, step, seen[0], pixel_size)
    far = behind(-back, -front, inside, step, seen[1], pixel_size)
    under, ground, over, roof = near.under, near.ground, -far.under, -far.ground
    room = roof - ground > THINNEST
    # Without room for a part between them both speak of the same two parts, and best of all do so
    # what is seen of the near one's back and of the far one's front.
    same = near.there & far.there & ~room & (ground - roof > THINNEST)
    under, over = np.where(same, roof, under), np.where(same, ground, over)
    three = near.there & far.there & room
    wider = near.ground - near.under >= far.ground - far.under
    first = near.there & ~three & (~far.there | same | wider)
    second = far.there & ~three & ~first
    parts = inside.astype(np.int64) + (first | second) + 2 * three

    def layered(stacks: tuple[np.ndarray, ...], front: np.ndarray, back: np.ndarray) -> np.ndarray:
        """Nodes in order; `stacks` are under, ground, roof and over."""
        under, ground, roof, over = stacks

        def chosen(*choices: np.ndarray) -> np.ndarray:
            tail = (1,) * (front.ndim - 2)
            where = [c.reshape(*c.shape, *tail) for c in (three | first, second)]
            return np.select(where, choices[:2], choices[2])

        return np.stack(
            [
                front,
                chosen(under, roof, back),
                chosen(ground, over, back),
                np.where(three.reshape(*three.shape, *(1,) * (front.ndim - 2)), roof, back),
                over,
                back,
            ]
        )

    depth = layered((under, ground, roof, over), front, back)
    shades = layered((seen[0], near.colors, far.colors, seen[1]), *seen) if colors else None
    return Layers(depth, shades, parts)
