"""How much the front and the back of a dataset's subjects differ in depth.

python -m report.differences out/demo --output differences.png

The statistics are those of Figure 2 in "Fine Back Surfaces Oriented Human Reconstruction for
Single RGB-D Images": the depth of each point less the largest depth of its surface is its relative
depth, and a pixel's difference is that between the relative depths of its front and its back.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from report import command
from report import view as views
from report.human import pose_of
from shards.dataset import Dataset

BINS = ("0", *(str(upper) for upper in range(10, 101, 10)), ">100")
"""Millimetres: a number stands for (number - 10, number], 0 for itself."""
MUCH = 0.25
"""Share of a subject's pixels above 100 mm from which it counts as much different."""
CHEST = 0.3
"""Where the row runs that is looked at by itself: share of the silhouette's height, from above."""

CALM = (0.5, 0.75)
"""Shares of an easy subject's pixels up to 40 mm that are looked for."""

_DEPTHS = ("mask", "depth_front", "depth_back")
_BLUE, _ORANGE, _GREY = (0, 114, 178), (213, 94, 0), (150, 150, 150)
_INK, _GRID, _PAPER = (40, 40, 40), (225, 225, 225), (255, 255, 255)


@dataclass(frozen=True)
class Statistics:
    """Of the differences between front and back.

    Attributes:
        counts: pixels in each of `BINS`.
        largest: millimetres.
    """

    counts: tuple[int, ...]
    largest: float

    @property
    def pixels(self) -> int:
        """How many pixels there are."""
        return sum(self.counts)

    @property
    def shares(self) -> tuple[float, ...]:
        """Of the pixels in each of `BINS`."""
        return tuple(count / self.pixels for count in self.counts)

    @property
    def up_to_40(self) -> float:
        """Share of the pixels up to 40 mm."""
        return sum(self.counts[: BINS.index("40") + 1]) / self.pixels

    @property
    def above_100(self) -> float:
        """Share of the pixels above 100 mm."""
        return self.counts[-1] / self.pixels


@dataclass(frozen=True)
class Comparison:
    """One subject's front against its back.

    Attributes:
        pose: its name, "-" if it has none.
        hard: whether that is a hard one.
        view: which of the subject's views.
        yaw_deg: its turn.
    """

    subject: str
    pose: str
    hard: bool
    view: int
    yaw_deg: float
    whole: Statistics

    @property
    def easy(self) -> bool:
        """Whether its pose is known, and no hard one."""
        return self.pose != "-" and not self.hard


def differences(
    mask: np.ndarray, depth_front: np.ndarray, depth_back: np.ndarray, left_out: float = 0.0
) -> np.ndarray:
    """(H, W) millimetres between the relative depths of front and back, NaN outside the mask.

    Both depths are given from the front camera's plane, metres. A surface's depth is taken from
    its own camera, though, and the back's looks the other way: what is near to one is far from
    the other, wherever it stands.

    Args:
        left_out: share of a surface's farthest points that do not count for its largest depth,
            which otherwise may be that of a single finger.
    """
    if not mask.any():
        return np.full(mask.shape, np.nan)
    relative = []
    for depth in (depth_front.astype(np.float64), -depth_back.astype(np.float64)):
        largest = np.quantile(depth[mask], 1 - left_out, method="higher")
        relative.append(np.where(mask, depth - largest, np.nan))
    # A micrometre is more than a depth in single precision carries.
    return np.round(1000 * np.abs(relative[0] - relative[1]), 3)


def statistics(millimetres: np.ndarray) -> Statistics:
    """Of differences in any shape; NaN does not count.

    Raises:
        ValueError: there is none.
    """
    found = millimetres[np.isfinite(millimetres)]
    if found.size == 0:
        raise ValueError("there is no pixel with a surface to compare")
    bin_of = np.minimum(np.ceil(found / 10), len(BINS) - 1).astype(np.int64)
    counts = np.bincount(bin_of, minlength=len(BINS))
    return Statistics(tuple(int(n) for n in counts), float(found.max()))


def pooled(parts: Sequence[Statistics]) -> Statistics:
    """All their pixels as one; `parts` is not empty."""
    counts = zip(*(part.counts for part in parts), strict=True)
    return Statistics(tuple(map(sum, counts)), max(part.largest for part in parts))


