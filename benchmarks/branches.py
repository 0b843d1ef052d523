"""Trained branches on the test subjects: the front beside the best classical filters of depth.

    python -m benchmarks.branches DIR [--front CHECKPOINT] [--back CHECKPOINT] [--picture FILE]

DIR is a dataset, the checkpoints are what `pipeline.py train` wrote there. A bilateral and a median
filter are tuned on one view of every training subject. Every row is of all test views, whole: mean
absolute error of depth, and the mean angle between the normals of Eq. 6 and those of the true
depth, over the silhouettes' pixels. The back's are given once more for the pixels where the body
has a depth of its own: elsewhere the coarse depth is filled in. FILE becomes a picture of the first
view of three test subjects, in rows as `trainer.pictures` draws them, the fronts above the backs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from PIL import Image
from scipy.ndimage import distance_transform_edt, median_filter
from torch import Tensor
from tqdm import tqdm

from shards.splits import Split
from trainer import checkpoint
from trainer.errors import means, sums
from trainer.learner import Learner, load
from trainer.losses import Surface
from trainer.normals import Side, normals
from trainer.pictures import picture
from trainer.views import Sample, Views, ViewsConfig

Denoise = Callable[[Sample], Tensor]
"""From one view as a batch of one to its (1, 1, H, W) depth in metres."""


@dataclass(frozen=True)
class Median:
    """The median of a square window."""

    size: int
    """Pixels across."""

    def __call__(self, sample: Sample) -> Tensor:
        depth, mask = _read(sample)
        return _person(median_filter(depth, self.size), mask)


@dataclass(frozen=True)
class Bilateral:
    """OpenCV's bilateral filter."""

    space: float
    """Standard deviation in pixels."""
    range: float
    """Standard deviation in metres of depth."""

    def __call__(self, sample: Sample) -> Tensor:
        depth, mask = _read(sample)
        across = 2 * int(np.ceil(2.5 * self.space)) + 1
        return _person(cv2.bilateralFilter(depth, across, self.range, self.space), mask)


