"""Hair: the scalp raised where it grows, and what hangs or is tied from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from subjects.open.base.mask import masked
from subjects.open.base.ramp import ramp
from subjects.open.base.surface import Piece
from subjects.open.hair import locks
from subjects.open.hair.head import Head
from subjects.open.hair.headwear import azimuth, elevation, put_on

# Height of the hairline over depth (template metres): nape, behind the ear, temple, forehead.
LINE_Z = np.array([-0.06, -0.01, 0.025, 0.055, 0.085, 0.105, 0.14])
LINE_Y = np.array([0.668, 0.690, 0.715, 0.722, 0.765, 0.790, 0.806])


def growth(place: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N,) metres above the hairline, template coordinates; negative on skin and ears."""
    above = place[:, 1] - np.interp(place[:, 2], LINE_Z, LINE_Y)
    # Sideburns come down in front of the ear.
    return above - 0.2 * masked("ears", uv)


def raised(
    vertices: np.ndarray,
    normals: np.ndarray,
    grown: np.ndarray,
    style: str,
    headwear: str,
    rough: np.ndarray,
) -> np.ndarray:
    """Body vertices with the scalp moved out where hair grows: what locks lie on.

    Args:
        grown: (N,) from `growth`.
        style: a key of RISE.
        headwear: none, cap or beanie, which press hair down.
        rough: (N,) in [-1, 1], unevenness of the hair.
    """
    rise = RISE[style] if headwear == "none" else min(RISE[style], 0.004)
    height = rise * ramp(grown, 0.0, 0.035) * (1.0 + 0.25 * rough)
    return vertices + height[:, None] * normals


@dataclass(frozen=True)
class Cut:
    """How hair is cut and combed; lengths in metres."""

    rise: float
    """That the scalp is raised by, under the locks."""
    top: float
    """Length of the locks on top."""
    side: float
    """Length of the locks at sides and nape."""
    count: int
    """How many locks there are."""
    width: float
    steps: int
    """Rings of a lock from root to tip."""
    lift: float
    """How far above the scalp the uppermost locks lie."""
    fall: float
    """How soon locks leave the comb's direction for gravity's, 0 to 1."""
    curl: float = 0.0
    """Radius of the coils."""
    tied: str = ""
    """tail or bun."""


CUTS: dict[str, Cut] = {
    "short": Cut(0.006, 0.058, 0.028, 700, 0.0100, 7, 0.008, 0.10),
    "bob": Cut(0.008, 0.215, 0.115, 375, 0.0150, 13, 0.010, 0.60),
    "long": Cut(0.008, 0.420, 0.330, 310, 0.0180, 16, 0.010, 0.60),
    "ponytail": Cut(0.006, 0.0, 0.0, 330, 0.0130, 9, 0.004, 0.0, tied="tail"),
    "bun": Cut(0.006, 0.0, 0.0, 330, 0.0130, 9, 0.004, 0.0, tied="bun"),
    "curly": Cut(0.016, 0.078, 0.060, 370, 0.0115, 21, 0.020, 0.25, curl=0.0052),
    "afro": Cut(0.024, 0.034, 0.026, 1000, 0.0150, 7, 0.040, 0.0, curl=0.0045),
}
"""Bald and cropped heads have no locks."""
RISE = {"bald": 0.0, "cropped": 0.0035} | {style: cut.rise for style, cut in CUTS.items()}


def styled(
    style: str,
    headwear: str,
    head: Head,
    generator: np.random.Generator,
) -> list[Piece]:
    """The locks of a hair style, and the cap or beanie over them.

    Args:
        style: a key of RISE.
        headwear: none, cap or beanie.
    """
    hat, edge = put_on(headwear, head)
    if style not in CUTS:
        return hat
    cut = CUTS[style]
    point, normal, direction = _roots(cut.count, head, generator)
    if hat:
        # Only what shows below the hat grows out of it.
        shown = elevation(direction) < edge(azimuth(direction)) + 0.10
        point, normal, direction = point[shown], normal[shown], direction[shown]
    if cut.tied:
        return hat + _tied(cut, head, direction, bool(hat), generator)
    if style == "afro":
        return [*hat, _tufts(cut, head, point, normal, generator)]
    return [*hat, _loose(cut, head, point, normal, style, generator)]


