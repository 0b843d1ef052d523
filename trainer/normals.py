"""Normals of a depth map, differentiable, so that a loss on normals trains the depth.

Eq. 6 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images". Frames and
the grid of pixels are those of docs/conventions.md.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, get_args

import torch
from torch import Tensor
from torch.nn.functional import pad

Side = Literal["front", "back"]

RING = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""The neighbours C of Eq. 6, in pixels (right, up), counter-clockwise for the viewer.

The paper leaves C open. Inside the surface these four, in pairs of consecutive ones, amount to
central differences. All eight round a pixel would amount to Sobel's filter, which is blind to every
pattern that alternates along the rows or along the columns, such as a transposed convolution
leaves; central differences are blind only to what repeats every two pixels along both.
"""


def normals(depth: Tensor, pixel_size: float | Tensor, mask: Tensor, side: Side) -> Tensor:
    """Outward unit normals of a depth map: Eq. 6, in the front camera's frame.

    A pixel's normal is the sum, at unit length, of the cross products of the edges to consecutive
    neighbours of `RING`. Pairs with a neighbour outside the mask or the frame are left out.

    Every pair adds pixel_size^2 to the sum's z, so the sum is zero where there is no pair and
    nowhere else, and gradients are finite at every depth. A depth outside the mask is not looked
    at, even one that is not finite. Where all neighbours are inside, the pixel's own depth cancels.

    Args:
        depth: (B, 1, H, W) metres from the front camera's plane, of either side.
        pixel_size: metres, one for all maps or (B,).
        mask: (B, 1, H, W) bool, the silhouette.
        side: "front" for normals of z >= 0, "back" for z <= 0.

    Returns:
        (B, 3, H, W), float32 unless `depth` is float64; 0 outside the mask and where no pair is
        left, as on a line one pixel wide.

    Raises:
        ValueError: shapes disagree, or there is no such side.
    """
    if side not in get_args(Side):
        raise ValueError(f"side: {side!r}; give one of {', '.join(get_args(Side))}")
    if depth.dim() != 4 or depth.shape[1] != 1 or mask.shape != depth.shape:
        raise ValueError(
            f"depth is {tuple(depth.shape)} and mask {tuple(mask.shape)}; give (B, 1, H, W) of both"
        )
    # Half precision has no room for the squares of steep slopes.
    depth = depth.to(torch.promote_types(depth.dtype, torch.float32))
    pixel = torch.as_tensor(pixel_size, dtype=depth.dtype, device=depth.device)
    if pixel.numel() not in (1, len(depth)):
        raise ValueError(
            f"pixel_size: {pixel.numel()} for {len(depth)} maps; give one for all or for each"
        )
    pixel = pixel.view(-1, 1, 1, 1)
    # Points in units of the pixel: neighbours stand at whole x and y, a cross product's z is 1.
    height = -depth / pixel
    edges = []
    for right, up in (*RING, RING[0]):
        inside = mask & _neighbor(mask, right, up)
        edges.append((right, up, _neighbor(height, right, up) - height, inside))
    x, y, z = (torch.zeros_like(height) for _ in range(3))
    for (x1, y1, z1, inside1), (x2, y2, z2, inside2) in pairwise(edges):
        both = inside1 & inside2
        x = x + torch.where(both, y1 * z2 - y2 * z1, 0)
        y = y + torch.where(both, x2 * z1 - x1 * z2, 0)
        z = z + both * (x1 * y2 - x2 * y1)
    length = (x.square() + y.square() + z.square().clamp_min(1)).sqrt()
    outward = 1 if side == "front" else -1
    return torch.cat((x, y, z), dim=1) * (outward / length)


def _neighbor(values: Tensor, right: int, up: int) -> Tensor:
    """(B, C, H, W): at each pixel the value of the one so far right and up; 0 beyond the frame."""
    rows, columns = values.shape[-2:]
    padded = pad(values, (1, 1, 1, 1))
    return padded[..., 1 - up : 1 - up + rows, 1 + right : 1 + right + columns]
