"""The page of a dataset: what it holds, what it looks like, what its proof found, what failed."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from report.maps import TITLES
from report.page.document import document, section, table
from report.page.measure import DEPTH_MM, RESIDUAL, SAMPLED, THICKNESS_MM
from report.page.shown import Fineness, shown
from shards.archive import ShardError
from shards.dataset import Dataset
from shards.proof import read_proof
from shards.verify import BOUNDS, Report

_PROVEN = {
    "mask_off": "{:.0f} pixels of the silhouette off",
    "depth_median_mm": "depth within {:.4f} mm (median)",
    "normal_median_deg": "normals within {:.3f}°",
}
"""What a subject's card says of its proof."""

DEGREES, SHARE = 2.0, 0.01
"""Widths of the histograms' bins of yaw and coverage."""


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
    work = Parallel(n_jobs=min(jobs, len(paths) or 1), return_as="generator")(
        delayed(_tried)(path, view, fineness) for path in paths.values()
    )
    bar = tqdm(work, "report", len(paths), leave=False, disable=not sys.stderr.isatty())
    tried = dict(zip(paths, bar, strict=True))
    found = {subject: one for subject, one in tried.items() if "reason" not in one}
    counts = {subject: one.pop("counts") for subject, one in found.items()}
    faults = {subject: one["reason"] for subject, one in tried.items() if "reason" in one}
    proof = read_proof(dataset)
    name = Path(dataset.place).name or dataset.place
    histograms = list(_histograms(list(counts.values()))) if counts else []
    index = {
        "words": TITLES,
        "subjects": [*_cards(dataset, faults, proof), *_failures(dataset)],
        "histograms": histograms,
    }
    order = {subject: k for k, subject in enumerate(paths)}
    records = {f"subject-{order[subject]}": one for subject, one in found.items()}
    measured = _measured(histograms, list(counts.values()))
    body = _body(dataset, name, list(found.values()), measured, proof)
    return document(f"{name}: report", body, {"index": index, **records}, "dataset.js")


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
        return {"reason": " ".join(str(error).split())}


def _cards(
    dataset: Dataset, faults: dict[str, str], proof: Report | None
) -> Iterator[dict[str, Any]]:
    for k, (subject, entry) in enumerate(dataset.manifest.items()):
        if subject in faults:
            yield {
                "id": subject,
                "split": entry.split,
                "stage": "its shard",
                "reason": faults[subject],
            }
            continue
        card = {"id": subject, "split": entry.split, "record": f"subject-{k}"}
        figures = {} if proof is None else proof.figures.get(subject, {})
        told = [text.format(figures[name]) for name, text in _PROVEN.items() if name in figures]
        if told:
            card["figures"] = f"proof: {', '.join(told)}"
        yield card


def _failures(dataset: Dataset) -> Iterator[dict[str, Any]]:
    for failure in dataset.failures:
        yield {
            "id": failure["subject"],
            "split": "failed",
            "stage": failure["stage"],
            "reason": failure["reason"],
        }


