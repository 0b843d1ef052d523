"""A contact sheet of a dataset's subjects: each from the front, and from behind beside it.

python -m report.people out/people --output people.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from report import command
from report import view as views
from shards.dataset import Dataset

PAPER = 250
GAP = 6
"""Pixels between a subject's front and back."""
BETWEEN = 22
"""Pixels between subjects, at least."""


def contact_sheet(
    folder: Path, subjects: list[str], view: int | None, width: int, maps: str
) -> Image.Image:
    """As many subjects to a row as fit, at one scale, standing on one line.

    Args:
        subjects: ids; all of the dataset if empty.
        view: which view of each; None for the one turned least.
        width: of the page in pixels; a subject that is wider widens it.
        maps: rgb or normal.

    Raises:
        ValueError: the dataset has no such subject or view, one is not seen in it, or
            there are no subjects.
    """
    dataset = Dataset(folder)
    pairs = []
    for subject in subjects or dataset.subjects():
        shard = dataset.shard(subject)
        index = views.chosen(shard, view)
        names = ["mask", f"{maps}_front", f"{maps}_back"]
        mask, front, back = shard.view(index, names).values()
        if not mask.any():
            raise ValueError(
                f"{subject} is not seen in view {index}; set --view, or --subjects without it"
            )
        pairs.append(_pair(mask, front, back))
    if not pairs:
        raise ValueError(f"{folder} holds no finished subject; build it first")
    width = max(width, *(pair.shape[1] + 2 * BETWEEN for pair in pairs))
    rows: list[list[np.ndarray]] = [[]]
    for pair in pairs:
        if sum(p.shape[1] + BETWEEN for p in [*rows[-1], pair]) + BETWEEN > width:
            rows.append([])
        rows[-1].append(pair)
    return Image.fromarray(np.concatenate([_row(row, width) for row in rows]))


def _pair(mask: np.ndarray, front: np.ndarray, back: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8: front, and back as one sees it who stands behind."""
    inside_rows, inside_columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    box = (
        slice(inside_rows[0], inside_rows[-1] + 1),
        slice(inside_columns[0], inside_columns[-1] + 1),
    )
    sides = []
    for image, towards in ((front, 1), (back, -1)):
        if image.dtype != np.uint8:
            image = np.rint((image.astype(np.float32) * [1, 1, towards] + 1) * 127.5)
        sides.append(np.where(mask[..., None], image, PAPER).astype(np.uint8)[box])
    gap = np.full((sides[0].shape[0], GAP, 3), PAPER, dtype=np.uint8)
    # In the shard the back is in the front's grid; turned over, it is what one sees from behind.
    return np.concatenate([sides[0], gap, sides[1][:, ::-1]], axis=1)


def _row(pairs: list[np.ndarray], width: int) -> np.ndarray:
    """One row of the page, its subjects spread evenly."""
    height = max(pair.shape[0] for pair in pairs) + BETWEEN
    page = np.full((height, width, 3), PAPER, dtype=np.uint8)
    free = width - sum(pair.shape[1] for pair in pairs)
    left = 0
    for i, pair in enumerate(pairs):
        at = left + round((i + 1) * free / (len(pairs) + 1))
        page[height - pair.shape[0] :, at : at + pair.shape[1]] = pair
        left += pair.shape[1]
    return page


def main() -> int:
    """Write the sheet a call asks for; returns the exit status."""
    parser = command.parser(__doc__)
    command.add_picture_options(parser)
    views.add_option(parser)
    parser.add_argument("--width", type=int, default=2000, help="pixels (default: 2000)")
    parser.add_argument("--maps", choices=("rgb", "normal"), default="rgb", help="(default: rgb)")
    options = parser.parse_args()

    def draw(output: Path) -> None:
        o = options
        contact_sheet(o.data, o.subjects, o.view, o.width, o.maps).save(output)

    return command.write(draw, options.output)


if __name__ == "__main__":
    sys.exit(main())
