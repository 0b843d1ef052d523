"""Damage, drawn by hypothesis: bytes changed in a file, values exchanged in JSON."""

from __future__ import annotations

import copy
import struct
from typing import Any

from hypothesis import strategies as st

INTERESTING = [
    *(struct.pack("<B", n) for n in (0, 1, 0x0A, 0x20, 0x2D, 0x39, 0x5B, 0x7F, 0x80, 0xFF)),
    *(struct.pack("<i", n) for n in (0, -1, 2**31 - 1, -(2**31), 1 << 24)),
    *(struct.pack(">i", n) for n in (1, 2**31 - 1, 1 << 24)),
    *(struct.pack("<q", n) for n in (-1, 2**63 - 1, 10**12)),
    *(struct.pack("<f", n) for n in (float("nan"), float("inf"), 1e38)),
    *(b"999999999999", b"-1", b"1e999", b"nan", b"\n", b" ", b"/", b"\0" * 64, b"9" * 64),
]
"""What readers trip over: ends of ranges, signs, separators."""

ODD = [
    *(None, True, -1, 0, 2**31, 10**12, 10**30, 0.5, 1e308, -1e308, 1e-300, float("nan")),
    *("", "x", "../x", "/x", "\udcff", "\n", [], [0], [[]], [None], {}, {"x": 1}, {"uri": "x"}),
]
"""What may stand where JSON has another value."""


@st.composite
def edits(draw: st.DrawFn) -> list[tuple[str, float, float, bytes]]:
    """Changes for `damaged`: what is done, where, to how much, and with which bytes."""
    kinds = st.sampled_from(["flip", "write", "insert", "cut", "copy", "end"])
    place = st.floats(0, 1, allow_nan=False)
    content = st.sampled_from(INTERESTING) | st.binary(min_size=1, max_size=8)
    return draw(st.lists(st.tuples(kinds, place, place, content), min_size=1, max_size=6))


def damaged(data: bytes, changes: list[tuple[str, float, float, bytes]]) -> bytes:
    """`data` after these changes, one after the other."""
    for kind, where, much, content in changes:
        at = int(where * len(data))
        # most ranges are short
        end = at + int(much**4 * (len(data) - at))
        match kind:
            case "flip":
                bit = 1 << content[0] % 8
                data = data[:at] + bytes(byte ^ bit for byte in data[at : at + 1]) + data[at + 1 :]
            case "write":
                data = data[:at] + content + data[at + len(content) :]
            case "insert":
                data = data[:at] + content + data[at:]
            case "cut":
                data = data[:at] + data[end:]
            case "copy":
                data = data[:end] + data[at:end][:4096] + data[end:]
            case "end":
                data = data[:at]
    return data


def paths(value: Any, here: tuple = ()) -> list[tuple]:
    """The keys that lead to every value within `value`."""
    found = [here] if here else []
    if isinstance(value, dict | list):
        keys = value if isinstance(value, dict) else range(len(value))
        for key in keys:
            found += paths(value[key], (*here, key))
    return found


@st.composite
def exchanged(draw: st.DrawFn, value: Any) -> Any:
    """JSON with a few of its values exchanged or taken out."""
    value = copy.deepcopy(value)
    for _ in range(draw(st.integers(1, 3))):
        places = paths(value)
        if not places:
            break
        *above, last = draw(st.sampled_from(places))
        parent = value
        for key in above:
            parent = parent[key]
        if draw(st.booleans()) and draw(st.booleans()):
            del parent[last]
        else:
            parent[last] = copy.deepcopy(draw(st.sampled_from(ODD)))
    return value
