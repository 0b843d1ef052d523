"""The geometry of an OBJ file, read without any of the code that the renderer's surface comes by.

Only `v`, `vn` and `f` lines count. Of these the whole format is read: polygons, indices counted
from the end, every form of a corner (`1`, `1/2`, `1//3`, `1/2/3`), comments, continued lines.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

LONGEST_NUMBER = 100
"""Letters of a number; exact ones take about 25."""

_CORNER = re.compile(rb"(?<!\S)(-?\d+)(?:/-?\d*(?:/(-?\d*))?)?(?!\S)")


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (N, 3), triangles (F, 3) and normals (N, 3), 0 where the file names none.

    A vertex is one pair of a position and a normal that some corner names. A polygon becomes a
    fan around its first corner.

    Raises:
        ValueError: at text that is no number, and at an index without its line.
        OSError: if the file cannot be read.
    """
    lines: dict[bytes, list[bytes]] = {b"v": [], b"vn": [], b"f": []}
    before = []  # how many positions and normals stand above each face
    for line in re.sub(rb"\\\r?\n", b" ", path.read_bytes()).splitlines():
        kind, rest = (*line.partition(b"#")[0].split(None, 1), b"", b"")[:2]
        if kind in lines:
            lines[kind].append(rest)
            if kind == b"f":
                before.append((len(lines[b"v"]), len(lines[b"vn"])))
    positions, given = _triples(lines[b"v"]), _triples(lines[b"vn"])

    found = _CORNER.findall(b" ".join(lines[b"f"]))
    count = np.array([len(line.split()) for line in lines[b"f"]], dtype=np.int64)
    if len(found) != count.sum():
        raise ValueError("a face has a corner that is no index")
    above = np.repeat(np.array(before, dtype=np.int64).reshape(-1, 2), count, axis=0)
    position = _resolve([first for first, _ in found], above[:, 0], len(positions))
    normal = _resolve([last or b"0" for _, last in found], above[:, 1], len(given))
    if (position < 0).any():
        raise ValueError("a face names vertex 0, but they count from 1")

    pairs = position * (len(given) + 1) + normal + 1
    pairs, corner = np.unique(pairs, return_inverse=True)
    where, which = np.divmod(pairs, len(given) + 1)
    normals = np.concatenate([np.zeros((1, 3)), given])[which]

    fan = np.maximum(count - 2, 0)
    start = np.repeat(np.cumsum(count) - count, fan)
    step = np.arange(fan.sum()) - np.repeat(np.cumsum(fan) - fan, fan)
    faces = corner[np.column_stack([start, start + step + 1, start + step + 2])]
    return positions[where], faces, normals


def _triples(lines: list[bytes]) -> np.ndarray:
    """(N, 3) float64: the first three numbers of each line."""
    rows = [line.split(None, 3)[:3] for line in lines]
    if any(len(row) < 3 for row in rows):
        raise ValueError("a line has fewer than 3 numbers")
    return _table([word for row in rows for word in row]).reshape(-1, 3).astype(np.float64)


def _table(words: list[bytes]) -> np.ndarray:
    """The words as an array, each of which takes as much as the longest."""
    if max(map(len, words), default=0) > LONGEST_NUMBER:
        raise ValueError(f"a number has over {LONGEST_NUMBER} letters")
    return np.array(words, dtype=np.bytes_)


def _resolve(words: list[bytes], above: np.ndarray, count: int) -> np.ndarray:
    """Indices from 0; an index of 0, which names nothing, becomes -1."""
    named = _table(words).astype(np.int64)
    index = np.where(named < 0, named + above, named - 1)
    if ((index >= count) | ((index < 0) & (named != 0))).any():
        raise ValueError(f"a face names a line that is none of the file's {count}")
    return index
