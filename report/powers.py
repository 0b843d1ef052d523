"""One head under the powers of a light sweep: as photographed, and brightened to the strongest.

    python -m report.powers out/sweep --output docs/light_sweep.png

Every pixel of a shard is a square of the picture, so that its noise can be seen. The charts below
are of the same pixels.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt

from augment.light import LightConfig, expose
from augment.photograph import develop
from augment.srgb import linear
from report import command
from report import view as views
from shards.archive import Shard
from shards.dataset import Dataset
from shards.schema import RADIANCE_WATTS
from shards.sweep import read_index

SIDE = 0.34
"""Metres of a tile's side."""
WITHIN = 0.06
"""Radius in metres of a disc that fits into a head, and into no hand and no forearm."""
ABOVE = 0.07
"""Metres of a tile above the crown of the body's head; hair and hats stand there."""

COLUMNS = 5
PARTS = (1, 1 / 2, 1 / 4, 1 / 10, 1 / 20)
"""Of the strongest power: which are shown brightened, as near as the sweep has them."""
LARGEST_TILE = 280
"""Pixels; tiles are enlarged as far as that."""
PAPER = 250
MARGIN, GAP, LABEL, TITLE, CHART = 16, 10, 22, 40, 300
"""Pixels: around the page, between tiles, of the lines above tiles and parts, of the charts."""

_INK, _GREY = (40, 40, 40), (110, 110, 110)


@dataclass(frozen=True, eq=False)
class Photographs:
    """One head under every power, strongest first.

    Attributes:
        caption: whose, which view, and the exposure.
        seen: (h, w) bool, the pixels of the subject.
        colors: watts -> (h, w, 3) uint8 sRGB.
        light: watts -> (h, w, 3) the linear light without noise, NaN where it is not known; None
            if the sweep has no camera's noise, or the light cannot be told from it.
    """

    caption: str
    seen: np.ndarray
    colors: dict[float, np.ndarray]
    light: dict[float, np.ndarray] | None


def read(folder: Path, subject: str | None, view: int | None, back: bool) -> Photographs:
    """Cut one head out of every dataset of a sweep.

    Args:
        folder: of the sweep.
        subject: its id; None for the first.
        view: which of its views; None for the one turned least.
        back: from behind, turned over to what one sees who stands there.

    Raises:
        ValueError: the folder holds no sweep, there is no such subject or view, or no head in it.
    """
    datasets = {power: Dataset(of_power) for power, of_power in read_index(folder).items()}
    if subject is None:
        subjects = [name for dataset in datasets.values() for name in dataset.subjects()]
        if not subjects:
            raise ValueError(f"{folder} holds no finished subject; run the sweep again")
        subject = min(subjects)
    shards = {power: dataset.shard(subject) for power, dataset in datasets.items()}
    shard = next(iter(shards.values()))
    index = views.chosen(shard, view)
    mask, body, yaw = shard.view(index, ["mask", "body_depth_front", "yaw_deg"]).values()
    silhouette = body > 0 if (body > 0).any() else mask
    box = head_box(silhouette, float(shard.meta["camera"]["pixel_size"]))
    if box is None or not _cut(mask, box).any():
        raise ValueError(f"{subject} shows no head in view {index}; set --view or --subject")
    side, turned = ("back", -1) if back else ("front", 1)
    name = f"rgb_{side}"
    radiance = _radiance(shard, index, side)
    light = None
    if radiance is not None:
        per_watt = _cut(radiance, box)[:, ::turned]
        light = {p: expose(per_watt, LightConfig(**s.meta["light"])) for p, s in shards.items()}
    return Photographs(
        f"{subject}{' from behind' if back else ''}, {views.described(view, [float(yaw)])}; "
        f"exposure {shard.meta['light']['exposure']:g} for all",
        _cut(mask, box)[:, ::turned],
        {p: _cut(s.view(index, [name])[name], box)[:, ::turned] for p, s in shards.items()},
        light,
    )


