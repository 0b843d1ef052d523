"""A picture of a dataset: one row a subject, one column a map.

python -m report.sheet out/demo --output sheet.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from report import command
from report.view import chosen
from shards.dataset import Dataset

COLUMNS = {
    "rgb_front": "RGB front",
    "rgb_back": "RGB back",
    "depth_front": "depth front",
    "depth_back": "depth back",
    "normal_front": "normals front",
    "normal_back": "normals back",
    "depth_sensor": "sensor depth, shaded",
    "body_depth_back": "body, back",
}
PAPER = 250
MARGIN = 8


def sheet(folder: Path, subjects: list[str], view: int) -> Image.Image:
    """One row for each subject: the maps of one view, cropped to the silhouettes together.

    Raises:
        ValueError: the dataset has no such subject or view.
    """
    dataset = Dataset(folder)
    rows, pixels = [], []
    for subject in subjects or dataset.subjects():
        shard = dataset.shard(subject)
        rows.append(shard.view(chosen(shard, view)))
        pixels.append(shard.meta["camera"]["pixel_size"])
    top, bottom, left, right = _common_box([row["mask"] for row in rows])
    cells = [
        np.concatenate(
            [_picture(row, name, pixel)[top:bottom, left:right] for name in COLUMNS], axis=1
        )
        for row, pixel in zip(rows, pixels, strict=True)
    ]
    return _titled(np.concatenate(cells, axis=0), right - left)


def _common_box(masks: list[np.ndarray]) -> tuple[int, int, int, int]:
    mask = np.logical_or.reduce(masks)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    height, width = mask.shape
    return (
        max(rows[0] - MARGIN, 0),
        min(rows[-1] + 1 + MARGIN, height),
        max(columns[0] - MARGIN, 0),
        min(columns[-1] + 1 + MARGIN, width),
    )


def _picture(view: dict[str, np.ndarray], name: str, pixel_size: float) -> np.ndarray:
    """(H, W, 3) uint8 of one map, paper where there is no surface."""
    array = view[name]
    if name.startswith("normal"):
        # z towards the viewer of each side reads blue in both.
        shown = array.astype(np.float32) * [1, 1, -1 if name.endswith("back") else 1]
        image = np.rint((shown + 1) * 127.5)
        inside = view["mask"]
    elif name == "depth_sensor":
        inside = array > 0
        image = np.repeat(_relief(array, inside, pixel_size)[..., None], 3, axis=-1)
    elif "depth" in name:
        inside = array > 0
        near, far = _depth_range(view)
        share = np.clip((far - array) / (far - near), 0, 1)
        # Near is bright from the front; from the back, what is far from the front camera is near.
        share = 1 - share if name.endswith("back") else share
        image = np.repeat((20 + 215 * share)[..., None], 3, axis=-1)
    else:
        image, inside = array, view["mask"]
    return np.where(inside[..., None], image, PAPER).astype(np.uint8)


def _relief(depth: np.ndarray, inside: np.ndarray, pixel_size: float) -> np.ndarray:
    """(H, W) grey of a depth map lit from the upper left: noise of a millimetre shows."""
    down, right = np.gradient(np.where(inside, depth, np.nan), pixel_size)
    # The surface's normal is (dz/dx, dz/dy, 1) of the depth, y upwards; the light is (-1, 1, 2).
    lit = (-right - down + 2) / np.sqrt(6 * (right**2 + down**2 + 1))
    return 235 * np.clip(np.nan_to_num(lit, nan=0.0), 0, 1)


def _depth_range(view: dict[str, np.ndarray]) -> tuple[float, float]:
    mask = view["mask"]
    return float(view["depth_front"][mask].min()), float(view["depth_back"][mask].max())


def _titled(cells: np.ndarray, width: int) -> Image.Image:
    header = 24
    page = np.full((cells.shape[0] + header, cells.shape[1], 3), PAPER, dtype=np.uint8)
    page[header:] = cells
    image = Image.fromarray(page)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=14)
    for i, title in enumerate(COLUMNS.values()):
        draw.text((i * width + width // 2, 5), title, fill=(40, 40, 40), font=font, anchor="mt")
    return image


def main() -> int:
    """Write the picture a call asks for; returns the exit status."""
    parser = command.parser(__doc__)
    command.add_picture_options(parser)
    parser.add_argument("--view", type=int, default=0, help="which view (default: 0)")
    options = parser.parse_args()
    try:
        sheet(options.data, options.subjects, options.view).save(options.output)
    except (ValueError, OSError) as error:
        return command.refused(error)
    print(options.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
