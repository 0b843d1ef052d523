"""What the networks learn from: single views of a dataset, cropped to the person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset

import seeds
from augment import sensors
from shards.archive import Shard
from shards.dataset import Dataset
from shards.splits import Split

Noise = Literal["stored", "redrawn"]

RANGE_MARGIN = 0.1
"""Metres beyond the depths seen in one view of every subject: the other views are turned."""

_READ = ("depth_front", "normal_front", "rgb_front", "mask")


@dataclass(frozen=True)
class ViewsConfig:
    """Which views are read, and how they are varied."""

    size: tuple[int, int] = (416, 256)
    """Rows and columns of a crop, pixels; it is centred on the silhouette's rectangle."""
    noise: Noise = "redrawn"
    """`stored` takes the sensor's reading from the shard, `redrawn` another one each epoch."""
    flip: bool = True
    """Mirror every second view left-right, by chance; normals are mirrored with it."""

    def __post_init__(self) -> None:
        if not (len(self.size) == 2 and all(16 <= n <= 4096 for n in self.size)):
            raise ValueError(f"views.size: {self.size}; give rows and columns of 16 to 4096 pixels")


class DepthRange(NamedTuple):
    """What depth becomes for a network: 2 (d - near) / (far - near) - 1, as NormalGAN has it.

    Attributes:
        near, far: metres from the camera's plane.
    """

    near: float
    far: float

    def normalised(self, depth: torch.Tensor) -> torch.Tensor:
        """Metres to about -1 to 1."""
        return 2 * (depth - self.near) / (self.far - self.near) - 1

    def metres(self, normalised: torch.Tensor) -> torch.Tensor:
        """The inverse."""
        return (normalised + 1) * ((self.far - self.near) / 2) + self.near


class Sample(NamedTuple):
    """One view, cropped; a batch has one axis more. All maps are 0 outside the silhouette.

    Attributes:
        rgb: (3, h, w) float32, sRGB in [0, 1].
        sensor: (1, h, w) float32 metres, the sensor's reading; where it has none inside the
            silhouette, the nearest reading of the row.
        valid: (1, h, w) bool, where the sensor has a reading of its own.
        front, back: (1, h, w) float32 metres, true depth from the front camera's plane.
        coarse: (1, h, w) float32 metres, the bare body's back; where the body is not, the nearest
            of the row, and the silhouette's middle depth where a row has none.
        body: (1, h, w) bool, the body's own silhouette.
        mask: (1, h, w) bool, the subject's silhouette.
        pixel_size: () float32 metres.
        index: () int64, of the view in the dataset.
    """

    rgb: torch.Tensor
    sensor: torch.Tensor
    valid: torch.Tensor
    front: torch.Tensor
    back: torch.Tensor
    coarse: torch.Tensor
    body: torch.Tensor
    mask: torch.Tensor
    pixel_size: torch.Tensor
    index: torch.Tensor


