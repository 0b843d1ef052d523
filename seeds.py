"""Where every random number comes from: a key, never a global state."""

from __future__ import annotations

import hashlib
import json

import numpy as np


def generator(
    seed: int, subject: str, purpose: str, view: int = -1, draw: int = 0
) -> np.random.Generator:
    """The generator of one (seed, subject, view, purpose, draw): the same on any machine.

    Args:
        seed: the dataset's seed.
        subject: the subject's id, or "" for a draw that concerns the whole dataset.
        purpose: what is drawn: "yaw", "sensor", "pose", ...
        view: the view's index; -1 for a draw that concerns the subject.
        draw: which of several draws of the same.
    """
    key = json.dumps([seed, subject, view, purpose, *([draw] if draw else [])]).encode()
    digest = hashlib.blake2b(key, digest_size=32).digest()
    return np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest, "little")))
