"""The colours of one human, painted over the atlas: skin, face, hair, fabrics, shoes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from subjects.open import garments, hair
from subjects.open.atlas import GROUPS, HAIR, texels
from subjects.open.garments import Outfit, arm_length, ramp
from subjects.open.template import BODY, EYES, SKIRT, TIGHTS, template

Colour = tuple[float, float, float]

# sRGB of skin from the lightest to the darkest of the Monk scale's range, untanned to deep.
SKIN = (
    np.array(
        [
            [246, 224, 205],
            [238, 205, 180],
            [224, 180, 148],
            [203, 152, 117],
            [172, 120, 86],
            [137, 92, 64],
            [102, 67, 48],
            [72, 47, 36],
        ]
    )
    / 255.0
)
HAIR_COLOURS: dict[str, tuple[int, int, int]] = {
    "black": (28, 24, 23),
    "dark brown": (52, 36, 27),
    "brown": (88, 60, 40),
    "light brown": (128, 92, 60),
    "blond": (186, 150, 98),
    "red": (134, 66, 36),
    "grey": (140, 137, 133),
    "white": (208, 205, 200),
}
EYE_COLOURS: dict[str, tuple[int, int, int]] = {
    "dark brown": (58, 36, 22),
    "brown": (98, 64, 36),
    "hazel": (120, 96, 52),
    "green": (96, 118, 80),
    "blue": (88, 124, 158),
    "grey": (120, 130, 136),
}
FABRICS: tuple[tuple[int, int, int], ...] = (
    (235, 233, 228),
    (38, 40, 44),
    (32, 48, 84),
    (60, 92, 140),
    (122, 158, 196),
    (140, 36, 42),
    (196, 74, 58),
    (224, 168, 60),
    (84, 104, 62),
    (46, 78, 62),
    (150, 132, 108),
    (208, 190, 164),
    (108, 70, 110),
    (212, 150, 160),
    (128, 128, 130),
    (70, 52, 44),
    (88, 160, 156),
)
DENIM: tuple[tuple[int, int, int], ...] = (
    (46, 62, 96),
    (70, 92, 128),
    (36, 40, 52),
    (110, 132, 160),
)
TROUSERS: tuple[tuple[int, int, int], ...] = (
    (38, 40, 44),
    (84, 84, 86),
    (150, 132, 104),
    (196, 178, 148),
    (64, 70, 54),
    (40, 48, 70),
    (92, 66, 50),
)
SHOES: tuple[tuple[int, int, int], ...] = (
    (236, 236, 234),
    (30, 30, 32),
    (92, 60, 38),
    (60, 72, 110),
    (150, 40, 44),
    (120, 122, 124),
)


@dataclass(frozen=True)
class Fabric:
    """One cloth: base colour, second colour, and how they are laid out."""

    pattern: str
    """plain, stripes, pinstripes, checks, dots, heather or denim."""
    base: Colour
    second: Colour
    repeat: float
    """Metres on the template from one stripe or dot to the next."""


@dataclass(frozen=True)
class Look:
    """The colours of one human and what is printed on the clothes."""

    skin: Colour
    lips: Colour
    hair_style: str
    hair_name: str
    hair: Colour
    beard: float
    """0 none, up to 1 a full beard."""
    eye_name: str
    eyes: Colour
    top: Fabric
    bottom: Fabric
    collar: Colour
    front: str
    """What the front of the top carries: buttons, zip, print, pocket or nothing."""
    motif: Colour
    print_seed: int
    belt: Colour | None
    shoes: Colour
    soles: Colour

    def as_json(self) -> dict[str, Any]:
        """The colours, JSON-ready."""
        return asdict(self)


def _rounded(rgb: np.ndarray) -> Colour:
    r, g, b = np.clip(np.round(rgb, 4), 0.0, 1.0).tolist()
    return (r, g, b)


def _pick(generator: np.random.Generator, palette: tuple[tuple[int, int, int], ...]) -> Colour:
    base = np.array(palette[generator.integers(len(palette))]) / 255.0
    return _rounded(base + generator.normal(0, 0.02, 3))


def _fabric(generator: np.random.Generator, colours: tuple[tuple[int, int, int], ...]) -> Fabric:
    kinds = ["plain", "stripes", "pinstripes", "checks", "dots", "heather"]
    pattern = str(generator.choice(kinds, p=[0.30, 0.22, 0.10, 0.18, 0.08, 0.12]))
    base = _pick(generator, colours)
    second = _pick(generator, FABRICS)
    while sum(abs(a - b) for a, b in zip(base, second, strict=True)) < 0.35:
        second = _pick(generator, FABRICS)
    spans = {"stripes": (0.024, 0.07), "pinstripes": (0.014, 0.024), "checks": (0.028, 0.06)}
    low, high = spans.get(pattern, (0.024, 0.045))
    return Fabric(pattern, base, second, round(float(generator.uniform(low, high)), 4))


def draw_look(
    generator: np.random.Generator, phenotype: dict[str, float], age: float, outfit: Outfit
) -> Look:
    """Colours that go with the phenotype: skin and hair by descent, grey with age."""
    share = np.array([phenotype[k] for k in ("caucasian", "asian", "african")])
    share = share**2 / (share**2).sum()
    depth = share @ [0.16, 0.36, 0.78] + generator.normal(0, 0.10)
    at = float(np.clip(depth, 0.0, 1.0)) * (len(SKIN) - 1)
    tone = np.array([np.interp(at, np.arange(len(SKIN)), SKIN[:, k]) for k in range(3)])
    tone = tone * (1.0 + generator.normal(0, 0.015, 3))
    lips = tone * [0.86, 0.68, 0.67] + [0.02, 0.0, 0.005]
    male = phenotype["gender"] < 0.5
    fair = share[0] * (1.0 - np.clip(depth, 0, 1))
    names = list(HAIR_COLOURS)[:6]
    odds = np.array([1.0, 1.2, 1.6 * fair, 1.2 * fair, 1.2 * fair, 0.5 * fair])
    name = str(generator.choice(names, p=odds / odds.sum()))
    if generator.random() < np.clip((age - 42) / 35, 0.0, 0.9):
        name = str(generator.choice(["grey", "white"], p=[0.65, 0.35]))
    if male:
        style = str(generator.choice(hair.STYLES, p=[0.10, 0.28, 0.50, 0.04, 0.04, 0.03, 0.01]))
    else:
        style = str(generator.choice(hair.STYLES, p=[0.0, 0.04, 0.14, 0.24, 0.28, 0.18, 0.12]))
    eye_odds = np.array([1.0, 0.9, 0.6 * fair, 0.4 * fair, 1.2 * fair, 0.5 * fair])
    eye = str(generator.choice(list(EYE_COLOURS), p=eye_odds / eye_odds.sum()))
    beard = float(generator.choice([0.0, 0.35, 1.0], p=[0.5, 0.3, 0.2])) if male else 0.0
    top = _fabric(generator, FABRICS)
    if outfit.bottom == "skirt":
        bottom = top if generator.random() < 0.4 else _fabric(generator, FABRICS)
    elif generator.random() < 0.5:
        base = _pick(generator, DENIM)
        bottom = Fabric("denim", base, _rounded(np.array(base) * 1.25 + 0.03), 0.03)
    else:
        base = _pick(generator, TROUSERS)
        kind = str(generator.choice(["plain", "heather", "pinstripes"], p=[0.6, 0.25, 0.15]))
        bottom = Fabric(kind, base, _rounded(np.array(base) * 0.8 + 0.12), 0.018)
    if outfit.neckline == "shirt":
        front = "buttons" if generator.random() < 0.8 else "zip"
    else:
        front = str(generator.choice(["print", "pocket", "nothing", "zip"], p=[0.5, 0.2, 0.2, 0.1]))
    collar = top.base if generator.random() < 0.6 else top.second
    shoes = _pick(generator, SHOES)
    soles = shoes if generator.random() < 0.3 else _pick(generator, ((238, 236, 230), (40, 38, 36)))
    belt = None
    if outfit.tucked or generator.random() < 0.5:
        belt = _pick(generator, ((40, 30, 26), (96, 62, 38), (26, 26, 28)))
    return Look(
        _rounded(tone),
        _rounded(lips),
        style,
        name,
        _rounded(np.array(HAIR_COLOURS[name]) / 255.0 * (1 + generator.normal(0, 0.06))),
        beard,
        eye,
        _rounded(np.array(EYE_COLOURS[eye]) / 255.0 * (1 + generator.normal(0, 0.06))),
        top,
        bottom,
        collar,
        front,
        _pick(generator, FABRICS),
        int(generator.integers(2**31)),
        belt,
        shoes,
        soles,
    )


def paint(look: Look, outfit: Outfit, size: int, generator: np.random.Generator) -> np.ndarray:
    """The atlas, (size, size, 3) uint8 sRGB, row 0 at the top."""
    baked = texels(size)
    colour = np.zeros((len(baked.pixel), 3))
    cloud = _Clouds(generator)
    painters = {
        BODY: lambda p, s: _skin(look, p, s, cloud),
        TIGHTS: lambda p, s: _clothes(look, outfit, p, cloud),
        SKIRT: lambda p, s: _skirt(look, outfit, p, cloud),
        EYES[0]: lambda p, s: _eye(look, p, "l-eye", cloud),
        EYES[1]: lambda p, s: _eye(look, p, "r-eye", cloud),
        HAIR: lambda p, s: _strands(look, s, cloud),
    }
    for name, painter in painters.items():
        chosen = baked.group == GROUPS.index(name)
        colour[chosen] = painter(baked.place[chosen], baked.source[chosen])
    picture = np.round(np.clip(colour, 0.0, 1.0) * 255.0).astype(np.uint8)
    return picture[baked.nearest].reshape(size, size, 3)


class _Clouds:
    """Smooth random values in [-1, 1] over space."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._lattice = generator.uniform(-1, 1, (32, 32, 32)).astype(np.float32)

    def __call__(self, place: np.ndarray, size: float | tuple[float, ...]) -> np.ndarray:
        """(N,) values at (N, D <= 3) places; `size` is the clouds' size in the places' unit."""
        at = np.zeros((3, len(place)))
        at[: place.shape[1]] = (place / np.asarray(size)).T
        return map_coordinates(self._lattice, at % 32, order=1, mode="grid-wrap")