def _read(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """The sensor's depth and the silhouette; beyond that stands the nearest depth inside."""
    depth, mask = sample.sensor[0, 0].numpy(), sample.mask[0, 0].numpy()
    if not mask.any():
        return depth, mask
    nearest = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return depth[tuple(nearest)], mask


def _person(depth: np.ndarray, mask: np.ndarray) -> Tensor:
    return torch.from_numpy(np.where(mask, depth, np.float32(0)))[None, None]


SHOWN = 3
"""Test subjects in the picture."""

NOTHING = 1
"""Pixels across a window that changes no depth."""

MEDIANS = [Median(size) for size in (NOTHING, 3, 5, 7)]
BILATERALS = [
    Bilateral(space, reach)
    for space, reach in product(
        (0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.4), (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2, 0.5)
    )
]


def measure(
    denoise: Denoise, samples: Iterable[Sample], side: Side = "front", own: bool = False
) -> tuple[float, float]:
    """Mean error over the silhouettes' pixels, or the body's own of them: millimetres, degrees.

    Raises:
        ValueError: there is none.
    """
    total = torch.zeros(3, dtype=torch.float64)
    for sample in samples:
        found, true = (
            Surface(depth, normals(depth, sample.pixel_size, sample.mask, side))
            for depth in (denoise(sample), sample.front if side == "front" else sample.back)
        )
        total += sums(found, true, sample.body if own else sample.mask)
    millimetres, degrees = means(total)
    if millimetres is None or degrees is None:
        raise ValueError("there is no pixel to measure: the views are empty, or have no body")
    return millimetres, degrees


def whole(data: Path, split: Split, least: tuple[int, int] = (16, 16)) -> Views:
    """The views of a split as they are, whole people in crops no smaller than `least`."""
    views = Views(data, split, ViewsConfig(size=least), varied=False)
    views.show_whole()
    return views


def samples(views: Views, every: int = 1) -> Iterable[Sample]:
    """Every so manieth view, as a batch of one."""
    for index in range(0, len(views), every):
        yield Sample(*(part[None] for part in views[index]))


def tuned(grid: Sequence[Denoise], views: Views) -> Denoise:
    """The filter with the least error of depth on one view of every subject.

    Raises:
        ValueError: it stands at the grid's edge: a better one may lie beyond. None lies beyond a
            window of one pixel, which does nothing.
    """
    some = list(samples(views, len(views) // len(views.subjects)))
    best = grid[int(np.argmin([measure(each, some)[0] for each in tqdm(grid, leave=False)]))]
    for field in fields(best):
        values = {getattr(each, field.name) for each in grid}
        if getattr(best, field.name) in {min(values), max(values)} - {NOTHING}:
            raise ValueError(f"{best} is the best of its grid and at its edge; widen {field.name}")
    return best


def show(title: str, rows: dict[str, tuple[float, float]]) -> None:
    """Print a table whose first row is what the others are measured by."""
    print(f"\n{title:44}{'depth, mm':>10}{'of first':>9}{'normals, deg':>14}{'of first':>9}")
    first = next(iter(rows.values()))
    for name, off in rows.items():
        shares = [ours / theirs for ours, theirs in zip(off, first, strict=True)]
        print(f"{name:44}{off[0]:10.3f}{shares[0]:9.1%}{off[1]:14.2f}{shares[1]:9.1%}")


def drawn(learner: Learner, views: Views) -> np.ndarray:
    """The first views of the first subjects, as `picture` has them."""
    firsts = list(samples(views, len(views) // len(views.subjects)))[:SHOWN]
    return picture(learner, Sample(*map(torch.cat, zip(*firsts, strict=True))))


def stacked(pages: Sequence[np.ndarray]) -> Image.Image:
    """One above the other, white beside the narrower ones."""
    width = max(page.shape[1] for page in pages)
    sides = (((0, 0), (0, width - page.shape[1]), (0, 0)) for page in pages)
    wide = [np.pad(p, side, constant_values=255) for p, side in zip(pages, sides, strict=True)]
    return Image.fromarray(np.concatenate(wide))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of the dataset")
    parser.add_argument("--front", type=Path, help="checkpoint of the front branch")
    parser.add_argument("--back", type=Path, help="checkpoint of the back branch")
    parser.add_argument("--picture", type=Path, help="PNG of some test views, to write")
    options = parser.parse_args()
    if options.picture is not None and options.front is None and options.back is None:
        parser.error("--picture shows what a checkpoint makes; give --front or --back too")
    train, test = (whole(options.data, split) for split in ("train", "test"))
    print(f"{len(test)} views of {len(test.subjects)} test subjects")
    given = {"front": options.front, "back": options.back}
    learners = {side: load(path) for side, path in given.items() if path is not None}
    seen = dict.fromkeys(given, test)
    for side, learner in learners.items():
        if learner.branch.side != side:
            parser.error(f"--{side}: {given[side]} is of the {learner.branch.side} branch")
        learned = checkpoint.load(given[side])
        seen[side] = whole(options.data, "test", tuple(learned.config["views"]["size"]))
        if learned.data["config_sha256"] != test.dataset.description["config_sha256"]:
            print(f"{given[side]} learned from another dataset: perhaps from these people too")
    fronts: dict[str, Denoise] = {"the sensor": lambda sample: sample.sensor}
    fronts |= {str(found): found for found in (tuned(MEDIANS, train), tuned(BILATERALS, train))}
    if "front" in learners:
        fronts["the front branch"] = learners["front"].predict
    show("front", {name: measure(each, samples(seen["front"])) for name, each in fronts.items()})
    backs: dict[str, Denoise] = {"the body": lambda sample: sample.coarse}
    if "back" in learners:
        backs["the back branch"] = learners["back"].predict
    for title, own in (("back", False), ("back, where the body is", True)):
        views = seen["back"]
        rows = {name: measure(each, samples(views), "back", own) for name, each in backs.items()}
        show(title, rows)
    if options.picture is not None:
        pages = [drawn(learner, seen[side]) for side, learner in learners.items()]
        stacked(pages).save(options.picture)


if __name__ == "__main__":
    main()
