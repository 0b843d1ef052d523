"""The card of a set of open humans: what was made, what it cost, and whether it keeps its bounds.

python -m report.humans out/demo --output humans.json
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from report import command
from report.human import Garment, Human, read_human
from report.likeness import Pair, most_alike
from shards.dataset import Dataset

TRIANGLES = (100_000, 400_000)
"""Fewest and most triangles of a human."""
THROUGH_LIMIT = 0.005
"""Share of a garment's area inside the body from which the garment is faulty."""
FREED_LIMIT = 0.03
"""Largest share of a garment's area that may have been laid back on the skin."""
FOLD_LIMIT = 10.0
"""Degrees that the surface of a soft and loose garment turns at least."""
MEMORY_LIMIT = 2000
"""Megabytes that making a human takes at most."""

_POSE = re.compile(r"(\w+): (.*)", re.DOTALL)
_POSES_SHOWN = 5


def card(dataset: Dataset) -> dict[str, Any]:
    """All figures of the set, JSON-ready; "broken" names the bounds that are not kept.

    Raises:
        ValueError: the set is empty, or not one of open humans.
        OSError: a file cannot be read.
    """
    humans = [read_human(dataset, subject) for subject in dataset.subjects()]
    if not humans:
        raise ValueError(f"{dataset.folder} holds no finished subject; build it first")
    poses = Counter(human.pose for human in humans)
    hard = sorted({human.pose for human in humans if human.hard})
    kinds: dict[str, list[Garment]] = defaultdict(list)
    classes: dict[str, list[Garment]] = {"soft and loose": [], "stiff or close": []}
    for human in humans:
        for garment in human.garments:
            kinds[garment.kind].append(garment)
            loose = garment.soft_and_loose
            classes["soft and loose" if loose else "stiff or close"].append(garment)
    pair = most_alike(humans)
    making = [human.seconds for human in humans]
    thrown = sum(len(human.failed) for human in humans)
    reasons, poses_that_failed = _reasons(humans)
    return {
        "humans": len(humans),
        "set_aside": len(dataset.failures),
        "poses": dict(sorted(poses.items())),
        "hard_poses": hard,
        "humans_in_hard_poses": sum(human.hard for human in humans),
        "triangles": _spread([human.triangles for human in humans]),
        "humans_laid": sum(human.cloth == "laid" for human in humans),
        "garments": {kind: _garments(kinds[kind]) for kind in sorted(kinds)},
        "classes": {name: _garments(members) for name, members in classes.items() if members},
        "humans_without_measured_garments": sum(not human.garments for human in humans),
        "drapes_thrown_away": thrown,
        "drapes_thrown_away_share": round(thrown / (thrown + len(humans)), 4),
        "humans_drawn_again": sum(bool(human.failed) for human in humans),
        "reasons": dict(reasons.most_common()),
        "poses_that_failed": dict(poses_that_failed.most_common()),
        "seconds_to_make": {**_spread(making), "sum": round(sum(making), 2)},
        "peak_memory_mb": max(human.peak_memory_mb for human in humans),
        "seconds_to_render": _spread([dataset.manifest[h.subject].seconds for h in humans]),
        "most_alike": pair and {**asdict(pair), "distance": round(pair.distance, 4)},
        "broken": _broken(humans, dataset.failures, pair),
    }


def _spread(values: Sequence[float]) -> dict[str, float]:
    return {
        "min": min(values),
        "median": round(float(np.median(values)), 3),
        "max": max(values),
    }


def _worst(shares: Sequence[float]) -> dict[str, float]:
    return {"median": round(float(np.median(shares)), 6), "worst": max(shares)}


def _garments(members: list[Garment]) -> dict[str, Any]:
    """Their figures; None where no member was measured."""
    freed = [garment.freed_share for garment in members if garment.freed_share is not None]
    folds = [garment.fold_deg for garment in members if garment.fold_deg is not None]
    return {
        "count": len(members),
        "soft_and_loose": sum(garment.soft_and_loose for garment in members),
        "through_share": _worst([garment.through_share for garment in members]),
        "freed_share": _worst(freed) if freed else None,
        "fold_deg": _spread(folds) if folds else None,
    }


def _reasons(humans: Sequence[Human]) -> tuple[Counter[str], Counter[str]]:
    """How often each was given, figures left open, and how often in each pose."""
    reasons: Counter[str] = Counter()
    poses: Counter[str] = Counter()
    for reason in (reason for human in humans for reason in human.failed):
        posed = _POSE.fullmatch(reason)
        if posed:
            poses[posed[1]] += 1
        reasons[re.sub(r"\d+(\.\d+)?", "#", posed[2] if posed else reason)] += 1
    return reasons, poses


def _broken(
    humans: Sequence[Human], failures: Sequence[Mapping[str, str]], pair: Pair | None
) -> list[str]:
    broken = [
        f"{f['subject']} was set aside: {f['reason'].removeprefix(f['subject'] + ': ')}"
        for f in failures
    ]
    largest = max(humans, key=lambda human: human.peak_memory_mb)
    over = sum(not human.peak_memory_mb <= MEMORY_LIMIT for human in humans)
    if over:
        broken.append(
            f"{over} humans took over {MEMORY_LIMIT} MB to make, {largest.subject} "
            f"{largest.peak_memory_mb:.0f} MB"
        )
    for human in humans:
        broken += [f"{human.subject}{fault}" for fault in _faults(human)]
    if pair is not None and pair.alike:
        same = f"the same {' and '.join(pair.shared)}" if pair.shared else "almost the same draws"
        broken.append(f"{pair.first} and {pair.second} have {same}")
    return broken