def _mix(a: np.ndarray, b: np.ndarray | Colour, share: np.ndarray) -> np.ndarray:
    """(N, 3): `a` where share (N,) is 0, `b` where it is 1."""
    return a + np.clip(share, 0.0, 1.0)[:, None] * (np.asarray(b) - a)


def _hair_colour(look: Look, strands: np.ndarray) -> np.ndarray:
    """(N, 3) for strands of brightness (N,) in [-1, 1]."""
    base = np.array(look.hair)
    return base * (1.0 + 0.18 * strands[:, None]) + 0.014 * strands[:, None]


def _skin(look: Look, place: np.ndarray, source: np.ndarray, cloud: _Clouds) -> np.ndarray:
    x, y, z = place.T
    tone = np.broadcast_to(np.array(look.skin), (len(place), 3))
    mottle = 0.020 * cloud(place, 0.03) + 0.016 * cloud(place, 0.008) + 0.012 * cloud(place, 0.003)
    colour = tone * (1.0 + mottle[:, None])
    red = np.array(look.skin) * [1.02, 0.80, 0.78]
    head = y > 0.62
    face = head & (z > 0.06)
    # Cheeks, nose, ears, knuckles and palms are redder.
    cheek = np.exp(-(((np.abs(x) - 0.042) / 0.02) ** 2) - ((y - 0.694) / 0.02) ** 2)
    nose = np.exp(-((x / 0.012) ** 2) - ((y - 0.694) / 0.012) ** 2)
    colour = _mix(colour, red, np.where(face, 0.26 * cheek + 0.25 * nose, 0.0))
    colour = _mix(colour, red, 0.35 * hair.masked("ears", source) * head)
    colour = _mix(colour, look.lips, 0.75 * hair.masked("lips", source))
    nails = hair.masked("fingernails", source) + hair.masked("toenails", source)
    colour = _mix(colour, np.array(look.skin) * 0.7 + [0.30, 0.24, 0.24], 0.7 * nails)
    colour = _mix(
        colour, np.array(look.skin) * [0.6, 0.3, 0.3], hair.masked("inside-mouth", source)
    )

    eye = template().joints["l-eye"]
    ex, ey = np.abs(x) - eye[0], y - eye[1]
    # The lids' edge is dark with lashes; the lid above it a little darker than the cheek.
    ring = np.hypot(ex / 0.0165, (ey + 0.0005) / 0.0075)
    lashes = np.exp(-(((ring - 1.0) / 0.13) ** 2)) * np.where(ey > 0, 1.0, 0.35)
    near = face & (z > 0.085)
    colour = _mix(
        colour, np.array(look.skin) * 0.80, np.where(near, 0.6 * np.exp(-((ring / 1.9) ** 4)), 0)
    )
    colour = _mix(colour, np.array(look.hair) * 0.4 + 0.02, np.where(near, 0.75 * lashes, 0.0))
    # Brows arch over the eye and thin out towards the temple.
    t = (np.abs(x) - 0.012) / 0.043
    arch = eye[1] + 0.0215 + 0.0035 * np.sin(np.pi * np.clip(t, 0, 1) * 0.8)
    width = 0.0042 * (1.0 - 0.55 * np.clip(t, 0, 1))
    fine = cloud(place, (0.0016, 0.004, 0.004))
    brow = np.exp(-(((y - arch) / width) ** 2)) * ramp(t, -0.08, 0.08) * ramp(t, 1.08, 0.85)
    brow_colour = np.array(look.hair) * 0.75
    colour = _mix(colour, brow_colour, np.where(face, brow * (0.85 + 0.35 * fine), 0.0))
    if look.beard > 0:
        jaw = ramp(y, 0.700, 0.672) * ramp(y, 0.585, 0.612) * ramp(z, 0.035, 0.06)
        lip = np.exp(-(((y - 0.676) / 0.006) ** 2)) * (np.abs(x) < 0.026) * (z > 0.12)
        cheekline = ramp(np.abs(x) * 0.55 + 0.655 - y, -0.012, 0.004)
        where = np.maximum(jaw * cheekline, lip) * (1 - hair.masked("lips", source))
        colour = _mix(colour, _hair_colour(look, fine), where * look.beard * (0.7 + 0.4 * fine))
    if look.hair_style != "bald":
        grown = hair.growth(place, source) + 0.005 * cloud(place, 0.006) + 0.003 * fine
        around = np.arctan2(x, z - 0.04)
        strand = 0.6 * cloud(np.stack([around, y], axis=1), (0.035, 0.35)) + 0.4 * fine
        colour = np.where(
            head[:, None],
            _mix(colour, _hair_colour(look, strand), ramp(grown, -0.002, 0.006)),
            colour,
        )
    else:
        grown = hair.growth(place, source)
        shadow = 0.25 * ramp(grown, -0.005, 0.02) * (0.8 + 0.3 * fine)
        colour = np.where(head[:, None], _mix(colour, np.array(look.hair), shadow), colour)
    return colour


