"""The page of a light sweep: its subjects under every power, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from html import escape
from pathlib import Path

from report.maps import box_of, pictured
from report.page.document import document, section, table
from report.page.failures import failure_section
from report.page.proof import breach_list, verdict_of
from report.page.reading import each, one_line
from report.page.shown import Fineness, picture, sound
from report.view import chosen
from shards.archive import Shard, ShardError
from shards.dataset import Dataset
from shards.proof import read_proof
from shards.sweep import base_folder, read_index

FINENESS = Fineness(scale=0.5, step=1, quality=75)

PICTURES = 600
"""At most so many are on the page; of more, subjects are left out, evenly."""


def page(folder: Path, view: int | None, jobs: int) -> str:
    """A sweep's folder as one HTML file.

    Args:
        view: of each subject; None for the one turned least.
        jobs: processes that read shards.

    Raises:
        DatasetError: the folder holds no sweep, or one of nothing.
        ValueError: a subject has no such view.
    """
    powers = {power: Dataset(place) for power, place in read_index(folder).items()}
    # As they were photographed first; a power may have set some aside.
    subjects = list(dict.fromkeys(one for dataset in powers.values() for one in dataset.manifest))
    most = max(1, PICTURES // len(powers))
    shown = subjects[:: -(-len(subjects) // most)] if subjects else []
    shards = [_shards(powers, subject) for subject in shown]
    pictures = dict(zip(shown, each(partial(_pictures, view=view), shards, jobs), strict=True))
    failures = [
        (one["subject"], f"{power:g} W", one["stage"], one["reason"])
        for power, dataset in powers.items()
        for one in dataset.failures
    ]
    gallery = [_card(subject, found) for subject, found in pictures.items()]
    if len(shown) < len(subjects):
        gallery.insert(0, f"<p>{len(shown)} of {len(subjects)} subjects, spread evenly.</p>")
    name, base = folder.resolve().name, Dataset(base_folder(folder).resolve())
    parts = [
        f"<header><h1>{escape(name)}</h1><p>Photographed: <code>{escape(str(base.folder))}</code> "
        f"({verdict_of(read_proof(base))}).</p></header><main>",
        section("Powers", "powers", _powers(powers)),
        section("Gallery", "gallery", "\n".join(gallery)),
        section(
            "Failures",
            "failures",
            failure_section(("subject", "power", "stage", "reason"), failures),
        ),
        "</main>",
    ]
    return document(f"{name}: report", "\n".join(parts))


def _powers(powers: Mapping[float, Dataset]) -> str:
    """What each power holds, and what its proof found."""
    proofs = {power: read_proof(dataset) for power, dataset in powers.items()}
    rows = [
        (f"{power:g} W", len(dataset), len(dataset.failures), verdict_of(proofs[power]))
        for power, dataset in powers.items()
    ]
    parts = [table(("power", "subjects", "set aside", "proof"), rows)]
    if None in proofs.values():
        parts.append(
            "<p>Run <code>python pipeline.py verify DIR</code>, then <code>report</code> again, to "
            "have all of them proven.</p>"
        )
    for power, proof in proofs.items():
        if proof is not None and not proof.ok:
            parts.append(f'<p class="bad">{power:g} W: {verdict_of(proof)}</p>')
            parts.append(breach_list(powers[power], proof))
    return "\n".join(parts)


def _shards(powers: Mapping[float, Dataset], subject: str) -> dict[float, Path]:
    return {
        power: dataset.shard_path(subject)
        for power, dataset in powers.items()
        if subject in dataset.manifest
    }


def _pictures(shards: Mapping[float, Path], view: int | None) -> dict[float, str]:
    """The front under each power as a data URL, or why it cannot be shown."""
    found = {}
    for power, path in shards.items():
        try:
            found[power] = _picture(path, view)
        except (ShardError, OSError) as error:
            found[power] = one_line(error)
    return found


def _picture(path: Path, view: int | None) -> str:
    shard = Shard(path)
    index = chosen(shard, view)
    with sound(path):
        maps = shard.view(index, ["mask", "rgb_front", "body_depth_back"])
        if not maps["mask"].any():
            raise ValueError(f"view {index} shows nothing")
        return picture(pictured(maps, "rgb_front", 1.0)[box_of(maps)], FINENESS)


def _card(subject: str, found: Mapping[float, str]) -> str:
    """The subject's front under each power."""
    figures = []
    for power, source in found.items():
        shown = (
            f'<img loading="lazy" src="{source}" alt="{escape(subject)} at {power:g} W">'
            if source.startswith("data:")
            else f'<p class="bad">{escape(source)}</p>'
        )
        figures.append(f"<figure>{shown}<figcaption>{power:g} W</figcaption></figure>")
    return (
        f'<article class="card"><header><h3>{escape(subject)}</h3></header>'
        f'<div class="maps">{"".join(figures)}</div></article>'
    )