def compare(dataset: Dataset, view: int | None, left_out: float = 0.0) -> list[Comparison]:
    """Every subject's front against its back; `left_out` as `differences` has it.

    Args:
        view: which of its views; None for the one turned least.

    Raises:
        ValueError: a subject has no such view, or nothing to be seen in it.
    """
    found = []
    for subject in dataset.subjects():
        shard = dataset.shard(subject)
        index = views.chosen(shard, view)
        maps = shard.view(index, [*_DEPTHS, "yaw_deg"])
        if not maps["mask"].any():
            raise ValueError(f"{subject} is not seen in view {index}; set --view")
        pose, hard = pose_of(shard.meta["body_parameters"])
        whole = statistics(_differences(maps, left_out))
        found.append(Comparison(subject, pose, hard, index, float(maps["yaw_deg"]), whole))
    return found


def _differences(maps: dict[str, np.ndarray], left_out: float) -> np.ndarray:
    return differences(maps["mask"], maps["depth_front"], maps["depth_back"], left_out)


def table(comparisons: list[Comparison]) -> str:
    """A line for each subject, and below them the set's; there is one subject or more.

    Hard poses have a *; a subject without a pose is neither easy nor hard.
    """
    easy = [c.whole for c in comparisons if c.easy]
    hard = [c.whole for c in comparisons if c.hard]
    whole = pooled([c.whole for c in comparisons])
    rows = [(c.subject, f"{c.pose}{'*' if c.hard else ''}", c.whole) for c in comparisons]
    totals = [
        (f"{name}, {len(members)}", "", pooled(members))
        for name, members in (("easy poses", easy), ("hard poses*", hard))
        if members
    ]
    totals.append(("all together", "", whole))
    wide = max(len(subject) for subject, _, _ in (*rows, *totals))
    posed = max(len("pose"), *(len(pose) for _, pose, _ in rows))
    head = f"{'subject':{wide}}  {'pose':{posed}}     pixels  <=40 mm  >100 mm   largest"

    def line(name: str, pose: str, s: Statistics) -> str:
        return (
            f"{name:{wide}}  {pose:{posed}}  {s.pixels:9d}  {s.up_to_40:7.2%}  "
            f"{s.above_100:7.2%}  {s.largest:5.0f} mm"
        )

    return "\n".join(
        [
            head,
            "-" * len(head),
            *(line(*row) for row in rows),
            "-" * len(head),
            *(line(*row) for row in totals),
            "",
            "mm    " + "".join(f"{name:>7}" for name in BINS),
            "share " + "".join(f"{share:7.2%}" for share in whole.shares),
            "",
            *_counted(easy, hard, [c.whole for c in comparisons]),
        ]
    )


def _counted(
    easy: list[Statistics], hard: list[Statistics], whole: list[Statistics]
) -> Iterator[str]:
    """How many subjects differ much, and how many of the easy ones little."""

    def counted(count: int, members: list[Statistics], name: str, share: float, what: str) -> str:
        return f"{count} of {len(members)} {name} have {share:.0%} or more of their pixels {what}"

    for name, members in (("subjects", whole), ("hard subjects", hard)):
        if members:
            much = sum(s.above_100 >= MUCH for s in members)
            yield counted(much, members, name, MUCH, "above 100 mm")
    for share in CALM if easy else ():
        calm = sum(s.up_to_40 >= share for s in easy)
        yield counted(calm, easy, "easy subjects", share, "up to 40 mm")