def _eye(look: Look, place: np.ndarray, joint: str, cloud: _Clouds) -> np.ndarray:
    centre = template().joints[joint]
    forward = place - centre
    length = np.maximum(np.linalg.norm(forward, axis=1), 1e-9)
    off = np.degrees(np.arccos(np.clip(forward[:, 2] / length, -1, 1)))
    white = np.full((len(place), 3), [0.93, 0.91, 0.89])
    white = _mix(white, (0.85, 0.62, 0.58), 0.5 * ramp(off, 45, 90))
    around = np.arctan2(forward[:, 1], forward[:, 0])
    rays = cloud(np.stack([around, off], axis=1), (0.12, 14.0))
    iris = np.array(look.eyes) * (1.0 + 0.35 * rays[:, None])
    iris = iris * (1.0 - 0.55 * ramp(off, 22, 27)[:, None])
    colour = _mix(white, iris, ramp(off, 28.5, 26.5))
    return _mix(colour, (0.02, 0.02, 0.02), ramp(off, 12.0, 10.5))


def _strands(look: Look, source: np.ndarray, cloud: _Clouds) -> np.ndarray:
    strand = 0.6 * cloud(source, (0.011, 0.6)) + 0.4 * cloud(source, (0.004, 0.25))
    return _hair_colour(look, strand)


