"""The page of an experiment's folder: every table and figure that it has made."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path

from markdown_it import MarkdownIt

from report.page.document import document, embedded, section
from storage.files import open_file

STUDY, RESULTS = "study.json", "results"


def is_experiment(folder: Path) -> bool:
    """Whether experiments were run in the folder."""
    return (folder / STUDY).is_file()


def page(folder: Path) -> str:
    """An experiment's folder as one HTML file.

    Raises:
        ValueError: it has no result yet.
    """
    results = folder / RESULTS
    names = sorted({path.stem for path in results.glob("*.json")}) if results.is_dir() else []
    if not names:
        raise ValueError(f"{folder} has no result yet; run an experiment in it")
    with open_file(folder / STUDY) as file:
        study = json.loads(file.read())
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
    parts = []
    table, picture = results / f"{name}.md", results / f"{name}.png"
    if table.is_file():
        with open_file(table) as file:
            text = file.read().decode(errors="replace")
        html = MarkdownIt("js-default").render(text)
        parts.append(f'<div class="wide">{html}</div>')
    if picture.is_file():
        parts.append(embedded(picture, f"Figure {name}"))
    with open_file(results / f"{name}.json") as file:
        told = json.dumps(json.loads(file.read()), indent=2)
    parts.append(f"<details><summary>All figures</summary><pre>{escape(told)}</pre></details>")
    return "\n".join(parts)
