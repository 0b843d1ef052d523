"""A trained branch at use: depth in the grid of a whole view."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from trainer import checkpoint, processes
from trainer.checkpoint import CheckpointError
from trainer.learner import restored
from trainer.normals import Side
from trainer.views import Crop, Sample, cropped


class GivenView(NamedTuple):
    """What is known of a view before anything is predicted.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        sensor: (H, W) float32 metres from the camera's plane, 0 = no reading.
        body_back: (H, W) float32 metres, the bare body's back from the same plane, 0 = none.
        mask: (H, W) bool, the subject's silhouette.
        pixel_size: metres.
    """

    rgb: np.ndarray
    sensor: np.ndarray
    body_back: np.ndarray
    mask: np.ndarray
    pixel_size: float


class Predictor:
    """A branch of a checkpoint.

    Attributes:
        side: which side's depth it predicts.
        needs_body: whether it is of no use without `GivenView.body_back`.
        middle: metres from the camera's plane to the middle of the depths that it learned.

    Args:
        path: what a training wrote.
        side: the side that is wanted.
        device: where to predict.

    Raises:
        CheckpointError: the file is no checkpoint, or of the other side's branch.
        ValueError: there is no such device.
    """

    def __init__(self, path: Path, side: Side, device: str = "cpu") -> None:
        found = checkpoint.load(path)
        self._learner = restored(found, path, processes.usable(device))
        self.side = side
        if self._learner.branch.side != side:
            raise CheckpointError(
                f"{path} is of the {self._learner.branch.side} branch; give one of the {side}"
            )
        self.needs_body = self._learner.branch.needs_body
        self.middle = (self._learner.span.near + self._learner.span.far) / 2
        self._size = tuple(found.config["views"]["size"])

    def depth(self, view: GivenView) -> np.ndarray:
        """(H, W) float32 metres of its side, from the front camera's plane; 0 off the silhouette.

        The person is whole in what the network sees, in a crop no smaller than it learned from.

        Raises:
            ValueError: the silhouette is empty, nothing of the sensor lies in it, or a body is
                needed and none lies in it.
        """
        mask = view.mask
        if not mask.any():
            raise ValueError("the silhouette is empty; there is nobody to reconstruct")
        if not (view.sensor[mask] > 0).any():
            raise ValueError("the sensor read nothing of the silhouette")
        if self.needs_body and not (view.body_back[mask] > 0).any():
            raise ValueError("no body lies in the silhouette, and the back is made from one")
        sides = [np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0)]
        rows, columns = (
            max(int(used[-1] - used[0]) + 1, least)
            for used, least in zip(sides, self._size, strict=True)
        )
        crop = Crop(mask, (rows, columns), mirrored=False, rng=None)
        nothing = np.zeros(mask.shape, np.float32)
        sample = cropped(
            crop,
            rgb=view.rgb,
            sensor=view.sensor,
            body_back=view.body_back,
            mask=mask,
            front=nothing,
            back=nothing,
            pixel_size=view.pixel_size,
            index=0,
        )
        batch = Sample(*(part[None].to(self._learner.device) for part in sample))
        found = self._learner.predict(batch)[0, 0].cpu().numpy()
        return crop.laid_back(found, mask.shape)
