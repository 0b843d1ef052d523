"""A picture of a dataset: one row a subject, one column a map, all at one scale.

python -m report.sheet out/demo --output sheet.png
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from report import command
from report.maps import PAPER, TITLES, box_of, height_of, pictured
from report.view import chosen
from shards.dataset import Dataset

COLUMNS = (
    *("rgb_front", "rgb_back", "depth_front", "depth_back", "normal_front", "normal_back"),
    *("depth_sensor", "body_depth_back"),
)
LIMIT = 24
"""Subjects that are drawn where none are named."""
LARGEST = 64_000_000
"""Pixels of a picture; beyond them people are drawn at a smaller scale, so that viewers open it."""
SMALLEST = 32
"""Pixels of the highest person at the least: one drawn smaller shows nothing."""

MARGIN = 8
"""Pixels around each person."""
HEADER, LABEL = 24, 22
"""Pixels of the line of titles, and of the line above each row."""

_INK, _GREY, _RULE = (40, 40, 40), (110, 110, 110), (225, 225, 225)


def sheet(folder: Path, subjects: list[str], view: int) -> Image.Image:
    """One row for each subject: the maps of one view, above them its id and its height.

    All rows have one scale, that of the largest pixel among them. A height is the silhouette's,
    raised hands included.

    Args:
        subjects: ids; not empty.

    Raises:
        ValueError: the dataset has no such subject or view, one is not seen in it,
            or there are too many for one picture.
    """
    dataset = Dataset(folder)
    crops = [_crop(dataset, subject, view) for subject in subjects]
    font = ImageFont.load_default(size=14)
    titles = [TITLES[name] for name in COLUMNS]
    widest = math.ceil(max(font.getlength(title) for title in titles))
    scale = 1 / max(crop.pixel_size for crop in crops)
    while math.prod(_page_size(crops, scale, widest)) > LARGEST:
        scale *= 0.95
        if scale * max(crop.height for crop in crops) < SMALLEST:
            raise ValueError(
                f"{len(crops)} subjects are too many for one picture; set a lower --limit"
            )
    page = Image.new("RGB", _page_size(crops, scale, widest), (PAPER, PAPER, PAPER))
    cell = page.width // len(COLUMNS)
    draw = ImageDraw.Draw(page)
    for k, title in enumerate(titles):
        draw.text((k * cell + cell // 2, 5), title, fill=_INK, font=font, anchor="mt")
    top = HEADER
    for crop in crops:
        size = crop.size(scale)
        draw.line((MARGIN, top, page.width - MARGIN, top), fill=_RULE)
        label = f"{crop.subject}, {crop.height:.2f} m"
        draw.text((MARGIN, top + LABEL // 2), label, fill=_GREY, font=font, anchor="lm")
        for k, picture in enumerate(_pictures(dataset, crop, size)):
            page.paste(picture, (k * cell + (cell - size[0]) // 2, top + LABEL + MARGIN))
        top += LABEL + MARGIN + size[1] + MARGIN
    return page


@dataclass(frozen=True)
class _Crop:
    """What is drawn of one subject.

    Attributes:
        box: rows and columns of its maps.
        height: of the silhouette, metres.
        pixel_size: metres.
    """

    subject: str
    view: int
    box: tuple[slice, slice]
    height: float
    pixel_size: float

    def size(self, scale: float) -> tuple[int, int]:
        """Width and height of the box at `scale` pixels a metre."""
        rows, columns = (scale * self.pixel_size * (side.stop - side.start) for side in self.box)
        return max(round(columns), 1), max(round(rows), 1)


def _page_size(crops: list[_Crop], scale: float, title: int) -> tuple[int, int]:
    """Width and height where people are drawn at `scale` and no title is wider than `title`."""
    sizes = [crop.size(scale) for crop in crops]
    cell = max(title, *(width for width, _ in sizes)) + 2 * MARGIN
    rows = (LABEL + MARGIN + height + MARGIN for _, height in sizes)
    return len(COLUMNS) * cell, HEADER + sum(rows)


def _crop(dataset: Dataset, subject: str, view: int) -> _Crop:
    shard = dataset.shard(subject)
    index = chosen(shard, view)
    maps = shard.view(index, ["mask", "body_depth_back"])
    if not maps["mask"].any():
        raise ValueError(
            f"{subject} is not seen in view {index}; set --view, or --subjects without it"
        )
    pixel_size = float(shard.meta["camera"]["pixel_size"])
    height = height_of(maps["mask"], pixel_size)
    return _Crop(subject, index, box_of(maps), height, pixel_size)


def _pictures(dataset: Dataset, crop: _Crop, size: tuple[int, int]) -> Iterator[Image.Image]:
    """The columns of one row, each of `size`."""
    maps = dataset.shard(crop.subject).view(crop.view, ["mask", *COLUMNS])
    for name in COLUMNS:
        picture = Image.fromarray(pictured(maps, name, crop.pixel_size)[crop.box])
        yield picture if picture.size == size else picture.resize(size, Image.Resampling.LANCZOS)


def spread(subjects: list[str], limit: int) -> list[str]:
    """At most `limit` of them, evenly from the first to the last."""
    if len(subjects) <= limit:
        return subjects
    return [subjects[round(k)] for k in np.linspace(0, len(subjects) - 1, limit)]


def _asked(folder: Path, named: list[str], limit: int | None) -> list[str]:
    """The subjects that a call asks for; says on stderr if these are not all."""
    if limit is not None and limit < 1:
        raise ValueError(f"--limit is {limit}; give a whole number above 0")
    found = named or Dataset(folder).subjects()
    if not found:
        raise ValueError(f"{folder} holds no finished subject; build it first")
    if limit is None:
        limit = len(named) or LIMIT
    shown = spread(found, limit)
    if len(shown) < len(found):
        sys.stderr.write(
            f"{len(shown)} of {len(found)} subjects, spread evenly; "
            "--subjects names others, --limit N draws more\n"
        )
    return shown


def main() -> int:
    """Write the picture a call asks for; returns the exit status."""
    parser = command.parser(__doc__)
    command.add_picture_options(parser, f"{LIMIT}, spread evenly over the dataset")
    parser.add_argument(
        "--limit",
        type=int,
        metavar="N",
        help=f"draw at most N subjects, spread evenly (default: {LIMIT}, or all that are named)",
    )
    parser.add_argument("--view", type=int, default=0, help="which view (default: 0)")
    options = parser.parse_args()

    def draw(output: Path) -> None:
        subjects = _asked(options.data, options.subjects, options.limit)
        sheet(options.data, subjects, options.view).save(output)

    return command.write(draw, options.output)


if __name__ == "__main__":
    sys.exit(main())
