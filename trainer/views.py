"""What the networks learn from: single views of a dataset, cropped to the person."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset

import seeds
from augment import sensors
from shards.archive import Shard
from shards.dataset import Dataset
from shards.splits import Split
from trainer.filling import filled

Noise = Literal["stored", "redrawn"]

RANGE_MARGIN = 0.1
"""Metres beyond the depths seen in one view of every subject: the other views are turned."""

_READ = ("depth_front", "normal_front", "rgb_front", "mask")


@dataclass(frozen=True)
class ViewsConfig:
    """Which views are read, and how they are varied."""

    size: tuple[int, int] = (416, 256)
    """Rows and columns of a crop, pixels; it is centred on the silhouette's rectangle, or lies
    anywhere in it, by chance, where that is larger.
    """
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
            silhouette, that of its surroundings.
        valid: (1, h, w) bool, where the sensor has a reading of its own.
        front, back: (1, h, w) float32 metres, true depth from the front camera's plane.
        coarse: (1, h, w) float32 metres, the bare body's back (Eq. 4); where the body is not, that
            of its surroundings.
        body: (1, h, w) bool, where the coarse depth is the body's own.
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

    It reads single views of mapped files and keeps none open. Every draw comes from (seed, subject,
    view, epoch): the samples are the same for any number of loader workers and for any sampler.

    Args:
        folder: the dataset's, or one power's of a light sweep.
        split: "train" or "test".
        config: size and variation.
        varied: whether noise is redrawn and views are flipped; if not, the shard is taken as it is.
        seed: of the variation.

    Raises:
        ValueError: the folder holds no dataset, the split no subject, or its sensor, whose noise is
            to be redrawn, is not known here.
    """

    def __init__(
        self, folder: Path | str, split: Split, config: ViewsConfig, varied: bool, seed: int = 0
    ) -> None:
        self.dataset = Dataset(folder)
        self.config = config
        self.varied = varied
        self.seed = seed
        # Shared, so that workers which outlive an epoch know of the next.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()
        self.subjects = self.dataset.subjects(split)
        if not self.subjects:
            raise ValueError(
                f"{folder} has no subject in its {split} split; build more subjects there"
            )
        self._shards = [self.dataset.shard(subject) for subject in self.subjects]
        self._first = np.cumsum([0, *(len(shard) for shard in self._shards)])
        if varied and config.noise == "redrawn":
            self._ask_for_sensor()

    def _ask_for_sensor(self) -> None:
        """Before an epoch is under way.

        Raises:
            ValueError: the first subject's sensor is no model that is known here.
        """
        shard = self._shards[0]
        try:
            sensors.sensor_in((shard.base or shard).meta)
        except ValueError as error:
            raise ValueError(f"{error}, or train with --views.noise stored") from error
        finally:
            shard.close()

    def __len__(self) -> int:
        """How many views there are."""
        return int(self._first[-1])

    def resize(self, size: tuple[int, int]) -> None:
        """Crop to another size from now on."""
        self.config = replace(self.config, size=size)

    def show_whole(self) -> None:
        """Crop so that every person is whole, and no smaller than is configured: networks see
        where a crop ends, so those that learned from large crops predict worse on smaller ones.
        """
        rows, columns = map(max, self.extent(), self.config.size)
        self.resize((rows, columns))

    @property
    def epoch(self) -> int:
        """Of the variation."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Vary the views in another way from the next loader's pass on, in its workers too."""
        self._epoch.fill_(epoch)

    def extent(self) -> tuple[int, int]:
        """Rows and columns of the largest silhouettes' rectangles."""
        largest = np.zeros(2, dtype=int)
        for shard in self._shards:
            for mask in shard["mask"]:
                sides = [np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0)]
                if all(map(len, sides)):
                    largest = np.maximum(largest, [used[-1] - used[0] + 1 for used in sides])
            shard.close()
        return int(largest[0]), int(largest[1])

    def place(self, index: int) -> tuple[str, int]:
        """The subject's id and the number of the view among its views.

        Raises:
            IndexError: there are not that many views.
        """
        number, view = self._place(index)
        return self.subjects[number], view

    def depth_range(self) -> DepthRange:
        """Of the first view of every subject, and a margin.

        Raises:
            ValueError: none of them shows anything.
        """
        near, far = np.inf, -np.inf
        for shard in self._shards:
            mask = shard["mask"][0]
            near = shard["depth_front"][0].min(where=mask, initial=near)
            far = shard["depth_back"][0].max(where=mask, initial=far)
            shard.close()
        if not near < far:
            raise ValueError(
                f"{self.dataset.folder}: the first views of all subjects are empty; verify it"
            )
        near, far = float(near), float(far)
        return DepthRange(round(near - RANGE_MARGIN, 3), round(far + RANGE_MARGIN, 3))

    def without_body(self) -> list[str]:
        """The subjects that came without a body: all is 0 in their first view."""
        found = []
        for subject, shard in zip(self.subjects, self._shards, strict=True):
            if not shard["body_depth_back"][0].any():
                found.append(subject)
            shard.close()
        return found

    def __getitem__(self, index: int) -> Sample:
        """One view.

        Raises:
            IndexError: there are not that many.
        """
        number, view = self._place(index)
        subject, shard = self.subjects[number], self._shards[number]
        rng = seeds.generator(self.seed, subject, "augment", view, self.epoch)
        mirrored = self.varied and self.config.flip and rng.random() < 0.5
        mask = shard["mask"][view]
        crop = Crop(mask, self.config.size, mirrored, rng if self.varied else None)
        sample = cropped(
            crop,
            rgb=shard["rgb_front"][view],
            sensor=self._reading(shard, view),
            body_back=shard["body_depth_back"][view],
            mask=mask,
            front=shard["depth_front"][view],
            back=shard["depth_back"][view],
            pixel_size=shard.meta["camera"]["pixel_size"],
            index=index,
        )
        shard.close()  # a process may read more subjects than it may have files open
        return sample

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
        return sensors.read(maps, lit.meta, view, self._draw()).depth

    def _draw(self) -> int:
        """Which of the sensor's draws: those that the dataset holds are left to it."""
        return 1_000_000 * (1 + self.seed) + self.epoch