def head_box(silhouette: np.ndarray, pixel_size: float) -> tuple[int, int, int] | None:
    """Where the head is: left, top and side of a square, pixels; it may leave the image.

    The head is the highest place of the silhouette where a disc of radius `WITHIN` fits: raised
    hands and forearms are slimmer, wherever they are. Two hands that touch above a head are not,
    nor is an arm that hides it; of one who lies or is bent below the hips another part is highest.

    Args:
        silhouette: (H, W) bool, of the bare body if there is one.
        pixel_size: metres.

    Returns:
        None if the disc fits nowhere.
    """
    # From a pixel's centre to that of the nearest without a surface; beyond the image is none.
    depth = distance_transform_edt(np.pad(silhouette, 1))[1:-1, 1:-1] * pixel_size
    rows, columns = np.nonzero(depth >= WITHIN)
    if not rows.size:
        return None
    middle = np.median(columns[rows == rows[0]]) + 0.5
    crown = rows[0] + 1 - WITHIN / pixel_size
    side = max(round(SIDE / pixel_size), 1)
    return round(middle - side / 2), round(crown - ABOVE / pixel_size), side


def brightened(colors: np.ndarray, factor: float) -> np.ndarray:
    """sRGB bytes with `factor` times the linear light, clipped."""
    return develop(factor * linear(colors / 255))


def signal_to_noise(colors: np.ndarray, light: np.ndarray) -> float:
    """Mean light over the root mean square of what the colours are off, both linear; decibels.

    Args:
        colors: uint8 sRGB of an image with noise; its rounding to bytes counts as noise.
        light: the same image's linear light without.

    Returns:
        NaN where there are no colours, no light, or no noise.
    """
    if not colors.size:
        return math.nan
    signal, noise = float(light.mean()), math.sqrt(np.mean((linear(colors / 255) - light) ** 2))
    return 20 * math.log10(signal / noise) if signal and noise else math.nan


def handful(powers: list[float]) -> list[float]:
    """Those nearest, as ratios, to `PARTS` of the strongest; each once, strongest first."""
    strongest = max(powers)
    near = {min(powers, key=lambda p: abs(math.log(p / (strongest * part)))) for part in PARTS}
    return sorted(near, reverse=True)


