"""The card of a set of open humans: what was made, what it cost, and whether it keeps its bounds.

python -m report.humans out/demo --output humans.json
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from shards.dataset import SUBJECTS, Dataset

THROUGH_LIMIT = 0.005
"""Share of a garment's area inside the body from which the garment is faulty."""
TRIANGLES = (100_000, 400_000)
"""Fewest and most triangles of a human."""
ALIKE = 0.05
"""Difference of two humans, as `Pair` has it, below which they are alike; of 500 drawn by chance
the nearest two differ by 0.14."""
ASPECTS = ("body", "pose", "outfit", "look")

_ABSENT = -10.0


@dataclass(frozen=True)
class Human:
    """What is read of one human.

    Attributes:
        aspects: of `ASPECTS`, the draws that make it this human: dotted name -> value.
        garments: of each that was measured: garment, through_share, fold_deg, soft_and_loose.
        failed: why earlier draws of it were thrown away.
        prints: SHA-256 of its surface and of its texture.
        cost: seconds and peak_memory_mb that making it took.
    """

    subject: str
    pose: str
    hard: bool
    triangles: int
    aspects: dict[str, dict[str, Any]]
    garments: list[dict[str, Any]]
    failed: list[str]
    prints: dict[str, str]
    cost: dict[str, float]


@dataclass(frozen=True)
class Pair:
    """Two humans and how they differ.

    Attributes:
        aspects: of `ASPECTS`, the mean difference of the numbers as shares of the set's spread,
            and of the names as 0 or 1 (Gower 1971); 0 is the same.
        shared: which files have the same bytes, of surface and texture.
    """

    first: str
    second: str
    aspects: dict[str, float]
    shared: list[str]

    @property
    def distance(self) -> float:
        """Mean over the aspects."""
        return sum(self.aspects.values()) / len(self.aspects)

    @property
    def alike(self) -> bool:
        """Whether the two pass for one."""
        return bool(self.shared) or self.distance < ALIKE


def pose_of(body: Mapping[str, Any]) -> tuple[str, bool]:
    """A pose's name, "-" if there is none, and whether it is a hard one.

    Args:
        body: the parametric body's parameters, as a shard or parameters.json has them.
    """
    pose = body.get("pose", "-")
    if isinstance(pose, Mapping):
        return str(pose.get("name", "-")), bool(pose.get("hard", False))
    return str(pose), bool(body.get("hard", False))


