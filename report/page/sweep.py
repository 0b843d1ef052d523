"""The page of a light sweep: every subject under every power, and a link to no other file."""

from __future__ import annotations

from html import escape
from pathlib import Path

from report.maps import pictured
from report.page.document import document, section, table
from report.page.shown import Fineness, box_of, picture
from report.view import chosen
from shards.dataset import Dataset
from shards.sweep import base_folder, read_index

PICTURES = 600
"""At most so many are on the page; of more, subjects are left out, evenly."""


def page(folder: Path, view: int | None) -> str:
    """A sweep's folder as one HTML file.

    Args:
        view: of each subject; None for the one turned least.

    Raises:
        DatasetError: the folder holds no sweep, or one of nothing.
    """
    powers = {power: Dataset(place) for power, place in read_index(folder).items()}
    strongest = next(iter(powers.values()))
    subjects = strongest.subjects()
    most = max(1, PICTURES // len(powers))
    shown = subjects[:: -(-len(subjects) // most)] if subjects else []
    rows = [
        (f"{power:g} W", len(dataset), len(dataset.failures)) for power, dataset in powers.items()
    ]
    summary = table(("power", "subjects", "set aside"), rows)
    name = folder.resolve().name
    parts = [
        f"<header><h1>{escape(name)}</h1><p>Photographed: <code>"
        f"{escape(str(base_folder(folder).resolve()))}</code>.</p></header><main>",
        section("Powers", "powers", summary),
    ]
    gallery = [_subject(subject, powers, view) for subject in shown]
    if len(shown) < len(subjects):
        gallery.insert(0, f"<p>{len(shown)} of {len(subjects)} subjects, spread evenly.</p>")
    parts.append(section("Gallery", "gallery", "\n".join(gallery)) + "</main>")
    return document(f"{name}: report", "\n".join(parts))


def _subject(subject: str, powers: dict[float, Dataset], view: int | None) -> str:
    """A card with the subject's front under each power."""
    fineness = Fineness(0.5, 1, 75)
    figures = []
    for power, dataset in powers.items():
        if subject not in dataset.manifest:
            continue
        shard = dataset.shard(subject)
        maps = shard.view(chosen(shard, view), ["mask", "rgb_front", "body_depth_back"])
        source = picture(pictured(maps, "rgb_front", 1.0)[box_of(maps)], fineness)
        figures.append(
            f'<figure><img loading="lazy" src="{source}" alt="{escape(subject)} at {power:g} W">'
            f"<figcaption>{power:g} W</figcaption></figure>"
        )
    return (
        f'<article class="card"><header><h3>{escape(subject)}</h3></header>'
        f'<div class="maps">{"".join(figures)}</div></article>'
    )
