"""Cloth by the texel: how it is woven, what pattern it carries, and its colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from subjects.open.base.ramp import ramp
from subjects.open.texture.brush import Clouds, mix
from subjects.open.texture.palette import Colour, contrasting, lightness, rounded

WEAVES = {
    "viscose": "plain",
    "jersey": "jersey",
    "cotton": "plain",
    "fleece": "brushed",
    "denim": "twill",
    "wool": "felt",
    "leather": "grain",
}
"""How each material of the outfit looks from near."""
# Weight of each pattern by garment; the rest is plain.
PATTERNS: dict[str, dict[str, float]] = {
    "tee": {"plain": 0.45, "stripes": 0.26, "heather": 0.20, "dots": 0.03, "block": 0.06},
    "shirt": {"plain": 0.30, "stripes": 0.05, "pinstripes": 0.20, "gingham": 0.15, "tartan": 0.22}
    | {"dots": 0.04, "flowers": 0.04},
    "sweater": {"plain": 0.40, "stripes": 0.22, "heather": 0.16, "block": 0.14, "jacquard": 0.08},
    "hoodie": {"plain": 0.56, "heather": 0.28, "block": 0.16},
    "dress": {"plain": 0.28, "flowers": 0.30, "dots": 0.16, "stripes": 0.12, "tartan": 0.06}
    | {"gingham": 0.08},
    "jacket": {"plain": 0.82, "heather": 0.18},
    "trousers": {"plain": 0.76, "pinstripes": 0.10, "heather": 0.14},
    "shorts": {"plain": 0.80, "heather": 0.10, "flowers": 0.10},
    "skirt": {"plain": 0.46, "tartan": 0.20, "flowers": 0.18, "dots": 0.10, "stripes": 0.06},
}
REPEATS = {
    "stripes": (0.022, 0.075),
    "pinstripes": (0.011, 0.024),
    "gingham": (0.014, 0.036),
    "tartan": (0.050, 0.110),
    "dots": (0.020, 0.042),
    "flowers": (0.034, 0.070),
    "jacquard": (0.060, 0.090),
}


@dataclass(frozen=True)
class Fabric:
    """One cloth: weave, pattern and colours."""

    weave: str
    """plain, jersey, brushed, twill, felt, knit or grain."""
    pattern: str
    """plain, stripes, pinstripes, gingham, tartan, dots, flowers, heather, block or jacquard."""
    base: Colour
    second: Colour
    third: Colour
    repeat: float
    """Metres on the template from one stripe or dot to the next."""
    wear: float
    """How far denim has faded where it is rubbed, 0 to 1."""


def draw_fabric(generator: np.random.Generator, kind: str, material: str, base: Colour) -> Fabric:
    """A cloth of colour `base` for a garment of this kind and material."""
    weave = WEAVES[material]
    if kind == "sweater" and material == "wool":
        weave = "knit"
    odds = PATTERNS[kind]
    pattern = str(
        generator.choice(list(odds), p=np.array(list(odds.values())) / sum(odds.values()))
    )
    if weave in ("twill", "grain"):
        pattern = "plain"
    second = contrasting(generator, base, 0.18 if pattern in ("stripes", "block") else 0.25)
    if weave == "twill":
        # Worn indigo shows its white weft.
        second = rounded(0.55 * np.array(base) + 0.45 * np.array([0.80, 0.84, 0.88]))
    elif pattern == "heather":
        tone = np.array(base)
        second = rounded(0.55 * tone + 0.45 if lightness(base) < 0.5 else 0.65 * tone)
    third = contrasting(generator, base, 0.12)
    low, high = REPEATS.get(pattern, (0.03, 0.03))
    return Fabric(
        weave,
        pattern,
        base,
        second,
        third,
        round(float(generator.uniform(low, high)), 4),
        round(float(generator.uniform(0.0, 1.0) ** 1.3), 3) if weave == "twill" else 0.0,
    )


def woven(fabric: Fabric, across: np.ndarray, along: np.ndarray, cloud: Clouds) -> np.ndarray:
    """(N, 3) float32 of a fabric at cloth coordinates in metres."""
    colour = np.empty((len(across), 3), dtype=np.float32)
    colour[:] = fabric.base
    colour = _patterned(fabric, colour, across, along, cloud)
    colour *= 1.0 + _weave(fabric.weave, across, along, cloud)[:, None]
    return colour


def _patterned(
    fabric: Fabric, colour: np.ndarray, across: np.ndarray, along: np.ndarray, cloud: Clouds
) -> np.ndarray:
    repeat, second, third = fabric.repeat, fabric.second, fabric.third

    def band(at: np.ndarray, width: float, every: float = repeat, shift: float = 0.0) -> np.ndarray:
        """1 within `width` of the repeat's start, else 0, with an edge one texel soft."""
        away = np.abs(((at - shift) / every + 0.5) % 1.0 - 0.5) * every
        return ramp(away, width / 2 + 0.0009, width / 2 - 0.0009)

    if fabric.weave == "twill":
        slub = cloud(np.stack([across, along], axis=1), (0.0022, 0.016))
        return mix(colour, second, 0.13 * (1 + slub))
    if fabric.pattern == "stripes":
        colour = mix(colour, second, band(along, repeat * 0.42))
        return mix(colour, third, band(along, 0.003, shift=repeat / 2) * (repeat > 0.05))
    if fabric.pattern == "pinstripes":
        return mix(colour, second, 0.75 * band(across, 0.0022))
    if fabric.pattern == "gingham":
        share = 0.5 * (band(along, repeat / 2) + band(across, repeat / 2))
        return mix(colour, second, share)
    if fabric.pattern == "tartan":
        for at in (along, across):
            colour = mix(colour, second, 0.42 * band(at, repeat * 0.36))
            colour = mix(colour, second, 0.35 * band(at, repeat * 0.06, shift=repeat * 0.28))
            colour = mix(colour, third, 0.55 * band(at, 0.0032, shift=repeat / 2))
        return colour
    if fabric.pattern == "dots":
        row = np.floor(along / repeat)
        du = ((across + 0.5 * repeat * (row % 2)) / repeat) % 1.0 - 0.5
        dv = (along / repeat) % 1.0 - 0.5
        radius = 0.19 * repeat
        return mix(
            colour, second, ramp(np.hypot(du, dv) * repeat, radius + 0.0009, radius - 0.0009)
        )
    if fabric.pattern == "flowers":
        return _flowers(fabric, colour, across, along, cloud)
    if fabric.pattern == "heather":
        fine = cloud(np.stack([across, along], axis=1), (0.0022, 0.010))
        return mix(colour, second, 0.20 * (1 + fine) + 0.05 * cloud.grain(len(across)))
    if fabric.pattern == "jacquard":
        # Bands of diamonds between two lines, as on a yoked sweater.
        v = along / repeat % 1.0
        u = np.abs(across / (repeat * 0.5) % 1.0 - 0.5)
        diamond = ramp(u + np.abs(v - 0.5) * 1.25, 0.34, 0.30)
        colour = mix(colour, second, diamond)
        colour = mix(colour, third, ramp(u + np.abs(v - 0.5) * 1.25, 0.16, 0.12))
        return mix(colour, third, band(along, 0.005))
    return colour


