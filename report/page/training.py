"""The page of a training: its curves, and what it makes of test views."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

from report.page.document import document, embedded, section, table
from storage.files import open_file

HISTORY, PICTURE = "history.jsonl", "test.png"

PLOTS = {
    "loss": ("Losses", "of the training views"),
    "mm": ("Depth on test views", "mean error, mm"),
    "deg": ("Normals on test views", "mean error, degrees"),
    "ratio": ("Errors over those of what was given", "ratio"),
    "time": ("Time", "seconds, or the share that waited for data"),
}
"""Kind of figure -> title and unit of the plot that it stands in."""


def kind_of(name: str) -> str:
    """Of a figure, by its name: "loss_depth" is a loss, "given_mm" millimetres."""
    if name.startswith("loss_"):
        return "loss"
    last = name.rpartition("_")[2]
    return last if last in ("mm", "deg", "ratio") else "time"


def is_training(folder: Path) -> bool:
    """Whether a branch was trained in the folder."""
    return (folder / HISTORY).is_file()


def page(folder: Path) -> str:
    """A training's folder as one HTML file.

    Raises:
        ValueError: its history is none.
    """
    history = _read(folder / HISTORY)
    curves: dict[str, dict[str, list[float | None]]] = {}
    for name in history[-1]:
        curves.setdefault(kind_of(name), {})[name] = [epoch.get(name) for epoch in history]
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
        f'aria-label="{escape(str(plot["title"]))} over {len(history)} epochs"></div>'
        for plot in plots
    )
    last = table(
        ("figure", "last epoch", "best"),
        [
            (name, value, _best(name, [epoch.get(name) for epoch in history]))
            for name, value in history[-1].items()
            if isinstance(value, float | int)
        ],
    )
    name = folder.resolve().name
    parts = [
        f"<header><h1>{escape(name)}</h1><p>{len(history)} epochs.</p></header><main>",
        section("Curves", "curves", f'<div class="plots">{places}</div>'),
    ]
    if (folder / PICTURE).is_file():
        shown = embedded(folder / PICTURE, "Test views: what was given, predicted and true")
        parts.append(section("Test views", "views", shown))
    parts.append(section("Figures", "figures", last) + "</main>")
    return document(f"{name}: report", "\n".join(parts), {"curves-data": plots}, "training.js")


def _best(name: str, values: list[float | None]) -> float | str:
    """Of an error, the least; other figures have no best."""
    known = [value for value in values if value is not None]
    return min(known) if known and name.startswith(("depth", "normal")) else ""


def _read(path: Path) -> list[dict[str, Any]]:
    with open_file(path) as file:
        lines = file.read().splitlines()
    try:
        history = [json.loads(line) for line in lines]
    except ValueError as error:
        raise ValueError(f"{path} is no training's history ({error})") from error
    if not history or not all(isinstance(epoch, dict) for epoch in history):
        raise ValueError(f"{path} holds no epoch yet; train on")
    return history