def read_human(dataset: Dataset, subject: str) -> Human:
    """What a build left of an open human.

    Raises:
        ValueError: its parameters.json is no open human's.
        OSError: a file cannot be read.
    """
    mesh = dataset.path(dataset.shard(subject).meta["mesh"])
    path = dataset.folder / SUBJECTS / subject / "parameters.json"
    try:
        parameters = json.loads(path.read_text(encoding="utf-8"))
        body, drapes = parameters["body"], parameters["drapes"]
        name, hard = pose_of(body)
        garments = [
            {
                "garment": str(g["garment"]),
                "through_share": float(g["through_share"]),
                # None of a garment that others hide from both sides.
                "fold_deg": None if g["fold_deg"] is None else float(g["fold_deg"]),
                "soft_and_loose": bool(g["soft_and_loose"]),
            }
            for g in drapes["garments"]
        ]
        aspects = {
            "body": {key: body[key] for key in ("age_years", "height_m", "phenotype")},
            "pose": {key: body[key] for key in ("pose", "pose_parameters")},
            "outfit": parameters["outfit"],
            "look": parameters["look"],
        }
        return Human(
            subject=subject,
            pose=name,
            hard=hard,
            triangles=int(parameters["triangles"]),
            aspects={key: dict(_leaves(value)) for key, value in aspects.items()},
            garments=garments,
            failed=[str(reason) for reason in drapes["failed"]],
            cost=json.loads(path.with_name("cost.json").read_text(encoding="utf-8")),
            prints={"surface": _sha256(mesh), "texture": _texture_sha256(mesh.parent)},
        )
    except (KeyError, TypeError, ValueError) as error:
        what = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{path} is no open human's ({what}); build the set again") from None


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """{"a": {"b": 1}, "c": [2]} -> ("a.b", 1), ("c.0", 2)."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _leaves(inner, f"{name}.{k}")
    elif value is not None:
        yield name, value


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _texture_sha256(folder: Path) -> str:
    pictures = sorted(folder.glob("*.jpeg"))
    return hashlib.sha256("".join(_sha256(p) for p in pictures).encode()).hexdigest()


def most_alike(humans: list[Human]) -> Pair | None:
    """The two humans nearest to each other, those that share a file first; None of fewer."""
    if len(humans) < 2:
        return None
    for what in ("surface", "texture"):
        seen: dict[str, int] = {}
        for k, human in enumerate(humans):
            if human.prints[what] in seen:
                return _pair(humans, seen[human.prints[what]], k)
            seen[human.prints[what]] = k
    blocks = [_scaled([human.aspects[aspect] for human in humans]) for aspect in ASPECTS]
    nearest, pair = np.inf, (0, 1)
    for k in range(len(humans) - 1):
        distance = np.mean([_distances(block[k], block[k + 1 :]) for block in blocks], axis=0)
        if distance.min() < nearest:
            nearest, pair = float(distance.min()), (k, k + 1 + int(distance.argmin()))
    return _pair(humans, *pair)


def _pair(humans: list[Human], a: int, b: int) -> Pair:
    aspects = {}
    for aspect in ASPECTS:
        block = _scaled([human.aspects[aspect] for human in humans])
        aspects[aspect] = round(float(_distances(block[a], block[b : b + 1])[0]), 4)
    first, second = humans[a], humans[b]
    shared = [key for key in first.prints if first.prints[key] == second.prints[key]]
    return Pair(first.subject, second.subject, aspects, shared)


def _scaled(draws: list[dict[str, Any]]) -> np.ndarray:
    """(N, K): each draw that varies in the set, so that a difference of 1 or more counts as 1."""
    columns = []
    for name in sorted(set().union(*draws)):
        values = [draw.get(name) for draw in draws]
        there = [v for v in values if v is not None]
        if all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in there):
            low, high = min(there), max(there)
            span = (high - low) or 1
            column = [_ABSENT if v is None else (v - low) / span for v in values]
        else:
            codes = {text: float(k) for k, text in enumerate(sorted({str(v) for v in there}))}
            column = [_ABSENT if v is None else codes[str(v)] for v in values]
        if len(set(column)) > 1:
            columns.append(column)
    return np.array(columns, dtype=np.float64).reshape(len(columns), len(draws)).T


def _distances(one: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(N,) mean difference between `one` (K,) and each of `others` (N, K); 0 of no draws."""
    if others.shape[1] == 0:
        return np.zeros(len(others))
    result: np.ndarray = np.minimum(np.abs(others - one), 1).mean(axis=1)
    return result


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
    kinds: dict[str, list[dict[str, Any]]] = defaultdict(list)
    classes: dict[str, list[dict[str, Any]]] = {"soft and loose": [], "stiff or close": []}
    for human in humans:
        for garment in human.garments:
            kinds[garment["garment"]].append(garment)
            loose = garment["soft_and_loose"]
            classes["soft and loose" if loose else "stiff or close"].append(garment)
    pair = most_alike(humans)
    seconds = [dataset.manifest[human.subject].seconds for human in humans]
    return {
        "humans": len(humans),
        "set_aside": len(dataset.failures),
        "poses": dict(sorted(poses.items())),
        "hard_poses": hard,
        "humans_in_hard_poses": sum(human.hard for human in humans),
        "triangles": _spread([human.triangles for human in humans]),
        "garments": {kind: _garments(kinds[kind]) for kind in sorted(kinds)},
        "classes": {name: _garments(members) for name, members in classes.items() if members},
        "humans_without_measured_garments": sum(not human.garments for human in humans),
        "drapes_thrown_away": sum(len(human.failed) for human in humans),
        "humans_drawn_again": sum(bool(human.failed) for human in humans),
        "reasons": dict(_reasons(humans).most_common()),
        "seconds_to_make": _spread([float(human.cost["seconds"]) for human in humans]),
        "peak_memory_mb": max(int(human.cost["peak_memory_mb"]) for human in humans),
        "seconds_to_render": _spread(seconds),
        "most_alike": pair and {**asdict(pair), "distance": round(pair.distance, 4)},
        "broken": _broken(humans, pair),
    }