def _woven(fabric: Fabric, across: np.ndarray, along: np.ndarray, cloud: _Clouds) -> np.ndarray:
    """(N, 3) of a fabric at cloth coordinates in metres."""
    flat = np.stack([across, along], axis=1)
    colour = np.broadcast_to(np.array(fabric.base), (len(across), 3))
    soft = 0.0012
    repeat = fabric.repeat

    def band(at: np.ndarray, width: float) -> np.ndarray:
        """1 within `width` of the repeat's start, else 0, with an edge one texel soft."""
        away = np.abs((at / repeat + 0.5) % 1.0 - 0.5) * repeat
        return ramp(away, width / 2 + soft, width / 2 - soft)

    if fabric.pattern == "stripes":
        colour = _mix(colour, fabric.second, band(along, repeat / 2))
    elif fabric.pattern == "pinstripes":
        colour = _mix(colour, fabric.second, 0.8 * band(across, 0.0032))
    elif fabric.pattern == "checks":
        share = 0.5 * (band(along, repeat / 2.2) + band(across, repeat / 2.2))
        colour = _mix(colour, fabric.second, share)
    elif fabric.pattern == "dots":
        row = np.floor(along / repeat)
        du = ((across + 0.5 * repeat * (row % 2)) / repeat) % 1.0 - 0.5
        dv = (along / repeat) % 1.0 - 0.5
        colour = _mix(colour, fabric.second, ramp(np.hypot(du, dv) * repeat, 0.0065, 0.005))
    elif fabric.pattern == "heather":
        colour = _mix(colour, fabric.second, 0.22 * (1 + cloud(flat, (0.0025, 0.006))))
    elif fabric.pattern == "denim":
        wear = 0.12 * (1 + cloud(flat, (0.0025, 0.008))) + 0.2 * (1 + cloud(flat, 0.11))
        colour = _mix(colour, fabric.second, wear)
    weave = 0.022 * cloud(flat, 0.0022) + 0.018 * cloud(flat, 0.03)
    return colour * (1.0 + weave[:, None])


