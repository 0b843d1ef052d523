"""The page of a training: its curves, and what it makes of test views."""

from __future__ import annotations

import json
import math
from html import escape
from pathlib import Path
from typing import Any

from report.page.document import document, embedded, section, table
from storage.files import open_file

HISTORY, PICTURE = "history.jsonl", "test.png"

COLUMNS = (
    "From left to right: colour; normals of the given, the predicted and the true depth; the "
    "error of depth as given and as predicted (white is 20 mm); that of the predicted normals "
    "(white is 45°)"
)
"""Of the picture."""

PLOTS = {
    "loss": ("Losses", "of the training views"),
    "mm": ("Depth on test views", "mean error, mm"),
    "deg": ("Normals on test views", "mean error, degrees"),
    "ratio": ("Errors over those of what was given", "ratio"),
    "time": ("Time of an epoch, and of its test", "seconds"),
    "other": ("Waiting for data", "share of the time"),
}
"""Kind of figure -> title and unit of the plot that it stands in."""


def kind_of(name: str) -> str:
    """Of a figure, by its name: "loss_depth" is a loss, "given_mm" millimetres."""
    if name.startswith("loss_"):
        return "loss"
    last = name.rpartition("_")[2]
    if last == "seconds":
        return "time"
    return last if last in ("mm", "deg", "ratio") else "other"


def is_training(folder: Path) -> bool:
    """Whether a branch was trained in the folder."""
    return (folder / HISTORY).is_file()


def page(folder: Path) -> str:
    """A training's folder as one HTML file.

    Raises:
        ValueError: its history is none, or empty.
    """
    history = _read(folder / HISTORY)
    curves: dict[str, dict[str, list[float | None]]] = {}
    for name in history[-1]:
        curves.setdefault(kind_of(name), {})[name] = [_number(epoch.get(name)) for epoch in history]
    plots = [
        {
            "name": kind,
            "title": PLOTS[kind][0],
            "unit": PLOTS[kind][1],
            "lines": lines,
        }
        for kind, lines in curves.items()
    ]
    places = "".join(
        f'<div class="plot" id="curve-{escape(str(plot["name"]))}" role="img" '
        f'aria-label="{escape(_told(plot))}"></div>'
        for plot in plots
    )
    last = table(
        ("figure", "last epoch", "best"),
        [
            (name, values[-1], _best(name, values))
            for lines in curves.values()
            for name, values in lines.items()
            if values[-1] is not None
        ],
    )
    name = folder.resolve().name
    parts = [
        f"<header><h1>{escape(name)}</h1><p>Epochs: {len(history)}.</p></header><main>",
        section("Curves", "curves", f'<div class="plots">{places}</div>'),
    ]
    if (folder / PICTURE).is_file():
        shown = f"<p>{COLUMNS}.</p>{embedded(folder / PICTURE, f'Test views. {COLUMNS}')}"
        parts.append(section("Test views", "views", shown))
    parts.append(section("Figures", "figures", last) + "</main>")
    return document(f"{name}: report", "\n".join(parts), {"curves-data": plots}, "training.js")


def _best(name: str, values: list[float | None]) -> float | str:
    """Of an error, the least; other figures have no best."""
    known = [value for value in values if value is not None]
    return min(known) if known and name.startswith(("depth", "normal")) else ""


def _number(value: Any) -> float | None:
    """What a curve can be drawn through; a training that diverged has values that are none."""
    return value if isinstance(value, float | int) and math.isfinite(value) else None


def _told(plot: dict[str, Any]) -> str:
    """What a reader sees in a plot, in words: where each line begins and ends."""
    ends = [
        f"{name} from {values[0]:.3g} to {values[-1]:.3g}"
        for name, values in plot["lines"].items()
        if values[0] is not None and values[-1] is not None
    ]
    return f"{plot['title']}, {plot['unit']}: {'; '.join(ends)}"


def _read(path: Path) -> list[dict[str, Any]]:
    """The epochs; a last line that a crash has torn is none."""
    with open_file(path) as file:
        lines = file.read().splitlines()
    history = []
    for number, line in enumerate(lines, start=1):
        try:
            epoch = json.loads(line)
        except ValueError:
            epoch = None
        if isinstance(epoch, dict):
            history.append(epoch)
        elif number < len(lines):
            raise ValueError(f"{path} line {number} is no epoch of a training")
    if not history:
        raise ValueError(f"{path} holds no epoch yet; train on")
    return history