def _flowers(
    fabric: Fabric, colour: np.ndarray, across: np.ndarray, along: np.ndarray, cloud: Clouds
) -> np.ndarray:
    """Blossoms and leaves strewn one to a cell of the repeat."""
    for layer, (every, what) in enumerate(((1.0, "leaf"), (0.8, "blossom"))):
        repeat = fabric.repeat * every
        cell = np.stack([np.floor(across / repeat), np.floor(along / repeat)], axis=1)
        key = cell + 11.0 * layer
        shift = [0.24 * cloud(key, 1.0), 0.24 * cloud(key + 7.0, 1.0)]
        turn = 3.1 * cloud(key + 13.0, 1.0)
        large = 0.30 + 0.10 * cloud(key + 17.0, 1.0)
        du = across / repeat % 1.0 - 0.5 - shift[0]
        dv = along / repeat % 1.0 - 0.5 - shift[1]
        r, angle = np.hypot(du, dv), np.arctan2(dv, du) + turn
        soft = 0.0012 / repeat
        if what == "leaf":
            edge = large * 0.9 * np.abs(np.cos(angle)) ** 3
            colour = mix(colour, fabric.third, 0.8 * ramp(r - edge, soft, -soft))
        else:
            edge = large * (0.72 + 0.28 * np.cos(5 * angle))
            colour = mix(colour, fabric.second, ramp(r - edge, soft, -soft))
            core = np.array(fabric.base) * 0.4 + np.array([0.50, 0.38, 0.10])
            colour = mix(colour, core, ramp(r - 0.28 * large, soft, -soft))
    return colour


def _weave(weave: str, across: np.ndarray, along: np.ndarray, cloud: Clouds) -> np.ndarray:
    """(N,) relative lightness of threads, wales or grain."""
    flat = np.stack([across, along], axis=1)
    fine = cloud.grain(len(across))
    if weave == "twill":
        diagonal = np.stack([across + along, across - along], axis=1)
        return 0.06 * cloud(diagonal, (0.0028, 0.030)) + 0.045 * fine
    if weave == "knit":
        # Columns of V-shaped stitches.
        pitch = 0.0075
        column = np.abs(2.0 * (across / pitch % 1.0) - 1.0)
        stitch = np.cos(2 * np.pi * (along / pitch * 1.1 + 0.5 * column))
        return 0.07 * stitch - 0.13 * ramp(column, 0.72, 1.0) + 0.03 * fine
    if weave == "jersey":
        return 0.022 * fine + 0.018 * cloud(flat, (0.0020, 0.012))
    if weave == "brushed":
        return 0.028 * fine + 0.035 * cloud(flat, 0.0035)
    if weave == "felt":
        return 0.040 * fine + 0.030 * cloud(flat, (0.004, 0.003))
    if weave == "grain":
        creases = 1.0 - np.abs(cloud(flat, (0.012, 0.007)))
        return 0.05 * cloud(flat, 0.004) - 0.10 * ramp(creases, 0.9, 1.0) + 0.012 * fine
    return (
        0.026 * fine + 0.020 * cloud(flat, (0.0016, 0.016)) + 0.020 * cloud(flat, (0.016, 0.0016))
    )