def _line(distance: np.ndarray, width: float = 0.0016) -> np.ndarray:
    """1 on a seam, 0 beside it."""
    return ramp(np.abs(distance), width * 1.6, width * 0.5)


def _box(
    x: np.ndarray, y: np.ndarray, centre: tuple[float, float], half: tuple[float, float]
) -> np.ndarray:
    """Signed distance to a rectangle's edge, negative inside."""
    return np.maximum(np.abs(x - centre[0]) - half[0], np.abs(y - centre[1]) - half[1])


def _clothes(look: Look, outfit: Outfit, place: np.ndarray, cloud: _Clouds) -> np.ndarray:
    x, y, z = place.T
    length = arm_length(place)
    on_arm = (np.abs(x) > 0.20) & (y > 0.1) & (length > 0.12)
    colour = np.empty((len(place), 3))
    foot = (garments.shoe_field(outfit, place) < 0.004) & (y < max(outfit.cuff, outfit.shoe))
    leg = ~on_arm & bottom_part(outfit, place)
    trunk = ~on_arm & ~leg
    colour[on_arm] = _woven(look.top, z[on_arm], 0.22 * length[on_arm], cloud)
    around = 0.15 * np.arctan2(x, z - 0.02)
    colour[trunk] = _woven(look.top, around[trunk], y[trunk], cloud)
    colour[leg] = _woven(look.bottom, _around_leg(place[leg]), y[leg], cloud)
    colour = np.where(trunk[:, None], _front(look, outfit, place, colour, cloud), colour)
    seam = np.array(look.top.base) * 0.72
    cuff = np.where(on_arm, _line(0.22 * (length - outfit.sleeve) + 0.018), 0.0)
    armhole = np.where(on_arm, _line(length - 0.135, 0.008), 0.0)
    hem = np.where(trunk, _line(y - garments.hem_height(outfit, place) - 0.018), 0.0)
    colour = _mix(colour, seam, 0.8 * np.maximum.reduce([cuff, armhole, hem]))
    neck = garments.neckline_field(place, outfit.neckline)
    band = ramp(neck, -garments.COLLAR_WIDTH - 0.001, -garments.COLLAR_WIDTH + 0.001)
    colour = np.where(trunk[:, None], _mix(colour, look.collar, band * (y > 0.35)), colour)
    colour = np.where(
        trunk[:, None],
        _mix(colour, np.array(look.collar) * 0.7, _line(neck + garments.COLLAR_WIDTH) * (y > 0.35)),
        colour,
    )
    if outfit.bottom == "trousers":
        colour = np.where(leg[:, None], _trousers(look, outfit, place, colour), colour)
    return np.where(foot[:, None], _shoes(look, outfit, place, cloud), colour)


