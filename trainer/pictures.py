"""What a branch makes of a few views, as one picture."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from trainer.errors import angle
from trainer.learner import Learner
from trainer.views import Sample

ERROR_MM = 20.0
"""Depth's error that is white; black is none."""
ERROR_DEG = 45.0
"""The normals' likewise."""
MARGIN = 6
"""Pixels round the people, at most."""


def picture(learner: Learner, batch: Sample) -> np.ndarray:
    """(B x h, 7 x w, 3) uint8: a row for each view, h and w pixels of which the people need.

    From left to right: colour; the normals of the given, the predicted and the true depth; depth's
    error as given and as predicted, up to `ERROR_MM`; the predicted normals' error, up to
    `ERROR_DEG`.
    """
    true = learner.surface(learner.branch.true(batch), batch)
    given = learner.surface(learner.branch.given(batch), batch)
    predicted = learner.surface(learner.predict(batch), batch)
    off = [(surface.depth - true.depth).abs() * (1000 / ERROR_MM) for surface in (given, predicted)]
    turned = angle(predicted.normal, true.normal) / ERROR_DEG
    mask = batch.mask
    tiles = [
        torch.where(mask, batch.rgb, 1),
        *(_colors(surface.normal, mask) for surface in (given, predicted, true)),
        *(_grey(error, mask) for error in (*off, turned)),
    ]
    used = mask.any(dim=0)[0].cpu()
    needed = (..., _extent(used.any(dim=1)), _extent(used.any(dim=0)))
    rows = torch.cat([tile.float().cpu()[needed] for tile in tiles], dim=3)  # (B, 3, h, 7 w)
    page = torch.cat(list(rows), dim=1).permute(1, 2, 0)
    return (255 * page.clamp(0, 1)).round().to(torch.uint8).numpy()


def _extent(used: Tensor) -> slice:
    """From the first to the last, and a margin; all where there is none."""
    places = used.nonzero()
    if not len(places):
        return slice(None)
    return slice(max(int(places[0]) - MARGIN, 0), int(places[-1]) + 1 + MARGIN)


def _colors(normal: Tensor, mask: Tensor) -> Tensor:
    """x, y and the part towards the viewer as red, green and blue; white outside."""
    towards = torch.cat([normal[:, :2], normal[:, 2:].abs()], dim=1)
    return torch.where(mask, (towards + 1) / 2, 1)


def _grey(error: Tensor, mask: Tensor) -> Tensor:
    return torch.where(mask, error, 1).expand(-1, 3, -1, -1)
