"""Where every random number comes from: a key, never a global state."""

from __future__ import annotations

import hashlib
import json

import numpy as np


def generator(seed: int, subject: str, purpose: str, view: int = -1) -> np.random.Generator:
    """The generator of one (seed, subject, view, purpose), the same on any machine and worker.

    Args:
        seed: the dataset's seed.
        subject: the subject's id, or "" for a draw that concerns the whole dataset.
        purpose: what is drawn: "yaw", "sensor", "pose", ...
        view: the view's index; -1 for a draw that concerns the subject.
    """
    key = json.dumps([seed, subject, view, purpose]).encode()
    digest = hashlib.blake2b(key, digest_size=32).digest()
    return np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest, "little")))