def _spread(values: list[int] | list[float]) -> dict[str, float]:
    return {
        "min": min(values),
        "median": round(float(np.median(values)), 3),
        "max": max(values),
    }


def _garments(members: list[dict[str, Any]]) -> dict[str, Any]:
    through = [member["through_share"] for member in members]
    return {
        "count": len(members),
        "soft_and_loose": sum(member["soft_and_loose"] for member in members),
        "through_share": {"median": round(float(np.median(through)), 6), "worst": max(through)},
        "fold_deg": _spread([m["fold_deg"] for m in members if m["fold_deg"] is not None] or [0.0]),
    }


def _reasons(humans: list[Human]) -> Counter[str]:
    """How often each was given; figures in a reason are left open."""
    return Counter(
        re.sub(r"\d+(\.\d+)?", "#", reason) for human in humans for reason in human.failed
    )


def _broken(humans: list[Human], pair: Pair | None) -> list[str]:
    fewest, most = TRIANGLES
    broken = [
        f"{human.subject} has {human.triangles} triangles, not {fewest} to {most}"
        for human in humans
        if not fewest <= human.triangles <= most
    ]
    broken += [
        f"{human.subject}: {garment['through_share']:.2%} of the {garment['garment']} is inside "
        f"the body, {THROUGH_LIMIT:.1%} or more"
        for human in humans
        for garment in human.garments
        if not garment["through_share"] < THROUGH_LIMIT
    ]
    if pair is not None and pair.alike:
        same = f"the same {' and '.join(pair.shared)}" if pair.shared else "almost the same draws"
        broken.append(f"{pair.first} and {pair.second} have {same}")
    return broken


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
        f"{making['median']:.1f} s; {f['peak_memory_mb'] / 1000:.2f} GB at most in a worker",
        f"rendering   {seconds['min']:.1f} to {seconds['max']:.1f} s a human, median "
        f"{seconds['median']:.1f} s",
        f"drapes      {f['drapes_thrown_away']} thrown away, of {f['humans_drawn_again']} humans",
        *(f"            {count} x {reason}" for reason, count in f["reasons"].items()),
    ]
    if f["garments"]:
        wide = max(len(name) for name in (*f["garments"], *f["classes"]))
        head = f"{'garment':{wide}}  count  soft+loose  inside the body   fold of the surface"
        under = f"{'':{wide}}                     median   worst   median  min to max"
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
    through, fold = g["through_share"], g["fold_deg"]
    return (
        f"{name:{wide}}  {g['count']:5d}  {g['soft_and_loose']:10d}  {through['median']:6.2%}  "
        f"{through['worst']:6.2%}  {fold['median']:5.1f}°  {fold['min']:.1f}° to {fold['max']:.1f}°"
    )


def main() -> int:
    """Print the card; returns the exit status: 1 if a bound is broken, 2 if there is no card."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of the dataset")
    parser.add_argument("--output", type=Path, help="JSON to write")
    options = parser.parse_args()
    try:
        figures = card(Dataset(options.data))
        if options.output is not None:
            options.output.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
        return 2
    print(text(figures))
    return 1 if figures["broken"] else 0


if __name__ == "__main__":
    sys.exit(main())
