"""The part of a page that says what `verify` found."""

from __future__ import annotations

from html import escape

from report.page.document import table
from shards.dataset import Dataset
from shards.verify import BOUNDS, Report

MOST = 100
"""Breaches that are told; of more, how many there are."""


def proof_section(dataset: Dataset, proof: Report | None) -> str:
    """HTML of a dataset's verdict and of the worst figures beside their bounds.

    Args:
        proof: of the dataset as it stands; None if there is none.
    """
    if proof is None:
        return (
            "<p>Nobody has proven this dataset, or not since it changed. Run "
            "<code>python pipeline.py verify DIR</code>, then <code>report</code> again.</p>"
        )
    if proof.ok:
        verdict = (
            '<p class="good">Sound when it was verified: every file had its checksum, and every '
            "view was what rays cast through the mesh see.</p>"
        )
    else:
        verdict = f'<p class="bad">{verdict_of(proof)}</p>{breach_list(dataset, proof)}'
    worst = proof.worst()
    rows = [
        (words, float(worst[name]), bound if bound is not None else "")
        for name, (words, bound) in BOUNDS.items()
        if name in worst
    ]
    caption = f"The worst of {len(proof.figures)} subjects, all views"
    return verdict + table(("", "seen", "bound"), rows, caption)


def verdict_of(proof: Report | None) -> str:
    """In a few words."""
    if proof is None:
        return "not proven"
    count = len(proof.breaches)
    return f"{count:,} breach{'es' if count > 1 else ''}" if count else "sound"


def breach_list(dataset: Dataset, proof: Report) -> str:
    """HTML of what breaks the contract, of the place that the dataset lies in."""
    told = [line.replace(str(dataset.folder), dataset.place) for line in proof.breaches[:MOST]]
    if len(proof.breaches) > MOST:
        told.append(f"and {len(proof.breaches) - MOST:,} more, in verify.json")
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in told) + "</ul>"