def _faults(human: Human) -> list[str]:
    """Of one human, to follow its name; asked so that NaN is one too."""
    fewest, most = TRIANGLES
    faults = []
    if not fewest <= human.triangles <= most:
        faults.append(f" has {human.triangles} triangles, not {fewest} to {most}")
    for garment in human.garments:
        kind, freed, fold = garment.kind, garment.freed_share, garment.fold_deg
        if not garment.through_share < THROUGH_LIMIT:
            faults.append(
                f": {garment.through_share:.2%} of the {kind} is inside the body, "
                f"{THROUGH_LIMIT:.1%} or more"
            )
        if freed is not None and not freed <= FREED_LIMIT:
            faults.append(
                f": {freed:.2%} of the {kind} was laid back on the skin, over {FREED_LIMIT:.0%}"
            )
        if garment.soft_and_loose and fold is not None and not fold >= FOLD_LIMIT:
            faults.append(
                f": the soft and loose {kind} folds by {fold:.1f}°, under {FOLD_LIMIT:.0f}°"
            )
    return faults


def text(figures: Mapping[str, Any]) -> str:
    """The card to read."""
    f = figures
    triangles, seconds = f["triangles"], f["seconds_to_render"]
    making = f["seconds_to_make"]
    poses = ", ".join(
        f"{name.replace('_', ' ')}{'*' if name in f['hard_poses'] else ''} {count}"
        for name, count in f["poses"].items()
    )
    lines = [
        f"humans      {f['humans']}, {f['set_aside']} set aside",
        f"poses       {poses}",
        f"hard poses  {len(f['hard_poses'])} (*), of {f['humans_in_hard_poses']} humans",
        f"triangles   {triangles['min']} to {triangles['max']}, median {triangles['median']:.0f}",
        f"making      {making['min']:.1f} to {making['max']:.1f} s a human, median "
        f"{making['median']:.1f} s, {making['sum']:.0f} s of all workers; "
        f"{f['peak_memory_mb'] / 1000:.2f} GB at most in a worker",
        f"rendering   {seconds['min']:.1f} to {seconds['max']:.1f} s a human, median "
        f"{seconds['median']:.1f} s",
    ]
    if f["humans_laid"]:
        lines.append(f"cloth       laid, not draped, on {f['humans_laid']} humans")
    lines += [
        f"drapes      {f['drapes_thrown_away']} thrown away, {f['drapes_thrown_away_share']:.1%} "
        f"of all draws, of {f['humans_drawn_again']} humans",
        *(f"            {count} x {reason}" for reason, count in f["reasons"].items()),
    ]
    if f["poses_that_failed"]:
        most = list(f["poses_that_failed"].items())[:_POSES_SHOWN]
        named = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in most)
        lines.append(f"            most in {named}")
    if f["garments"]:
        wide = max(len(name) for name in (*f["garments"], *f["classes"]))
        head = (
            f"{'garment':{wide}}  count  soft+loose  inside the body  laid on the skin  "
            "fold of the surface"
        )
        under = (
            f"{'':{wide}}                      median   worst    median   worst   "
            "median  min to max"
        )
        lines += ["", head, under, "-" * len(head)]
        lines += [_row(name, g, wide) for name, g in f["garments"].items()]
        lines.append("-" * len(head))
        lines += [_row(name, g, wide) for name, g in f["classes"].items()]
    if f["humans_without_measured_garments"]:
        lines += ["", f"no garment was measured of {f['humans_without_measured_garments']} humans"]
    if f["most_alike"]:
        pair = f["most_alike"]
        parts = ", ".join(f"{name} {value:.2f}" for name, value in pair["aspects"].items())
        lines += [
            "",
            f"the two most alike, {pair['first']} and {pair['second']}, differ by "
            f"{pair['distance']:.2f} (0 same, 1 opposite): {parts}",
        ]
    lines += ["", *(f"BROKEN: {line}" for line in f["broken"])]
    if not f["broken"]:
        lines.append("all bounds are kept")
    return "\n".join(lines)


def _row(name: str, g: Mapping[str, Any], wide: int) -> str:
    through, freed, fold = g["through_share"], g["freed_share"], g["fold_deg"]
    again = f"{freed['median']:7.2%} {freed['worst']:7.2%}" if freed else f"{'-':>7} {'-':>7}"
    bend = f"{fold['median']:5.1f}°  {fold['min']:.1f}° to {fold['max']:.1f}°" if fold else "    -"
    return (
        f"{name:{wide}}  {g['count']:5d}  {g['soft_and_loose']:10d}  {through['median']:7.2%} "
        f"{through['worst']:7.2%}   {again}   {bend}"
    )


def main() -> int:
    """Print the card; returns the exit status: 1 if a bound is broken, 2 if there is no card."""
    parser = command.parser(__doc__)
    parser.add_argument("--output", type=Path, help="JSON to write")
    options = parser.parse_args()
    try:
        figures = card(Dataset(options.data))
        if options.output is not None:
            options.output.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    except (ValueError, OSError) as error:
        return command.refused(error)
    print(text(figures))
    return 1 if figures["broken"] else 0


if __name__ == "__main__":
    sys.exit(main())
