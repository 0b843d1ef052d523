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


def picture(learner: Learner, batch: Sample) -> np.ndarray:
    """(B x H, 7 x W, 3) uint8: a row for each view.

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
    rows = torch.cat([tile.float().cpu() for tile in tiles], dim=3)  # (B, 3, H, 7 W)
    page = torch.cat(list(rows), dim=1).permute(1, 2, 0)
    return (255 * page.clamp(0, 1)).round().to(torch.uint8).numpy()


def _colors(normal: Tensor, mask: Tensor) -> Tensor:
    """x, y and the part towards the viewer as red, green and blue; white outside."""
    towards = torch.cat([normal[:, :2], normal[:, 2:].abs()], dim=1)
    return torch.where(mask, (towards + 1) / 2, 1)


def _grey(error: Tensor, mask: Tensor) -> Tensor:
    return torch.where(mask, error, 1).expand(-1, 3, -1, -1)