def _histograms(counts: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """What the page draws: values of bins from `first` on, each `width` wide."""

    def total(name: str) -> list[int]:
        return np.sum([of[name] for of in counts], axis=0).tolist()

    def binned(name: str, low: float, high: float, width: float) -> list[int]:
        values = np.concatenate([of[name] for of in counts])
        return np.histogram(values, np.arange(low, high + width / 2, width))[0].tolist()

    yield {
        "name": "depth",
        "title": "Depth, front and back",
        "unit": "metres from the camera plane",
        "values": total("depth"),
        "first": 0,
        "width": DEPTH_MM / 1000,
    }
    yield {
        "name": "thickness",
        "title": "Thickness",
        "unit": "metres from front to back",
        "values": total("thickness"),
        "first": 0,
        "width": THICKNESS_MM / 1000,
    }
    residual = total("residual")
    yield {
        "name": "residual",
        "title": "Sensor's residual beside its model",
        "unit": "standard deviations of the model",
        "values": residual,
        "first": -len(residual) * RESIDUAL / 2,
        "width": RESIDUAL,
        "normal": True,
    }
    yield {
        "name": "yaw",
        "title": "Yaw of all views",
        "unit": "degrees",
        "values": binned("yaw_deg", -180, 180, DEGREES),
        "first": -180,
        "width": DEGREES,
    }
    yield {
        "name": "coverage",
        "title": "Coverage of all views",
        "unit": "share of the image's pixels",
        "values": binned("coverage", 0, 1, SHARE),
        "first": 0,
        "width": SHARE,
    }


def _body(
    dataset: Dataset,
    name: str,
    found: list[dict[str, Any]],
    measured: str,
    proof: Report | None,
) -> str:
    failures = dataset.failures
    parts = [
        f"<header><h1>{escape(name)}</h1>",
        '<nav aria-label="Parts of this page">'
        + " ".join(
            f'<a href="#{part}">{part}</a>'
            for part in ("summary", "proof", "gallery", "histograms", "failures")
        )
        + "</nav></header><main>",
        section("Summary", "summary", _summary(dataset, found)),
        section("Proof", "proof", _proof(proof)),
        section("Gallery", "gallery", _GALLERY),
        section("Histograms", "histograms", measured),
        section("Failures", "failures", _failure_table(failures)),
        "</main>",
        _DIALOG,
    ]
    return "\n".join(parts)


def _summary(dataset: Dataset, found: list[dict[str, Any]]) -> str:
    block = dataset.description
    counts = block["counts"]
    entries = dataset.manifest.values()
    seconds = sum(entry.seconds for entry in entries)
    figures = {
        "subjects": f"{len(entries):,}",
        "train / test": f"{counts['train']:,} / {counts['test']:,}",
        "views": f"{sum(entry.views for entry in entries):,}",
        "set aside": f"{len(dataset.failures):,}",
        "of shards": _size(sum(entry.bytes for entry in entries)),
        "of workers' time": _duration(seconds),
    }
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


def _proof(proof: Report | None) -> str:
    if proof is None:
        return (
            "<p>Nobody has proven this dataset, or not since it changed. Run "
            "<code>python pipeline.py verify DIR</code>, then <code>report</code> again.</p>"
        )
    verdict = (
        '<p class="good">Sound when it was verified: every file had its checksum, and every view '
        "was what rays cast through the mesh see.</p>"
        if proof.ok
        else f'<p class="bad">{len(proof.breaches)} breaches</p><ul>'
        + "".join(f"<li>{escape(line)}</li>" for line in proof.breaches[:100])
        + "</ul>"
    )
    worst = proof.worst()
    rows = [
        (words, float(worst[name]), bound if bound is not None else "")
        for name, (words, bound) in BOUNDS.items()
        if name in worst
    ]
    caption = f"The worst of {len(proof.figures)} subjects, all views"
    return verdict + table(("", "seen", "bound"), rows, caption)


def _measured(histograms: list[dict[str, Any]], counts: list[dict[str, Any]]) -> str:
    """What the sensor did, in words, and the places where the page draws the histograms."""
    if not counts:
        return "<p>There is no subject to measure.</p>"
    read, lost, measured = (sum(of[name] for of in counts) for name in ("read", "lost", "measured"))
    spread = (sum(of["squares"] for of in counts) / max(measured, 1)) ** 0.5
    said = (
        f"Depths, thickness and residuals of up to {SAMPLED} views of each subject; yaw and "
        f"coverage of all. The sensor read {read:,} pixels of the subjects and lost {lost:,} "
        f"({lost / max(read + lost, 1):.1%}). "
    ) + (
        f"Its residuals have a standard deviation of {spread:.2f} of their model's."
        if measured
        else "There are no residuals: the sensor has no noise, or its model is not known here."
    )
    plots = "".join(
        f'<div class="plot" id="histogram-{one["name"]}" role="img" '
        f'aria-label="Histogram: {escape(one["title"])}, {escape(one["unit"])}"></div>'
        for one in histograms
    )
    return f'<p>{said}</p><div class="plots">{plots}</div>'


def _failure_table(failures: list[dict[str, str]]) -> str:
    if not failures:
        return "<p>None: no subject was set aside.</p>"
    rows = [(one["subject"], one["stage"], one["reason"]) for one in failures]
    return table(("subject", "stage", "reason"), rows)


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


_GALLERY = """
<div class="controls">
<label>Show <select id="split"><option value="all">all subjects</option>
<option value="train">train</option><option value="test">test</option>
<option value="failed">set aside</option></select></label>
<label>Find <input id="search" type="search" placeholder="part of an id"></label>
<button id="previous" type="button">Previous</button>
<button id="next" type="button">Next</button>
<span id="where" role="status"></span>
</div>
<div id="cards"><noscript>The gallery needs JavaScript, which lies in this file.</noscript></div>
"""

_DIALOG = """
<dialog id="solid-dialog" aria-labelledby="solid-title">
<div class="controls"><h3 id="solid-title"></h3>
<label>Show <select id="kind">
<option value="surface" data-needs="front back">the surface, from both depths</option>
<option value="sensor" data-needs="sensor">what the sensor read</option>
<option value="body" data-needs="body_front body_back">the bare body</option></select></label>
<button id="left" type="button">Turn left</button>
<button id="right" type="button">Turn right</button>
<button id="close" type="button">Close</button></div>
<div id="solid" role="img" aria-label="The subject in three dimensions; drag to turn it"></div>
</dialog>
"""
