"""The page of a dataset: what it holds, what it looks like, what its proof found, what failed."""

from __future__ import annotations

import json
import math
from collections import Counter
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from report.maps import TITLES
from report.page.document import document, section, table
from report.page.failures import failure_section
from report.page.gallery import DIALOG, cards, gallery_section
from report.page.histograms import Histograms
from report.page.proof import proof_section
from report.page.reading import each, one_line
from report.page.shown import Fineness, shown
from shards.archive import ShardError
from shards.dataset import SUBJECTS, Dataset
from shards.proof import read_proof
from storage.files import open_file


def page(folder: Path, view: int | None, jobs: int) -> str:
    """A dataset as one HTML file.

    Args:
        folder: the dataset's, or that of its mirror.
        view: which of each subject's views is shown; None for the one turned least.
        jobs: processes that read shards.

    Raises:
        DatasetError: the folder holds no dataset.
        ValueError: a subject has no such view.
    """
    dataset = Dataset(folder)
    paths = {subject: dataset.shard_path(subject) for subject in dataset.manifest}
    fineness = Fineness.of(len(paths), _rows(dataset))
    read = partial(_tried, view=view, fineness=fineness)
    tried = dict(zip(paths, each(read, paths.values(), jobs), strict=True))
    found = {subject: one for subject, one in tried.items() if "reason" not in one}
    counts = {subject: one.pop("counts") for subject, one in found.items()}
    faults = {subject: one["reason"] for subject, one in tried.items() if "reason" in one}
    proof = read_proof(dataset)
    name = Path(dataset.place).name or dataset.place
    histograms = Histograms.of(list(counts.values())) if counts else None
    subjects = cards(dataset, faults, proof)
    index = {
        "words": TITLES,
        "subjects": subjects,
        "histograms": [] if histograms is None else [one.record() for one in histograms.plots],
    }
    order = {subject: k for k, subject in enumerate(paths)}
    records = {f"subject-{order[subject]}": one for subject, one in found.items()}
    sections = {
        "summary": _summary(dataset, list(found.values())),
        "proof": proof_section(dataset, proof),
        "gallery": gallery_section(subjects),
        "histograms": "<p>There is no subject to measure.</p>"
        if histograms is None
        else histograms.section(),
        "failures": failure_section(
            ("subject", "", "reason"),
            [(one["id"], one["what"], one["reason"]) for one in subjects if "reason" in one],
        ),
    }
    links = " ".join(f'<a href="#{name}">{name}</a>' for name in sections)
    parts = [
        f"<header><h1>{escape(name)}</h1>",
        f'<nav aria-label="Parts of this page">{links}</nav></header><main>',
        *(section(name.capitalize(), name, text) for name, text in sections.items()),
        f"</main>{DIALOG}",
    ]
    return document(f"{name}: report", "\n".join(parts), {"index": index, **records}, "dataset.js")


def _rows(dataset: Dataset) -> int:
    """Of the images, as the configuration asks for them."""
    camera = dataset.config.get("camera")
    rows = camera.get("rows") if isinstance(camera, dict) else None
    return rows if isinstance(rows, int) else 424


def _tried(path: Path, view: int | None, fineness: Fineness) -> dict[str, Any]:
    """The subject, or why it cannot be shown: a page is wanted of a damaged dataset too."""
    try:
        return shown(path, view, fineness)
    except (ShardError, OSError) as error:
        return {"reason": one_line(error)}


def _summary(dataset: Dataset, found: list[dict[str, Any]]) -> str:
    block = dataset.description
    counts = block["counts"]
    entries = dataset.manifest.values()
    making, rendering = _making(dataset), sum(entry.seconds for entry in entries)
    figures = {
        "subjects": f"{len(entries):,}",
        "train / test": f"{counts['train']:,} / {counts['test']:,}",
        "views": f"{sum(entry.views for entry in entries):,}",
        "set aside": f"{len(dataset.failures):,}",
        "of shards": _size(sum(entry.bytes for entry in entries)),
        "of one worker's time to render": _duration(rendering),
    }
    if making is not None:
        figures["of one worker's time to make the subjects"] = _duration(making)
    if len(found) < len(entries):
        figures["cannot be shown"] = f"{len(entries) - len(found):,}"
    items = "".join(f"<li><b>{escape(v)}</b>{escape(k)}</li>" for k, v in figures.items())
    licences = Counter(entry.licence for entry in entries)
    rows = [
        ("licence", ", ".join(f"{name} ({count})" for name, count in licences.items()) or "none"),
        ("sources", ", ".join(sorted({one["source"] for one in found})) or "none"),
        ("sensor", ", ".join(sorted({one["sensor"] for one in found})) or "none"),
        ("seed", str(block["seed"])),
        ("configuration", f"SHA-256 {block['config_sha256']}"),
        ("versions", ", ".join(f"{k} {v}" for k, v in block.get("versions", {}).items())),
    ]
    return f'<ul class="figures">{items}</ul>{table((), rows)}'


def _making(dataset: Dataset) -> float | None:
    """Seconds that it took to make all subjects' files; None where not all of them say it."""
    seconds = 0.0
    for subject in dataset.manifest:
        try:
            with open_file(dataset.folder / SUBJECTS / subject / "cost.json") as file:
                seconds += float(json.loads(file.read())["seconds"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
    return seconds if math.isfinite(seconds) else None


def _size(count: int) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000  # type: ignore[assignment]
    return f"{count:.3g} TB"


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
