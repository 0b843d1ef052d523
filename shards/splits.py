"""Which subjects train and which test."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from typing import Literal

Split = Literal["train", "test"]
SPLITS: tuple[Split, ...] = ("train", "test")

_TEST_PART = 1 / 5


def split_subjects(subjects: Iterable[str], seed: int) -> dict[str, Split]:
    """Split by subject, 4:1, whatever order the ids come in.

    The subjects are ranked by a hash of (seed, id); the first fifth, to the nearest whole number,
    is the test set. From two subjects on it holds at least one.

    Args:
        subjects: the ids, each once.
        seed: the dataset's.

    Returns:
        id -> "train" or "test", in the order of the ids.
    """
    ids = sorted(subjects)
    ranked = sorted(ids, key=lambda subject: (_rank(seed, subject), subject))
    count = max(1, round(len(ids) * _TEST_PART)) if len(ids) >= 2 else 0
    test = set(ranked[:count])
    return {subject: "test" if subject in test else "train" for subject in ids}


def _rank(seed: int, subject: str) -> bytes:
    return hashlib.blake2b(json.dumps(["split", seed, subject]).encode()).digest()