def _around_leg(place: np.ndarray) -> np.ndarray:
    """(N,) metres around the leg or, above the crotch, around the hips."""
    x, y, z = place.T
    joints = template().joints
    line = np.array([joints[f"l-{name}"] for name in ("ankle", "knee", "upper-leg")])
    side = np.abs(x) - np.interp(y, line[:, 1], line[:, 0])
    leg = 0.075 * np.arctan2(side * np.sign(x), z - np.interp(y, line[:, 1], line[:, 2]))
    hips = 0.15 * np.arctan2(x, z - 0.02)
    return np.where(y > -0.04, hips, leg)


def bottom_part(outfit: Outfit, place: np.ndarray) -> np.ndarray:
    """Where the suit's texture shows trousers rather than the top; the two never share a texel."""
    if outfit.tucked:
        edge = garments.waist_height(outfit, place) + 0.004
    else:
        edge = garments.hem_height(outfit, place) - 0.004
    return place[:, 1] < edge


def _front(
    look: Look, outfit: Outfit, place: np.ndarray, colour: np.ndarray, cloud: _Clouds
) -> np.ndarray:
    x, y, z = place.T
    front = z > 0.03
    dark = np.array(look.top.base) * 0.62
    if look.front == "buttons":
        placket = np.maximum(_line(x - 0.016, 0.0013), _line(x + 0.016, 0.0013))
        colour = _mix(colour, dark, np.where(front, 0.7 * placket, 0.0))
        spacing = 0.072
        dy = (y - 0.50 + spacing / 2) % spacing - spacing / 2
        button = ramp(np.hypot(x, dy), 0.0075, 0.0060) * (y < 0.51)
        hole = ramp(np.hypot(np.abs(x) - 0.0018, dy), 0.0013, 0.0007)
        face = np.array(look.motif) if look.motif != look.top.base else dark
        colour = _mix(colour, face, np.where(front, button, 0.0))
        colour = _mix(colour, face * 0.3, np.where(front, hole * button, 0.0))
    elif look.front == "zip":
        tape = ramp(np.abs(x), 0.009, 0.0075)
        teeth = ramp(np.abs(x), 0.0038, 0.0028)
        step = ((y / 0.008) % 1.0 < 0.5).astype(float)
        colour = _mix(colour, dark, np.where(front, 0.9 * tape, 0.0))
        colour = _mix(
            colour, (0.72, 0.72, 0.74), np.where(front, teeth * (0.55 + 0.45 * step), 0.0)
        )
    elif look.front == "print":
        colour = _mix(colour, look.motif, np.where(front, _motif(look.print_seed, x, y), 0.0))
    if look.front in ("pocket", "buttons"):
        box = _box(x, y, (0.075, 0.40), (0.036, 0.042))
        edge = np.maximum(_line(box), _line(y - 0.43) * (box < 0))
        colour = _mix(colour, dark, np.where(front, 0.8 * edge, 0.0))
    # Yoke across the back of shirts, a label's stripe on jerseys.
    back = z < -0.02
    if outfit.neckline == "shirt":
        colour = _mix(colour, dark, np.where(back, 0.7 * _line(y - 0.475), 0.0))
        colour = _mix(colour, dark, np.where(back, 0.6 * _line(x) * (y < 0.475), 0.0))
    else:
        label = _box(x, y, (0.0, 0.535), (0.020, 0.006))
        colour = _mix(colour, look.motif, np.where(back, ramp(label, 0.001, -0.001), 0.0))
    return colour


