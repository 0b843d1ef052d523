"""The noise that NormalGAN trains with, and the paper after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors.axial import axial_sigma
from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View

RIGHT_ANGLE = 1.58
"""What NormalGAN writes for pi/2; it keeps the slant term finite."""


@dataclass(frozen=True)
class NormalGAN(Sensor):
    """Axial Gaussian noise of distance and slant, with NormalGAN's constants.

    Its rays are parallel to the camera's axis. The released script also jitters the contour and
    cuts to whole millimetres; the first comes to nothing there, since the mask is multiplied on
    again, and the second shifts depth by half a millimetre. Both are off unless asked for.

    Source: Wang et al., "NormalGAN: learning detailed 3D human from a single RGB-D image", ECCV
    2020, datasets/data_utils/addNoise.py.
    """

    name: ClassVar[str] = "normalgan"

    contour_jitter: float = 0.0
    """Share of the contour's pixels that are drawn (NormalGAN's is 0.1); every other one is lost
    with its four neighbours. What the script would add lies in the background, which stays 0."""
    truncate: bool = False
    """Cut depth to whole millimetres, as the script's 16-bit images do."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.contour_jitter <= 1:
            raise ValueError(
                f"sensor.contour_jitter: {self.contour_jitter}; give a share from 0 to 1, such "
                "as 0.1"
            )

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`: one standard normal a foreground pixel, in row order."""
        distance = view.distance_at
        sigma = self.noise * axial_sigma(distance, view.normal_at[2], RIGHT_ANGLE)
        sigma = sigma.astype(np.float32, copy=False)
        depth = rng.standard_normal(len(sigma), dtype=np.float32)
        depth *= sigma
        depth += view.depth_at
        if self.truncate:
            offset = np.float32(self.distance - view.grid.distance)
            depth = np.floor((depth + offset) * np.float32(1e3)) / np.float32(1e3) - offset
        valid = depth > 0
        if self.contour_jitter:
            valid &= ~_cut(view.mask, self.contour_jitter, rng)[view.mask]
        depth[~valid] = 0
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))


def _cut(mask: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """(H, W) bool: the crosses of five pixels about every other drawn pixel of the contour."""
    inside = mask.copy()
    inside[1:] &= mask[:-1]
    inside[:-1] &= mask[1:]
    inside[:, 1:] &= mask[:, :-1]
    inside[:, :-1] &= mask[:, 1:]
    contour = np.argwhere(mask & ~inside)
    drawn = rng.integers(0, max(len(contour), 1), int(share * len(contour)))[::2]
    rows, columns = contour[drawn].T
    cut = np.zeros_like(mask)
    for i, j in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        cut[np.clip(rows + i, 0, len(mask) - 1), np.clip(columns + j, 0, mask.shape[1] - 1)] = True
    return cut
