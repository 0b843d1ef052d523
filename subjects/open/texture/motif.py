"""What is printed on a chest or a back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from subjects.open.base.ramp import ramp

EDGE = 0.0010
"""Half the width of a print's soft edge, metres."""
# A 3 x 5 letter each, rows from the top.
LETTERS = {
    "A": "010101111101101",
    "C": "111100100100111",
    "E": "111100110100111",
    "H": "101101111101101",
    "I": "111010010010111",
    "L": "100100100100111",
    "N": "111101101101101",
    "O": "111101101101111",
    "R": "110101110101101",
    "S": "111100111001111",
    "T": "111010010010010",
    "U": "101101101101111",
    "0": "111101101101111",
    "1": "010110010010111",
    "2": "111001111100111",
    "7": "111001010010010",
    "8": "111101111101111",
    "9": "111101111001111",
}
WORDS = ("COAST", "NORTH", "LOCAL", "OCEAN", "UNION", "RACE", "TRAIL", "SOLAR", "ECHO")


def motif(seed: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A print's first and second colour at cloth coordinates in metres, each (N,) in [0, 1].

    Args:
        x, y: from the print's centre, to its reader's right and up.
    """
    generator = np.random.default_rng(seed)
    kinds: list[Callable[..., tuple[np.ndarray, np.ndarray]]]
    kinds = [_ring, _star, _word, _bars, _mountains, _sunset, _number, _badge, _word]
    size = generator.uniform(0.85, 1.15)
    return kinds[int(generator.integers(len(kinds)))](generator, x / size, y / size)


def _inside(distance: np.ndarray) -> np.ndarray:
    """1 where a signed distance is negative."""
    return ramp(distance, EDGE, -EDGE)


def _text(text: str, x: np.ndarray, y: np.ndarray, block: float) -> np.ndarray:
    """Block letters around the origin, `block` metres the pixel."""
    column = np.floor(x / block + 2.0 * len(text) - 0.5).astype(int)
    row = np.floor(2.5 - y / block).astype(int)
    bits = np.zeros((5, 4 * len(text)), dtype=np.float32)
    for k, letter in enumerate(text):
        bits[:, 4 * k : 4 * k + 3] = np.array(list(LETTERS[letter]), dtype=int).reshape(5, 3)
    inside = (row >= 0) & (row < 5) & (column >= 0) & (column < bits.shape[1])
    return np.where(inside, bits[row.clip(0, 4), column.clip(0, bits.shape[1] - 1)], 0.0)


def _ring(_: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r = np.hypot(x, y)
    return _inside(np.abs(r - 0.066) - 0.012), _inside(r - 0.034)


def _star(_: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    turn = (angle - np.pi / 2 + np.pi / 5) % (2 * np.pi / 5) - np.pi / 5
    # The line from a point of the star to the notch beside it.
    edge = 0.030 / np.maximum(np.cos(np.abs(turn) - np.radians(72)), 0.05)
    return _inside(r - np.minimum(edge, 0.09)), np.zeros_like(x)


def _word(g: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    word = WORDS[int(g.integers(len(WORDS)))]
    first = _text(word, x, y - 0.012, 0.0098)
    rule = _inside(np.maximum(np.abs(x) - 0.095, np.abs(y + 0.028) - 0.003))
    small = "".join(g.choice(list("012789"), 4))
    return np.maximum(first, _text(small, x, y + 0.046, 0.004)), rule


def _number(g: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    digits = "".join(g.choice(list("12789"), 2))
    inner = _text(digits, x, y, 0.026)
    shadow = _text(digits, x - 0.006, y + 0.006, 0.026)
    return inner, np.maximum(shadow - inner, 0.0)


def _bars(_: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    wide = ramp(np.abs(x), 0.115 + EDGE, 0.115 - EDGE)
    outer = np.maximum(_inside(np.abs(y - 0.03) - 0.010), _inside(np.abs(y + 0.03) - 0.010))
    return outer * wide, _inside(np.abs(y) - 0.010) * wide


def _mountains(
    _: np.random.Generator, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    near, far = 0.055 - 1.25 * np.abs(x + 0.022), 0.030 - 1.1 * np.abs(x - 0.050)
    floor = _inside(-y - 0.05) * ramp(np.abs(x), 0.112, 0.110)
    snow = _inside(y - near) * _inside(0.030 + 0.006 * np.sin(500 * x) - y)
    return _inside(y - np.maximum(near, far)) * floor * (1 - snow), _inside(
        np.hypot(x - 0.055, y - 0.058) - 0.017
    )


def _sunset(_: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    disc = _inside(np.hypot(x, y) - 0.075)
    gaps = ((y + 0.08) % 0.016 < 0.0045) & (y < 0.015)
    return disc * ~gaps, _inside(np.maximum(np.abs(y + 0.088) - 0.003, np.abs(x) - 0.075))


def _badge(g: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    field = np.maximum(np.abs(x) - 0.085, np.abs(y) - 0.060) - 0.008
    word = WORDS[int(g.integers(len(WORDS)))]
    letters = _text(word, x, y, 0.0072)
    return _inside(field) * (1 - letters), _inside(np.abs(field + 0.006) - 0.0016) + letters