def _motif(seed: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A print on the chest, (N,) in [0, 1]."""
    generator = np.random.default_rng(seed)
    kind = int(generator.integers(5))
    cy = 0.355
    dx, dy = x, y - cy
    r, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
    edge = 0.0015
    if kind == 0:
        return ramp(np.abs(r - 0.062), 0.016 + edge, 0.016 - edge)
    if kind == 1:
        star = 0.078 * (0.62 + 0.38 * np.cos(5 * (angle - np.pi / 2)) ** 3)
        return ramp(r - star, edge, -edge)
    if kind == 2:
        # Rows of blocks, like words seen from afar.
        row = np.floor((dy + 0.06) / 0.04)
        inside = (np.abs(dx) < 0.095) & (np.abs(dy) < 0.06) & (((dy + 0.06) % 0.04) < 0.026)
        table = generator.random((4, 24)) < 0.68
        column = np.clip((dx + 0.096) / 0.008, 0, 23).astype(int)
        return (inside & table[np.clip(row, 0, 3).astype(int), column]).astype(float)
    if kind == 3:
        return np.maximum.reduce(
            [ramp(np.abs(dy - k * 0.03), 0.009 + edge, 0.009 - edge) for k in (-1, 0, 1)]
        ) * ramp(np.abs(dx), 0.10, 0.097)
    mountain = np.minimum(0.06 - 1.25 * np.abs(dx + 0.02), 0.06)
    second = 0.03 - 1.1 * np.abs(dx - 0.045)
    hill = np.maximum(mountain, second)
    return ramp(dy - hill, edge, -edge) * (dy > -0.05) * ramp(np.abs(dx), 0.10, 0.097)


def _trousers(look: Look, outfit: Outfit, place: np.ndarray, colour: np.ndarray) -> np.ndarray:
    x, y, z = place.T
    stitch = np.array(look.bottom.base) * 0.6
    if look.bottom.pattern == "denim":
        stitch = np.array([0.78, 0.56, 0.28])
    under = garments.waist_height(outfit, place) - y
    marks = _line(under - 0.036)
    front, back = z > 0.03, z < -0.02
    marks = np.maximum(marks, np.where(front, _line(x) * (y > 0.0) * (under > 0.036), 0.0))
    slant = np.abs(x) - 0.105 - 0.45 * (under - 0.09)
    marks = np.maximum(marks, np.where(front, _line(slant) * (under > 0.036) * (under < 0.15), 0.0))
    box = _box(np.abs(x), y, (0.082, 0.000), (0.043, 0.048))
    marks = np.maximum(
        marks, np.where(back, np.maximum(_line(box), _line(y - 0.03) * (box < 0)), 0)
    )
    marks = np.maximum(marks, np.where(back, _line(x) * (under > 0.036) * (y > -0.06), 0.0))
    marks = np.maximum(marks, _line(y - outfit.cuff - 0.02))
    colour = _mix(colour, stitch, 0.8 * marks)
    if look.belt is not None:
        band = ramp(np.abs(under - 0.018), 0.0155, 0.0145)
        colour = _mix(colour, look.belt, band)
        buckle = _box(x, under, (0.0, 0.018), (0.019, 0.014))
        frame = ramp(np.abs(buckle + 0.003), 0.0032, 0.0022)
        colour = _mix(colour, (0.72, 0.70, 0.64), np.where(front, frame, 0.0))
    return colour


def _skirt(look: Look, outfit: Outfit, place: np.ndarray, cloud: _Clouds) -> np.ndarray:
    around = np.arctan2(place[:, 0], place[:, 2] - 0.02)
    colour = _woven(look.bottom, 0.16 * around, place[:, 1], cloud)
    dark = np.array(look.bottom.base) * 0.65
    under = garments.waist_height(outfit, place) - place[:, 1]
    marks = np.maximum(_line(under - 0.03), _line(place[:, 1] - outfit.cuff - 0.02))
    back = place[:, 2] < 0
    marks = np.maximum(marks, np.where(back, _line(place[:, 0]) * (under < 0.18), 0.0))
    colour = _mix(colour, dark, 0.8 * marks)
    if look.belt is not None and outfit.tucked:
        colour = _mix(colour, look.belt, ramp(np.abs(under - 0.015), 0.0135, 0.0125))
    return colour


def _shoes(look: Look, outfit: Outfit, place: np.ndarray, cloud: _Clouds) -> np.ndarray:
    x, y, z = place.T
    leather = np.array(look.shoes) * (1.0 + 0.03 * cloud(place, 0.006))[:, None]
    side = np.abs(x) - 0.22
    tongue = (z > 0.025) & (z < 0.10) & (np.abs(side) < 0.022) & (y > -0.79)
    lace = np.where(tongue, ramp(np.abs((z / 0.016) % 1.0 - 0.5), 0.22, 0.16), 0.0)
    colour = _mix(leather, np.array(look.soles) * 0.95, lace)
    rim = _line(garments.shoe_field(outfit, place) + 0.010)
    toe = np.where(y > -0.80, _line(z - 0.135, 0.002), 0.0)
    colour = _mix(colour, np.array(look.shoes) * 0.6, 0.8 * np.maximum(rim, toe))
    return _mix(colour, look.soles, ramp(y, -0.797, -0.800))
