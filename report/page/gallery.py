"""The part of a page that shows subject by subject, and the window that turns one about."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from shards.dataset import Dataset
from shards.verify import Report

_PROVEN = {
    "mask_off": "{:.0f} pixels of the silhouette off",
    "depth_median_mm": "depth within {:.4f} mm (median)",
    "normal_median_deg": "normals within {:.3f}°",
}
"""What a subject's card says of its proof."""


def cards(
    dataset: Dataset, faults: Mapping[str, str], proof: Report | None
) -> list[dict[str, Any]]:
    """What the page's script has to know of every subject before it is shown.

    Args:
        faults: subject -> why its shard cannot be shown.
        proof: of the dataset as it stands; None if there is none.

    Returns:
        `id`, `split`, and `record`, the element with the rest, and `figures`, the proof in words;
        of what was set aside, or cannot be shown, `what` of these two and the `reason`.
    """
    return [*_finished(dataset, faults, proof), *_failed(dataset)]


def _finished(
    dataset: Dataset, faults: Mapping[str, str], proof: Report | None
) -> Iterator[dict[str, Any]]:
    for k, (subject, entry) in enumerate(dataset.manifest.items()):
        if subject in faults:
            yield {
                "id": subject,
                "split": entry.split,
                "what": "cannot be shown",
                "reason": faults[subject].replace(str(dataset.folder), dataset.place),
            }
            continue
        card = {"id": subject, "split": entry.split, "record": f"subject-{k}"}
        figures = {} if proof is None else proof.figures.get(subject, {})
        told = [
            text.format(figures[name])
            for name, text in _PROVEN.items()
            if math.isfinite(figures.get(name, math.nan))
        ]
        if told:
            card["figures"] = f"proof: {', '.join(told)}"
        yield card


def _failed(dataset: Dataset) -> Iterator[dict[str, Any]]:
    for failure in dataset.failures:
        yield {
            "id": failure["subject"],
            "split": "failed",
            "what": f"set aside: {failure['stage']}",
            "reason": failure["reason"],
        }


def gallery_section(subjects: Sequence[Mapping[str, Any]]) -> str:
    """HTML of the place where the script puts the cards, and of what chooses among them."""
    kinds = Counter(one["what"] for one in subjects if "reason" in one)
    options = "".join(
        f'<option value="{escape(kind)}">{escape(kind)} ({count:,})</option>'
        for kind, count in kinds.items()
    )
    return f"""
<div class="controls">
<label>Show <select id="group"><option value="all">all subjects</option>
<option value="train">train</option><option value="test">test</option>
<option value="failed">all failures</option>{options}</select></label>
<label>Find
<input id="search" type="search" size="24" placeholder="part of an id or reason"></label>
<button id="previous" type="button">Previous</button>
<button id="next" type="button">Next</button>
<label>Page <input id="page" type="number" min="1" value="1"></label>
<span id="where" role="status"></span>
</div>
<div id="cards"><noscript>The gallery needs JavaScript, which lies in this file.</noscript></div>
"""


DIALOG = """
<dialog id="solid-dialog" aria-labelledby="solid-title">
<div class="controls"><h3 id="solid-title"></h3>
<label>Show <select id="kind">
<option value="surface" data-needs="front back">the surface, from both depths</option>
<option value="sensor" data-needs="sensor">what the sensor read</option>
<option value="body" data-needs="body_front body_back">the bare body</option></select></label>
<button type="button" data-move="ArrowLeft">Turn left</button>
<button type="button" data-move="ArrowRight">Turn right</button>
<button type="button" data-move="ArrowUp">Above</button>
<button type="button" data-move="ArrowDown">Below</button>
<button type="button" data-move="+">Nearer</button>
<button type="button" data-move="-">Farther</button>
<button id="close" type="button">Close</button></div>
<div id="solid" tabindex="0" role="application" aria-label="The subject in three dimensions;
drag to turn it, or use the arrow keys, + and -"></div>
<p id="seen" class="soft" role="status"></p>
</dialog>
"""
