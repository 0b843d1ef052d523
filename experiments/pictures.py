"""What the figures are drawn from: surfaces as images, and pages of them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from shards.raycast import Surface
from storage.atomic import atomic_write
from surface.cloud import lines_of_sight
from surface.distances import nearest
from surface.mesh import TriangleMesh
from surface.normal_maps import around, castable, normal_map

SIZE = 420
"""Pixels of an image's side."""

HEAD = 0.8
"""Inches above the images of a page."""

_LIGHT = np.array([0.3, 0.4, 0.85]) / np.linalg.norm([0.3, 0.4, 0.85])
_MARGIN = 1.04


def centered(mesh: TriangleMesh, like: TriangleMesh) -> tuple[TriangleMesh, float]:
    """A mesh round the origin, moved as another one is to come there, and half a window's side."""
    low, high = like.bounds
    place = np.eye(4)
    place[:3, 3] = -(low + high) / 2
    return mesh.transformed(place), float((high - low).max()) / 2 * _MARGIN


def shaded(surface: Surface, angle_deg: float, half: float, size: int = SIZE) -> np.ndarray:
    """(size, size, 3) uint8: grey clay under a lamp beside the camera, on white."""
    normals, hit = normal_map(surface, angle_deg, half, size)
    light = 0.25 + 0.75 * np.clip(normals @ _LIGHT, 0, 1)
    return _image(np.where(hit, light, 1)[..., None].repeat(3, axis=2))


def error_map(
    mesh: TriangleMesh, truth: TriangleMesh, angle_deg: float, half: float, most: float
) -> tuple[np.ndarray, np.ndarray]:
    """How far what is seen of a mesh is from the truth.

    Args:
        mesh, truth: round the origin, metres.
        most: metres at which the colours end.

    Returns:
        (SIZE, SIZE, 3) uint8 on white, and the distances of the pixels hit, metres.
    """
    camera = around(angle_deg)
    x, y = lines_of_sight((SIZE, SIZE), 2 * half / SIZE)
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    hits = castable(mesh).cast(xy, camera, -1)
    points = np.column_stack([xy, hits.z])[hits.hit] @ camera[:3, :3].T
    off, _ = nearest(points, truth)
    image = np.ones((SIZE * SIZE, 3))
    image[hits.hit] = colormaps["viridis"](np.clip(off / most, 0, 1))[:, :3]
    return _image(image.reshape(SIZE, SIZE, 3)), off


def cut_out(rgb: np.ndarray, mask: np.ndarray, half_pixels: int) -> np.ndarray:
    """(SIZE, SIZE, 3) uint8: a view's person on white, in a square of twice `half_pixels`."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    middle = (rows[0] + rows[-1]) // 2, (columns[0] + columns[-1]) // 2
    white = np.where(mask[..., None], rgb, 255).astype(np.uint8)
    padded = np.pad(white, ((half_pixels,) * 2, (half_pixels,) * 2, (0, 0)), constant_values=255)
    square = padded[
        middle[0] : middle[0] + 2 * half_pixels, middle[1] : middle[1] + 2 * half_pixels
    ]
    return np.asarray(Image.fromarray(square).resize((SIZE, SIZE), Image.Resampling.LANCZOS))


def page(
    rows: Sequence[Sequence[np.ndarray | None]],
    columns: Sequence[str],
    names: Sequence[str],
    title: str,
    scale: tuple[str, float] | None = None,
) -> Figure:
    """Images in rows and columns with their names; `scale` is a colour bar's text and its end.

    White that all images of a column share at their sides is cut off.
    """
    rows, widths = _trimmed(rows)
    tall, unit, left, foot = 2.2, 2.2 / SIZE, 1.5, 0.6 if scale else 0.05
    width, height = left + unit * sum(widths) + 0.1, tall * len(rows) + HEAD + foot
    figure = Figure(figsize=(width, height), dpi=110)
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(
        len(rows), len(columns), squeeze=False, gridspec_kw={"width_ratios": widths}
    )
    for row, images, name in zip(axes, rows, names, strict=True):
        for axis, image in zip(row, images, strict=True):
            axis.set_axis_off()
            if image is not None:
                axis.imshow(image)
        row[0].annotate(
            textwrap.fill(name, 18),
            (0.1 / width, 0.5),
            xycoords=("figure fraction", "axes fraction"),
            fontsize=8,
            va="center",
        )
    for axis, column in zip(axes[0], columns, strict=True):
        axis.set_title(column, fontsize=8)
    figure.subplots_adjust(
        left=left / width,
        right=1 - 0.1 / width,
        top=1 - HEAD / height,
        bottom=foot / height,
        wspace=0,
        hspace=0.03,
    )
    if scale is not None:
        bar = figure.add_axes((0.35, 0.35 / height, 0.4, 0.1 / height))
        figure.colorbar(
            ScalarMappable(Normalize(0, scale[1]), "viridis"), cax=bar, orientation="horizontal"
        )
        bar.tick_params(labelsize=7)
        figure.text(0.34, 0.4 / height, scale[0], fontsize=8, ha="right", va="center")
    return figure


def _trimmed(
    rows: Sequence[Sequence[np.ndarray | None]],
) -> tuple[list[list[np.ndarray | None]], list[int]]:
    """The images less their columns' white sides, and what is left of the columns' widths."""
    kept: list[list[np.ndarray | None]] = [[] for _ in rows]
    widths = []
    for images in zip(*rows, strict=True):
        there = [image for image in images if image is not None]
        used = np.flatnonzero(np.any([(i < 250).any(axis=(0, 2)) for i in there], axis=0))
        first, last = (int(used[0]), int(used[-1])) if len(used) else (0, SIZE - 1)
        side = slice(max(first - 12, 0), last + 13)
        widths.append(min(last + 13, SIZE) - side.start)
        for row, image in zip(kept, images, strict=True):
            row.append(None if image is None else image[:, side])
    return kept, widths


def save(figure: Figure, path: Path) -> None:
    """As a PNG, whole or not at all."""
    canvas = FigureCanvasAgg(figure)
    with atomic_write(path) as file:
        canvas.print_png(file)


def _image(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * values.clip(0, 1)).astype(np.uint8)