def _roots(
    count: int, head: Head, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evenly strewn roots: points, normals and unit directions from the skull's middle, (N, 3)."""
    # Of a whole ball's directions, about two thirds meet the scalp.
    k = np.arange(int(count * 1.6)) + 0.5
    up = 1.0 - 2.0 * k / len(k)
    turn = np.pi * (1.0 + 5.0**0.5) * k + generator.uniform(0, 2 * np.pi)
    level = np.sqrt(1.0 - up**2)
    direction = np.stack([level * np.sin(turn), up, level * np.cos(turn)], axis=1)
    direction += generator.normal(0, 0.022, direction.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    point, normal, off = head.on_scalp(direction)
    grows = off < 0.05
    return point[grows], normal[grows], direction[grows]


def _away_from_part(
    place: np.ndarray, part: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) away from the parting's line, and distances (N,) from it."""
    a, b = part
    share = np.clip(((place - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
    away = place - (a + share[:, None] * (b - a))
    distance = np.linalg.norm(away, axis=1)
    return away / np.maximum(distance, 1e-6)[:, None], distance


def _loose(
    cut: Cut,
    head: Head,
    point: np.ndarray,
    normal: np.ndarray,
    style: str,
    generator: np.random.Generator,
) -> Piece:
    """Locks combed away from a parting or the crown, that fall by their weight."""
    n, steps = len(point), cut.steps
    side = float(generator.choice([-1.0, 1.0]))
    off = side * generator.uniform(0.012, 0.034)
    crown = np.array([0.2 * off, 0.835, -0.005])
    # The parting starts behind a fringe, or at the hairline.
    fringe = bool(generator.random() < (0.35 if style in ("bob", "long") else 0.6))
    front = 0.085 if fringe else 0.128
    if style == "short":
        front = 0.01 if fringe else 0.10
    part = (np.array([off, 0.838, front]), crown)
    place = head.local(point)
    _, distance = _away_from_part(place, part)
    upper = ramp(distance, 0.16, 0.02)
    full = cut.side + (cut.top - cut.side) * ramp(place[:, 1], 0.745, 0.825)
    if style in ("bob", "long"):
        # Ends meet one line, whatever the root's height.
        full = cut.side + (cut.top - cut.side) * ramp(distance, 0.15, 0.0)
    full = full * generator.uniform(0.88, 1.08, n) * _stretch(style, generator)
    fore = place[:, 2] > 0.105
    if style in ("bob", "long"):
        short_fringe = fore & (np.abs(place[:, 0]) < 0.05) & fringe
        full = np.where(short_fringe, generator.uniform(0.062, 0.078, n), full)
    else:
        short_fringe = np.zeros(n, dtype=bool)
    sweep = np.array([0.35 * side, 0.0, 0.0]) if style == "short" else np.zeros(3)
    lie = (0.35 + 0.65 * upper) * cut.lift * generator.uniform(0.4, 1.0, n)
    slant = generator.normal(0, 0.16, (n, 3))
    combed = 1.0
    if cut.curl > 0:  # curls go where they like
        slant, combed = 4.0 * slant, 0.15
    down = np.array([0.0, -1.0, 0.0])

    path = np.empty((n, steps, 3))
    outward = np.empty_like(path)
    path[:, 0], outward[:, 0] = point - 0.004 * normal, normal
    comb, _ = _away_from_part(place, part)
    speed = 0.35 * normal + 0.65 * head.turned(comb)
    speed /= np.linalg.norm(speed, axis=1, keepdims=True)
    step = (full / (steps - 1))[:, None]
    for k in range(1, steps):
        t = k / (steps - 1)
        here = head.local(path[:, k - 1])
        comb, _ = _away_from_part(here, part)
        comb = combed * comb + sweep * ramp(here[:, 1], 0.78, 0.82)[:, None] + slant
        if style in ("bob", "long"):
            # Off the face, behind the cheeks.
            forward = ramp(here[:, 2], 0.055, 0.10) * ~short_fringe
            comb = comb - np.array([0.0, 0.0, 1.3]) * forward[:, None]
            comb[:, 0] += 0.6 * forward * np.sign(here[:, 0] - off)
        comb = head.turned(comb)
        comb -= (comb * outward[:, k - 1]).sum(axis=1, keepdims=True) * outward[:, k - 1]
        below = ramp(here[:, 1], 0.80, 0.70)
        share = np.clip(cut.fall * (0.25 + 0.75 * np.maximum(below, t * (here[:, 1] < 0.80))), 0, 1)
        share = np.where(here[:, 1] < 0.70, np.maximum(share, 0.9 * (cut.fall > 0.3)), share)
        want = (1 - share)[:, None] * comb + share[:, None] * down
        before, speed = speed, 0.45 * speed + 0.55 * want
        speed /= np.maximum(np.linalg.norm(speed, axis=1, keepdims=True), 1e-9)
        moved = path[:, k - 1] + step * speed
        if style in ("bob", "long"):
            moved = np.where(short_fringe[:, None], moved, _beside_face(head, moved))
        floor = 0.002 + lie * ramp(np.array(t), 0.0, 0.35)
        # On the head hair lies close; short tips stand off a little, long hair swings free below.
        ceiling = floor + 0.002 + (0.006 * t if cut.fall < 0.3 else 0.0)
        close = 1.0 if cut.fall < 0.3 else ramp(here[:, 1], 0.70, 0.76)
        for _ in range(2):  # what meets a shoulder slides on along it, as long as before
            height, up = head.above(moved)
            push = np.maximum(floor - height, 0.0) - close * np.maximum(height - ceiling, 0.0)
            speed = moved + push[:, None] * up - path[:, k - 1]
            speed /= np.maximum(np.linalg.norm(speed, axis=1, keepdims=True), 1e-9)
            # A lock rather goes into what is in its way than folds upon itself.
            sharp = ramp((speed * before).sum(axis=1), 0.6, 0.0)
            speed = speed + sharp[:, None] * before
            speed /= np.maximum(np.linalg.norm(speed, axis=1, keepdims=True), 1e-9)
            moved = path[:, k - 1] + step * speed
        # Between layers of cloth normals disagree; a lock must not turn over for that.
        last = outward[:, k - 1]
        agree = ramp((up * last).sum(axis=1), -0.2, 0.5)
        path[:, k], outward[:, k] = moved, last + (2.0 * agree)[:, None] * up
        outward[:, k] /= np.linalg.norm(outward[:, k], axis=1, keepdims=True)
    path[:, 1:] = gaussian_filter1d(path, 0.8, axis=1, mode="nearest")[:, 1:]
    outward = gaussian_filter1d(outward, 2.0, axis=1, mode="nearest")
    return _bodied(cut, path, outward, generator)


def _beside_face(head: Head, point: np.ndarray) -> np.ndarray:
    """World points (N, 3) parted to either side of the face, below the hairline."""
    place = head.local(point)
    aside = 0.080 * ramp(place[:, 2], 0.070, 0.095) * ramp(place[:, 1], 0.835, 0.780)
    aside = aside * ramp(place[:, 1], 0.60, 0.64)
    place[:, 0] = np.where(place[:, 0] > 0, 1.0, -1.0) * np.maximum(np.abs(place[:, 0]), aside)
    return head.world(place)


def _stretch(style: str, generator: np.random.Generator) -> float:
    """One person's hair against another's."""
    return float(generator.uniform(0.75, 1.15) if style in ("bob", "long") else 1.0)


def _bodied(
    cut: Cut, path: np.ndarray, outward: np.ndarray, generator: np.random.Generator
) -> Piece:
    n, steps, _ = path.shape
    broad = cut.width * generator.uniform(0.75, 1.3, (n, 1))
    t = np.linspace(0, 1, steps)
    if cut.curl > 0:
        along = np.gradient(path, axis=1)
        span = np.linalg.norm(along, axis=2)
        length = np.cumsum(span, axis=1)
        along /= np.maximum(span[..., None], 1e-9)
        aside = np.cross(along, outward)
        turn = 2 * np.pi * length / generator.uniform(0.019, 0.027, (n, 1))
        turn = turn * generator.choice([-1.0, 1.0], (n, 1)) + generator.uniform(0, 6.28, (n, 1))
        spiral = np.cos(turn)[..., None] * aside + np.sin(turn)[..., None] * outward
        path = path + cut.curl * ramp(t, 0.0, 0.25)[:, None] * spiral
        outward = spiral + 0.35 * outward
        width = broad * locks.taper(steps, 0.6, 0.35)
        return locks.locks(path, outward, width, 0.75 * width, generator, locks.CURL)
    # A few waves that neighbours share in part.
    phase = generator.uniform(0, 0.8, (n, 1)) + 9.0 * path[:, :1, 0]
    wave = 0.05 * broad * np.sin(9.0 * t + phase) * ramp(t, 0.2, 0.6)
    aside = np.cross(np.gradient(path, axis=1), outward)
    aside /= np.maximum(np.linalg.norm(aside, axis=2, keepdims=True), 1e-9)
    path = path + wave[..., None] * aside
    width = broad * locks.taper(steps, 0.7, 0.22)
    thick = 0.30 * broad * locks.taper(steps, 0.6, 0.35)
    return locks.locks(path, outward, width, thick, generator)


def _tufts(
    cut: Cut,
    head: Head,
    point: np.ndarray,
    normal: np.ndarray,
    generator: np.random.Generator,
) -> Piece:
    """Springy tufts that stand on end and coil at their tips."""
    n, steps = len(point), cut.steps
    height = head.local(point)[:, 1]
    full = cut.side + (cut.top - cut.side) * ramp(height, 0.72, 0.80)
    full = full * generator.uniform(0.8, 1.15, n)
    t = np.linspace(0, 1, steps)
    lean = generator.normal(0, 0.45, (n, 3))
    lean -= (lean * normal).sum(axis=1, keepdims=True) * normal
    path = (
        point[:, None]
        + (full[:, None] * t - 0.006)[..., None] * normal[:, None]
        + (0.5 * full[:, None] * t**2)[..., None] * lean[:, None]
    )
    outward = np.cross(normal, lean + 1e-3)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    outward = np.repeat(outward[:, None], steps, axis=1)
    turn = 2 * np.pi * 1.3 * t + generator.uniform(0, 6.28, (n, 1))
    along = np.repeat(normal[:, None], steps, axis=1)
    aside = np.cross(along, outward)
    spiral = np.cos(turn)[..., None] * aside + np.sin(turn)[..., None] * outward
    path = path + cut.curl * t[:, None] * spiral
    width = cut.width * generator.uniform(0.8, 1.2, (n, 1)) * locks.taper(steps, 0.8, 0.75)
    return locks.locks(path, spiral, width, 0.85 * width, generator, locks.CURL)


def _tied(
    cut: Cut,
    head: Head,
    direction: np.ndarray,
    hatted: bool,
    generator: np.random.Generator,
) -> list[Piece]:
    """Hair combed back from all sides to a knot, and what hangs or is wound there."""
    rise = np.radians(generator.uniform(6, 34) if cut.tied == "tail" else generator.uniform(20, 50))
    if hatted:
        rise = np.radians(-14.0)
    knot = np.array([0.0, np.sin(rise), -np.cos(rise)])
    n, steps = len(direction), cut.steps
    angle = np.arccos(np.clip(direction @ knot, -1, 1))
    some = angle > 0.12
    direction, angle, n = direction[some], angle[some], int(some.sum())
    # Each lock runs to its own side of the knot, or part of the way: others lie over it.
    far = np.minimum(1.0, generator.uniform(0.10, 0.16, n) / angle * 9.0)
    t = np.linspace(0, 1, steps)[None] * far[:, None]
    bent = (
        np.sin((1 - t) * angle[:, None])[..., None] * direction[:, None]
        + np.sin(t * angle[:, None])[..., None] * knot
    ) / np.sin(angle)[:, None, None]
    bent /= np.linalg.norm(bent, axis=2, keepdims=True)
    point, normal, _ = head.on_scalp(bent.reshape(-1, 3))
    point, normal = point.reshape(n, steps, 3), normal.reshape(n, steps, 3)
    # Behind a hairline the locks come out of the skin; towards the knot they lie higher.
    over = cut.lift * generator.uniform(0.2, 1.0, (n, 1)) * ramp(t, 0.0, 0.15) - 0.001
    path = point + over[..., None] * normal
    path = gaussian_filter1d(path, 0.8, axis=1, mode="nearest")
    broad = cut.width * generator.uniform(0.75, 1.3, (n, 1))
    width = broad * np.minimum(locks.taper(steps, 0.8, 0.5, 0.1), 1.0)
    pieces = [locks.locks(path, normal, width, 0.34 * width, generator)]
    at, out, _ = head.on_scalp(knot[None])
    if cut.tied == "tail":
        return pieces + _tail(head, at[0], out[0], generator)
    return pieces + _bun(at[0], out[0], generator)


def _tail(
    head: Head, knot: np.ndarray, out: np.ndarray, generator: np.random.Generator
) -> list[Piece]:
    count, steps = 46, 16
    length = generator.uniform(0.20, 0.36)
    spread = generator.normal(0, 1, (count, 3))
    spread -= (spread @ out)[:, None] * out
    spread /= np.maximum(np.linalg.norm(spread, axis=1, keepdims=True), 1e-9)
    spread *= np.sqrt(generator.uniform(0, 1, (count, 1)))
    path = np.empty((count, steps, 3))
    outward = np.empty_like(path)
    path[:, 0] = knot - 0.006 * out + 0.010 * spread
    outward[:, 0] = spread + 0.2 * out
    speed = np.repeat((out * 1.1 + [0.0, 0.35, 0.0])[None], count, axis=0) + 0.10 * spread
    each = length * generator.uniform(0.70, 1.08, count) / (steps - 1)
    for k in range(1, steps):
        t = k / (steps - 1)
        speed = 0.74 * speed + np.array([0.0, -0.30, 0.0])
        ahead = speed / np.linalg.norm(speed, axis=1, keepdims=True)
        path[:, k] = path[:, k - 1] + each[:, None] * ahead
        # A tail is bound at its start, full below, and gathers to its end.
        full = 0.012 + 0.022 * np.sin(np.pi * min(t * 1.1, 1.0) ** 0.7)
        middle = path[:, k].mean(axis=0)
        aside = spread - (spread * ahead).sum(axis=1, keepdims=True) * ahead
        path[:, k] += 0.35 * (middle + full * aside - path[:, k]) * min(1.0, 3 * t)
        height, up = head.above(path[:, k])
        lack = np.maximum(0.006 + 0.010 * (1 + (spread * up).sum(axis=1)) - height, 0.0)
        if k > 2:
            path[:, k] += lack[:, None] * up
        outward[:, k] = aside + 0.15 * out
    path = gaussian_filter1d(path, 1.0, axis=1, mode="nearest")
    outward /= np.maximum(np.linalg.norm(outward, axis=2, keepdims=True), 1e-9)
    width = 0.019 * generator.uniform(0.8, 1.3, (count, 1)) * locks.taper(steps, 0.5, 0.2)
    tail = locks.locks(path, outward, width, 0.5 * width, generator)
    tie = knot + 0.010 * out
    return [tail, _wound(tie, out, 0.014, 0.0075, 1.0, 10, generator)]


def _bun(knot: np.ndarray, out: np.ndarray, generator: np.random.Generator) -> list[Piece]:
    radius = generator.uniform(0.026, 0.036)
    middle = knot + 0.45 * radius * out
    outer = _wound(middle, out, 0.66 * radius, 0.62 * radius, 1.15, 34, generator)
    inner = _wound(
        middle + 0.28 * radius * out, out, 0.26 * radius, 0.5 * radius, 1.4, 14, generator
    )
    return [outer, inner]


def _wound(
    middle: np.ndarray,
    axis: np.ndarray,
    ring: float,
    tube: float,
    turns: float,
    count: int,
    generator: np.random.Generator,
) -> Piece:
    """Locks wound around an axis, on a ring's tube."""
    steps = 18
    side = np.cross(axis, [0.31, 0.93, 0.17])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    start = generator.uniform(0, 2 * np.pi, (count, 1))
    around = start + np.linspace(0, turns * np.pi, steps)
    # Strands twist slowly about the tube as they go around.
    about = generator.uniform(0, 2 * np.pi, (count, 1)) + 0.9 * np.linspace(0, 1, steps)
    radial = np.cos(around)[..., None] * side + np.sin(around)[..., None] * other
    out = np.cos(about)[..., None] * radial + np.sin(about)[..., None] * axis
    path = middle + ring * radial + tube * generator.uniform(0.88, 1.0, (count, 1, 1)) * out
    width = (0.010 + 0.15 * tube) * locks.taper(steps, 0.3, 0.3)
    width = np.repeat(width[None], count, axis=0)
    return locks.locks(path, out, width, 0.5 * width, generator)