@dataclass(frozen=True, eq=False)
class Example:
    """A subject that the figure shows, and the row that is looked at by itself."""

    comparison: Comparison
    maps: dict[str, np.ndarray]
    row: int
    local: Statistics

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the silhouette, with a margin."""
        rows, columns = (np.flatnonzero(self.maps["mask"].any(axis=axis)) for axis in (1, 0))
        height, width = self.maps["mask"].shape
        return (
            max(int(columns[0]) - 8, 0),
            max(int(rows[0]) - 8, 0),
            min(int(columns[-1]) + 9, width),
            min(int(rows[-1]) + 9, height),
        )


def example(
    dataset: Dataset, comparison: Comparison, height: float, left_out: float = 0.0
) -> Example:
    """The subject with its row at `height`: the share of the silhouette's, from above.

    Raises:
        ValueError: the row meets no surface.
    """
    shard = dataset.shard(comparison.subject)
    maps = shard.view(comparison.view, [*_DEPTHS, "rgb_front", "rgb_back"])
    rows = np.flatnonzero(maps["mask"].any(axis=1))
    row = round(rows[0] + height * (rows[-1] - rows[0]))
    if row not in rows:
        raise ValueError(f"{comparison.subject} has no surface in row {row}; set --rows")
    return Example(comparison, maps, row, statistics(_differences(maps, left_out)[row]))


def figure(easy: Example, hard: Example, whole: Statistics, subjects: int) -> Image.Image:
    """(a) and (b) two subjects, (c) their rows, (d) all of them and of the set."""
    width, margin, gap = 1800, 40, 30
    widths = [2 * _span(shown)[0] for shown in (easy, hard)]
    highest = max(_span(shown)[1] for shown in (easy, hard))
    scale = min((width - 2 * margin - 4 * gap) / sum(widths), 720 / highest)
    band = round(scale * highest)
    chart_top, chart_height = margin + band + 80, 600
    page = Image.new("RGB", (width, chart_top + chart_height + margin // 2), _PAPER)
    draw = ImageDraw.Draw(page)

    shown_pairs = [_pair(easy, _BLUE, scale, gap), _pair(hard, _ORANGE, scale, gap)]
    room = (width - 2 * margin - sum(pair.width for pair in shown_pairs)) // 2
    left = margin + room // 2
    for letter, shown, pair in zip("ab", (easy, hard), shown_pairs, strict=True):
        page.paste(pair, (left, margin + band - pair.height))
        title = f"({letter}) {_name(shown.comparison)}"
        middle = (left + pair.width // 2, margin + band + 14)
        draw.text(middle, title, fill=_INK, font=_font(26), anchor="mt")
        left += pair.width + room
    rows = [("(a)", easy.local, _BLUE), ("(b)", hard.local, _ORANGE)]
    full = [
        ("(a)", easy.comparison.whole, _BLUE),
        ("(b)", hard.comparison.whole, _ORANGE),
        (f"all {subjects} subjects", whole, _GREY),
    ]
    half = (width - 2 * margin - 2 * gap) // 2
    for k, (title, series) in enumerate(
        (("(c) along the marked rows", rows), ("(d) over the whole surfaces", full))
    ):
        left = margin + k * (half + 2 * gap)
        _chart(draw, (left, chart_top, left + half, chart_top + chart_height), title, series)
    return page


def _name(comparison: Comparison) -> str:
    return f"{comparison.subject}, {comparison.pose.replace('_', ' ')}"


def _span(shown: Example) -> tuple[int, int]:
    left, top, right, bottom = shown.box
    return right - left, bottom - top


def _pair(shown: Example, colour: tuple[int, int, int], scale: float, gap: int) -> Image.Image:
    """Front and back on paper, side by side, with the row marked."""
    _, top, _, _ = shown.box
    size = tuple(round(scale * n) for n in _span(shown))
    pair = Image.new("RGB", (2 * size[0] + gap, size[1]), _PAPER)
    for k, name in enumerate(("rgb_front", "rgb_back")):
        inside = shown.maps["mask"][..., None]
        picture = Image.fromarray(np.where(inside, shown.maps[name], 255).astype(np.uint8))
        picture = picture.crop(shown.box).resize((size[0], size[1]), Image.Resampling.LANCZOS)
        pair.paste(picture, (k * (size[0] + gap), 0))
    y = round(scale * (shown.row + 0.5 - top))
    ImageDraw.Draw(pair).rectangle((0, y - 2, pair.width, y + 1), fill=colour)
    return pair


def _chart(
    draw: ImageDraw.ImageDraw,
    box: tuple[int, int, int, int],
    title: str,
    series: list[tuple[str, Statistics, tuple[int, int, int]]],
) -> None:
    """Bars in groups: the share of the pixels in each of `BINS`."""
    left, top, right, bottom = box
    left, top, bottom = left + 78, top + 64 + 30 * 3, bottom - 74
    highest = max(max(s.shares) for _, s, _ in series)
    step = next(s for s in (0.02, 0.05, 0.1, 0.2) if highest / s <= 5 or s == 0.2)
    ceiling = step * np.ceil(highest / step)
    draw.text(((box[0] + right) // 2, box[1]), title, fill=_INK, font=_font(26), anchor="mt")
    for tick in range(round(ceiling / step) + 1):
        y = round(bottom - (bottom - top) * tick * step / ceiling)
        draw.line((left, y, right, y), fill=_INK if tick == 0 else _GRID, width=2)
        label = f"{100 * tick * step:.0f} %"
        draw.text((left - 10, y), label, fill=_INK, font=_font(20), anchor="rm")

    group = (right - left) / len(BINS)
    bar = int(0.84 * group / len(series))
    for k, name in enumerate(BINS):
        middle = left + (k + 0.5) * group
        draw.text((middle, bottom + 10), name, fill=_INK, font=_font(20), anchor="mt")
        start = round(middle - bar * len(series) / 2)
        for n, (_, s, colour) in enumerate(series):
            y = round(bottom - (bottom - top) * s.shares[k] / ceiling)
            if s.shares[k] > 0:
                x = start + n * bar
                draw.rectangle((x + 1, min(y, bottom - 3), x + bar - 1, bottom - 2), fill=colour)
    draw.text(
        ((left + right) // 2, bottom + 44),
        "difference between front and back, mm",
        fill=_INK,
        font=_font(20),
        anchor="mt",
    )
    for n, (name, s, colour) in enumerate(series):
        y = box[1] + 44 + 30 * n
        line = (
            f"{name}: {s.up_to_40:.1%} up to 40 mm, {s.above_100:.1%} above 100 mm, "
            f"largest {s.largest:.0f} mm"
        )
        draw.rectangle((left, y + 6, left + 18, y + 24), fill=colour)
        draw.text((left + 28, y + 15), line, fill=_INK, font=_font(19), anchor="lm")


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)


def main() -> int:
    """Print the table and draw the figure that a call asks for; returns the exit status."""
    parser = command.parser(__doc__)
    views.add_option(parser)
    parser.add_argument("--output", type=Path, help="PNG to write")
    parser.add_argument("--easy", metavar="SUBJECT", help="in the figure (default: the easiest)")
    parser.add_argument("--hard", metavar="SUBJECT", help="in the figure (default: the hardest)")
    parser.add_argument(
        "--rows",
        nargs=2,
        type=float,
        default=(CHEST, CHEST),
        metavar=("EASY", "HARD"),
        help=f"share of each one's height from above that its row is at (default: {CHEST})",
    )
    parser.add_argument(
        "--left-out",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="of a surface's farthest points that its largest depth leaves out (default: 0)",
    )
    options = parser.parse_args()
    try:
        _report(options)
    except (ValueError, OSError) as error:
        return command.refused(error)
    return 0


def _report(options: argparse.Namespace) -> None:
    if not 0 <= options.left_out < 0.5:
        raise ValueError(f"--left-out is {options.left_out:g}; give a share from 0 to below 0.5")
    dataset = Dataset(options.data)
    found = compare(dataset, options.view, options.left_out)
    if not found:
        raise ValueError(f"{options.data} holds no finished subject; build it first")
    print(f"{views.described(options.view, [c.yaw_deg for c in found])}\n\n{table(found)}")
    easiest = max(found, key=lambda c: (c.whole.up_to_40, -c.whole.largest))
    hardest = max(found, key=lambda c: (c.whole.above_100, c.whole.largest))
    chosen = {"easy": easiest, "hard": hardest}
    by_name = {c.subject: c for c in found}
    for option in chosen:
        name = getattr(options, option)
        if name is not None and name not in by_name:
            raise ValueError(f"{options.data} has no finished subject {name!r}; set --{option}")
        chosen[option] = by_name.get(name, chosen[option])
    easy, hard = (
        example(dataset, comparison, height, options.left_out)
        for comparison, height in zip(chosen.values(), options.rows, strict=True)
    )
    print("\nalong one row:")
    for shown in (easy, hard):
        s = shown.local
        print(
            f"{shown.comparison.subject}, row {shown.row}: {s.up_to_40:.2%} up to 40 mm, "
            f"{s.above_100:.2%} above 100 mm, largest {s.largest:.0f} mm"
        )
    if options.output is not None:
        whole = pooled([c.whole for c in found])
        figure(easy, hard, whole, len(found)).save(options.output)
        print(f"\n{options.output}")


if __name__ == "__main__":
    sys.exit(main())