def figure(photographs: Photographs) -> Image.Image:
    """(a) every power, (b) a handful twice: as photographed, brightened below; (c) charts."""
    powers = list(photographs.colors)
    strongest, few = powers[0], handful(powers)
    rows = math.ceil(len(powers) / COLUMNS)
    tile = len(photographs.seen)
    tile *= max(LARGEST_TILE // tile, 1)
    line = LABEL + tile + GAP
    width = 2 * MARGIN + COLUMNS * (tile + GAP) - GAP
    pairs = MARGIN + TITLE + rows * line
    charts = pairs + TITLE + 2 * line
    page = Image.new("RGB", (width, charts + TITLE + CHART), (PAPER, PAPER, PAPER))
    draw = ImageDraw.Draw(page)

    def put(k: int, top: int, colors: np.ndarray, label: str) -> None:
        left = MARGIN + k * (tile + GAP)
        draw.text((left, top + LABEL - 5), label, fill=_INK, font=_font(14), anchor="ls")
        shown = np.where(photographs.seen[..., None], colors, PAPER).astype(np.uint8)
        whole = Image.fromarray(shown).resize((tile, tile), Image.Resampling.NEAREST)
        page.paste(whole, (left, top + LABEL))

    def title(top: int, words: str, more: str) -> None:
        middle = top + TITLE // 2
        draw.text((MARGIN, middle), words, fill=_INK, font=_font(18), anchor="lm")
        after = MARGIN + draw.textlength(words, font=_font(18)) + 12
        draw.text((after, middle), more, fill=_GREY, font=_font(14), anchor="lm")

    title(MARGIN, "(a) as photographed", photographs.caption)
    for k, (power, colors) in enumerate(photographs.colors.items()):
        top = MARGIN + TITLE + k // COLUMNS * line
        put(k % COLUMNS, top, colors, f"{power:g} W")
    title(
        pairs, "(b) the noise of weak light", f"below: its linear light scaled to {strongest:g} W"
    )
    for k, power in enumerate(few):
        colors, factor = photographs.colors[power], strongest / power
        put(k, pairs + TITLE, colors, f"{power:g} W")
        again = brightened(colors, factor)
        put(k, pairs + TITLE + line, again, f"{power:g} W, light x {factor:.3g}")
    title(charts, "(c) the same pixels measured", "hair and clothes included")
    page.paste(_charts(photographs, width), (0, charts + TITLE))
    return page


def _radiance(shard: Shard, view: int, side: str) -> np.ndarray | None:
    """(H, W, 3) light per watt without noise, NaN where it saturated; None if it is not known."""
    if shard.meta.get("color_camera") is None:
        return None
    kept = f"radiance_{side}"
    if kept in shard:
        return shard.view(view, [kept])[kept].astype(np.float32) / np.float32(RADIANCE_WATTS)
    base = shard.base
    if base is None or base.meta.get("color_camera") is not None:
        return None
    # The base's colours have no noise, and are off by half a byte at the most.
    name = f"rgb_{side}"
    colors = base.view(view, [name])[name]
    lamp = base.meta["light"]
    light = linear(colors / 255) / (lamp["power"] * lamp["exposure"])
    return np.where(colors < 255, light, np.nan).astype(np.float32)


def _cut(image: np.ndarray, box: tuple[int, int, int]) -> np.ndarray:
    """The square of a map, 0 beyond the map's edges."""
    left, top, side = box
    beyond = ((side, side), (side, side), (0, 0))[: image.ndim]
    return np.pad(image, beyond)[top + side : top + 2 * side, left + side : left + 2 * side]


def _charts(photographs: Photographs, width: int) -> Image.Image:
    """Brightness and, if the light without noise is known, signal to noise by the power."""
    powers = list(photographs.colors)
    seen = photographs.seen
    means = [colors[seen].mean() for colors in photographs.colors.values()]
    curves = {"mean sRGB value, 0 to 255": means}
    if photographs.light is not None:
        # Clipped light has no noise; what the strongest lamp clips counts nowhere.
        sound = seen[..., None] & (photographs.light[powers[0]] < 1)
        curves["signal-to-noise ratio, dB"] = [
            signal_to_noise(photographs.colors[power][sound], photographs.light[power][sound])
            for power in powers
        ]
    with mpl.rc_context({"font.size": 10}):
        whole = Figure(figsize=(width / 100, CHART / 100), dpi=100, layout="constrained")
        whole.set_facecolor([PAPER / 255] * 3)
        for k, (axes, (name, values)) in enumerate(
            zip(whole.subplots(1, len(curves), squeeze=False)[0], curves.items(), strict=True)
        ):
            axes.plot(powers, values, ".-", color=f"C{k}", linewidth=1, markersize=8)
            axes.set(xlabel="power of the point light, W", ylabel=name, facecolor="none")
            axes.set_xlim(1.03 * powers[0], 0)
            axes.set_ylim(0, 1.1 * np.nanmax(values) if np.isfinite(values).any() else 1)
            axes.grid(color="0.9")
            axes.spines[["top", "right"]].set_visible(False)
        canvas = FigureCanvasAgg(whole)
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _font(size: int) -> ImageFont.FreeTypeFont:
    """That of the charts."""
    return ImageFont.truetype(findfont("DejaVu Sans"), size)


def main() -> int:
    """Write the picture a call asks for; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sweep", type=Path, help="folder of the light sweep")
    parser.add_argument("--output", type=Path, required=True, help="PNG to write")
    parser.add_argument("--subject", help="whose head (default: the first)")
    parser.add_argument("--view", type=int, help="which view (default: the one turned least)")
    parser.add_argument("--back", action="store_true", help="from behind")
    options = parser.parse_args()

    def draw(output: Path) -> None:
        figure(read(options.sweep, options.subject, options.view, options.back)).save(output)

    return command.write(draw, options.output)


if __name__ == "__main__":
    sys.exit(main())
