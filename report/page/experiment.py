"""The page of an experiment's folder: every table and figure that it has made."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

from report.page.document import document, embedded, section
from storage.files import open_file

STUDY, RESULTS = "study.json", "results"

CAPTIONS = {
    "fig2": "how much fronts and backs differ in depth",
    "table1": "distances of all methods' surfaces, and their normals",
    "table2": "normals of all methods' surfaces, from the front and from behind",
    "table3": "three ways to take the noise from a front, each with the same back",
    "table4": "three ways to a back, each with the same front",
    "fig9": "where the methods' surfaces are off, from the front and from behind",
    "fig13": "one subject's surfaces under five powers of the lamp",
    "fig14": "all measurements under twenty powers of the lamp",
    "fig15": "an arm before the trunk, cut free of it and not",
}
"""Of the results, by their names."""


def is_experiment(folder: Path) -> bool:
    """Whether experiments were run in the folder."""
    return (folder / STUDY).is_file()


def page(folder: Path) -> str:
    """An experiment's folder as one HTML file.

    Raises:
        ValueError: it has no result yet, or a torn one.
    """
    results = folder / RESULTS
    names = sorted({path.stem for path in results.glob("*.json")}) if results.is_dir() else []
    if not names:
        raise ValueError(f"{folder} has no result yet; run an experiment in it")
    study = _json(folder / STUDY)
    name = folder.resolve().name
    parts = [f"<header><h1>{escape(name)}</h1>", _contents(names), "</header><main>"]
    parts += [section(one, one, _result(results, one)) for one in names]
    told = escape(json.dumps(study, indent=2))
    parts.append(section("Configuration", "configuration", f"<pre>{told}</pre>") + "</main>")
    return document(f"{name}: report", "\n".join(parts))


def _contents(names: list[str]) -> str:
    links = " ".join(f'<a href="#{escape(name)}">{escape(name)}</a>' for name in names)
    return f'<nav aria-label="Parts of this page">{links}</nav>'


def _result(results: Path, name: str) -> str:
    parts = [f"<p>{escape(CAPTIONS[name].capitalize())}.</p>"] if name in CAPTIONS else []
    table, picture = results / f"{name}.md", results / f"{name}.png"
    if table.is_file():
        with open_file(table) as file:
            text = file.read().decode(errors="replace")
        html = MarkdownIt("js-default").render(text)
        parts.append(f'<div class="wide">{html}</div>')
    if picture.is_file():
        parts.append(embedded(picture, f"{name}: {CAPTIONS.get(name, 'a figure')}"))
    told = json.dumps(_json(results / f"{name}.json"), indent=2)
    parts.append(f"<details><summary>All figures</summary><pre>{escape(told)}</pre></details>")
    return "\n".join(parts)


def _json(path: Path) -> Any:
    with open_file(path) as file:
        try:
            return json.loads(file.read())
        except ValueError as error:
            raise ValueError(
                f"{path} is torn ({error}); delete it and run the experiment again"
            ) from error