def cropped(
    crop: Crop,
    rgb: np.ndarray,
    sensor: np.ndarray,
    body_back: np.ndarray,
    mask: np.ndarray,
    front: np.ndarray,
    back: np.ndarray,
    pixel_size: float,
    index: int,
) -> Sample:
    """A view as the networks take it.

    Args:
        crop: of the mask.
        rgb: (H, W, 3) uint8 sRGB.
        sensor, body_back, front, back: (H, W) float32 metres, 0 = none.
        mask: (H, W) bool.
        pixel_size: metres.
        index: of the view in its dataset.
    """

    def person(image: np.ndarray) -> np.ndarray:
        return image[crop.rectangle]

    inside = person(mask)
    read, body = (np.where(inside, person(found), np.float32(0)) for found in (sensor, body_back))
    maps = {
        "rgb": person(rgb),
        # What is missing is taken from the whole person, however small the crop.
        "sensor": filled(read, inside),
        "valid": read > 0,
        "front": person(front),
        "back": person(back),
        "coarse": filled(body, inside),
        "body": body > 0,
        "mask": inside,
    }
    cut = {name: crop.cut(image) for name, image in maps.items()}
    color = np.divide(cut.pop("rgb").transpose(2, 0, 1), np.float32(255), order="C")
    return Sample(
        rgb=torch.from_numpy(color),
        **{name: torch.from_numpy(image[None]) for name, image in cut.items()},
        pixel_size=torch.tensor(np.float32(pixel_size)),
        index=torch.tensor(index),
    )


class Crop:
    """A window of fixed size on a silhouette's rectangle; it may reach beyond it.

    Attributes:
        rectangle: rows and columns of the image; the whole of it where there is no silhouette.

    Args:
        mirrored: whether what is cut is turned left-right.
        rng: chooses where the window lies along an axis on which the rectangle is larger; None
            centres it there too.
    """

    def __init__(
        self,
        mask: np.ndarray,
        size: tuple[int, int],
        mirrored: bool,
        rng: np.random.Generator | None,
    ) -> None:
        self._size, self._step = size, -1 if mirrored else 1
        sides, self._corner = [], []
        for axis in (0, 1):
            used = np.flatnonzero(mask.any(axis=1 - axis))
            first, end = (int(used[0]), int(used[-1]) + 1) if len(used) else (0, mask.shape[axis])
            sides.append(slice(first, end))
            spare = end - first - size[axis]
            if spare > 0 and rng is not None:
                self._corner.append(int(rng.integers(spare + 1)))
            else:
                self._corner.append((first + end) // 2 - size[axis] // 2 - first)
        self.rectangle = (sides[0], sides[1])

    def cut(self, image: np.ndarray) -> np.ndarray:
        """(h, w, ...) of a map of the rectangle, 0 beyond its border."""
        window = np.zeros((*self._size, *image.shape[2:]), dtype=image.dtype)
        here, there = self._overlap(image.shape[:2])
        window[:, :: self._step][here] = image[there]
        return window

    def laid_back(self, window: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """(H, W, ...) of the whole image, from a window; 0 outside of the rectangle and of it."""
        image = np.zeros((*shape, *window.shape[2:]), dtype=window.dtype)
        person = image[self.rectangle]
        here, there = self._overlap(person.shape[:2])
        person[there] = window[:, :: self._step][here]
        return image

    def _overlap(self, shape: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
        """Rows and columns of the window, and those of the rectangle, that are the same."""
        here, there = [], []
        for start, length, side in zip(self._corner, self._size, shape, strict=True):
            first, last = max(start, 0), min(start + length, side)
            there.append(slice(first, max(last, first)))
            here.append(slice(first - start, max(last, first) - start))
        return tuple(here), tuple(there)
