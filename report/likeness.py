"""How alike two humans of a set are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from report.human import ASPECTS, Human

ALIKE = 0.05
"""Difference of two humans, as `Pair` has it, below which they are alike; of 500 drawn by chance
the nearest two differ by 0.16."""

_ABSENT = -10.0


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


def most_alike(humans: Sequence[Human]) -> Pair | None:
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


def _pair(humans: Sequence[Human], a: int, b: int) -> Pair:
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
    """(N,) mean difference between `one` (K,) and each of `others` (N, K); 0 of no draws.

    A draw that neither has says nothing; one that only one of them has differs whole.
    """
    there = (one != _ABSENT) | (others != _ABSENT)
    apart = np.minimum(np.abs(others - one), 1).sum(axis=1)
    result: np.ndarray = apart / np.maximum(there.sum(axis=1), 1)
    return result