class Views(TorchDataset):
    """The views of one split of a dataset, in the order of subjects and views.

    It reads only a crop's rows and columns from mapped files, keeps no file open across processes,
    and every draw comes from (seed, subject, view, epoch): the samples are the same for any number
    of loader workers and for any sampler.

    Args:
        folder: the dataset's, or one power's of a light sweep.
        split: "train" or "test".
        config: size and variation.
        varied: whether noise is redrawn and views are flipped; if not, the shard is taken as it is.
        seed: of the variation.

    Raises:
        ValueError: the folder holds no dataset, or the split no subject.
    """

    def __init__(
        self, folder: Path | str, split: Split, config: ViewsConfig, varied: bool, seed: int = 0
    ) -> None:
        self.dataset = Dataset(folder)
        self.config = config
        self.varied = varied
        self.seed = seed
        self.epoch = 0
        self.subjects = self.dataset.subjects(split)
        if not self.subjects:
            raise ValueError(
                f"{folder} has no subject in its {split} split; build more subjects there"
            )
        self._shards = [self.dataset.shard(subject) for subject in self.subjects]
        self._first = np.cumsum([0, *(len(shard) for shard in self._shards)])

    def __len__(self) -> int:
        """How many views there are."""
        return int(self._first[-1])

    def set_epoch(self, epoch: int) -> None:
        """Vary the views in another way from now on; loaders with workers start these anew."""
        self.epoch = epoch

    def place(self, index: int) -> tuple[str, int]:
        """The subject's id and the number of the view among its views.

        Raises:
            IndexError: there are not that many views.
        """
        number, view = self._place(index)
        return self.subjects[number], view

    def depth_range(self) -> DepthRange:
        """Of the first view of every subject, and a margin."""
        near, far = np.inf, -np.inf
        for shard in self._shards:
            mask = shard["mask"][0]
            near = min(near, float(shard["depth_front"][0][mask].min()))
            far = max(far, float(shard["depth_back"][0][mask].max()))
            shard.close()
        return DepthRange(round(near - RANGE_MARGIN, 3), round(far + RANGE_MARGIN, 3))

    def __getitem__(self, index: int) -> Sample:
        """One view.

        Raises:
            IndexError: there are not that many.
        """
        number, view = self._place(index)
        subject, shard = self.subjects[number], self._shards[number]
        rng = seeds.generator(self.seed, subject, "augment", view, self.epoch)
        mask = shard["mask"][view]
        crop = _Crop(mask, self.config.size)
        inside = crop.cut(mask)
        read = crop.cut(self._reading(shard, view))
        body = crop.cut(shard["body_depth_back"][view])
        front, back = (crop.cut(shard[f"depth_{side}"][view]) for side in ("front", "back"))
        middle = float(back[inside].mean()) if inside.any() else 0.0
        maps = {
            "rgb": crop.cut(shard["rgb_front"][view]).transpose(2, 0, 1) / np.float32(255),
            "sensor": _filled(read, inside, middle)[None],
            "valid": (read > 0)[None],
            "front": front[None],
            "back": back[None],
            "coarse": _filled(body, inside, middle)[None],
            "body": (body > 0)[None],
            "mask": inside[None],
        }
        if self.varied and self.config.flip and rng.random() < 0.5:
            maps = {name: image[..., ::-1] for name, image in maps.items()}
        pixel_size = np.float32(shard.meta["camera"]["pixel_size"])
        return Sample(
            **{name: torch.from_numpy(np.ascontiguousarray(image)) for name, image in maps.items()},
            pixel_size=torch.tensor(pixel_size),
            index=torch.tensor(index),
        )

    def _place(self, index: int) -> tuple[int, int]:
        """The number of the subject, and that of the view among its views."""
        if not 0 <= index < len(self):
            raise IndexError(f"view {index} is not among 0 to {len(self) - 1}")
        number = int(np.searchsorted(self._first, index, side="right")) - 1
        return number, index - int(self._first[number])

    def _reading(self, shard: Shard, view: int) -> np.ndarray:
        """(H, W) what the sensor reads of a view, in this epoch."""
        if not self.varied or self.config.noise == "stored":
            return shard["depth_sensor"][view]
        # The device brings its own light: under another lamp it reads what the base holds.
        lit = shard.base or shard
        maps = {name: lit[name][view] for name in _READ}
        return sensors.read(maps, lit.meta, view, self._draw(lit.meta)).depth

    def _draw(self, meta: Mapping[str, Any]) -> int:
        """Which of the sensor's draws: those that the dataset holds are left to it."""
        return 1_000_000 * (1 + self.seed) + self.epoch


class _Crop:
    """A window of fixed size round a silhouette's rectangle; it may reach beyond the image."""

    def __init__(self, mask: np.ndarray, size: tuple[int, int]) -> None:
        self._size = size
        self._corner = [
            _middle(np.flatnonzero(mask.any(axis=1 - axis)), mask.shape[axis]) - size[axis] // 2
            for axis in (0, 1)
        ]

    def cut(self, image: np.ndarray) -> np.ndarray:
        """(h, w, ...) of an (H, W, ...) map, 0 beyond its border."""
        window = np.zeros((*self._size, *image.shape[2:]), dtype=image.dtype)
        here, there = [], []
        for axis, (start, length) in enumerate(zip(self._corner, self._size, strict=True)):
            first, last = max(start, 0), min(start + length, image.shape[axis])
            there.append(slice(first, max(last, first)))
            here.append(slice(first - start, max(last, first) - start))
        window[tuple(here)] = image[tuple(there)]
        return window


def _middle(used: np.ndarray, length: int) -> int:
    """Of the indices from the first to the last; of the whole axis where there is none."""
    return (int(used[0]) + int(used[-1]) + 1) // 2 if len(used) else length // 2


def _filled(depth: np.ndarray, inside: np.ndarray, otherwise: float) -> np.ndarray:
    """Depth at every pixel inside: its own, or the nearest in the row, or `otherwise`.

    Args:
        depth: (h, w) metres, 0 = none.
        inside: (h, w) bool; 0 outside of it.
    """
    have = depth > 0
    if (have | ~inside).all():
        return np.where(inside, depth, np.float32(0))
    columns = np.arange(depth.shape[1], dtype=np.int32)
    far = np.int32(4 * depth.shape[1])
    left = np.maximum.accumulate(np.where(have, columns, -far), axis=1)
    right = np.minimum.accumulate(np.where(have, columns, far)[:, ::-1], axis=1)[:, ::-1]
    nearest = np.where(columns - left <= right - columns, left, right)
    some = (nearest >= 0) & (nearest < depth.shape[1])
    taken = np.take_along_axis(depth, np.where(some, nearest, 0), axis=1)
    return np.where(inside, np.where(some, taken, np.float32(otherwise)), np.float32(0))
