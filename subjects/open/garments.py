"""What an open human wears: garments cut from the clothing helpers and laid over the body.

A garment is where a field over the template is negative; the field's zero line is the hem. The
same field says which skin lies under the garment. Lengths along a limb count joints: 1 is the
elbow, 2 the wrist.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from subjects.open import surface
from subjects.open.atlas import chart
from subjects.open.subdivision import Refinement, refine, triangles
from subjects.open.surface import Pattern, Piece
from subjects.open.template import SKIRT, TIGHTS, template, weight_of

ARM = ("upperarm", "lowerarm", "wrist", "finger", "metacarpal")
COVER_MARGIN = 0.06
"""Metres on the template: skin this far under a hem is taken away."""
COLLAR_WIDTH = 0.022


@dataclass(frozen=True)
class Outfit:
    """The cut of what is worn, in template metres (a body of 1.67 m) unless said otherwise."""

    sleeve: float
    """Joints from the shoulder: 0.45 short, 1.0 to the elbow, 1.9 long."""
    neckline: str
    """crew, vee, scoop or shirt."""
    hem: float
    """Height of the top's lower edge."""
    tucked: bool
    """Whether the top goes into the trousers or skirt."""
    ease: float
    """How far the top stands off below the chest."""
    bottom: str
    """trousers or skirt."""
    waist: float
    """Height of the upper edge of trousers or skirt."""
    cuff: float
    """Height of their lower edge."""
    leg_ease: float
    """How far the trouser leg stands off at the cuff."""
    shoe: float
    """Height of the shoe's upper edge."""

    def as_json(self) -> dict[str, Any]:
        """The cut, JSON-ready."""
        return asdict(self)


def draw_outfit(generator: np.random.Generator, skirt_allowed: bool, gender: float) -> Outfit:
    """One outfit. A skirt only where the pose leaves it its shape."""
    skirt = bool(skirt_allowed and gender > 0.5 and generator.random() < 0.5)
    sleeve = float(
        generator.choice(
            [generator.uniform(0.40, 0.62), generator.uniform(1.62, 1.9)], p=[0.5, 0.5]
        )
    )
    neckline = str(generator.choice(["crew", "vee", "scoop", "shirt"], p=[0.35, 0.2, 0.15, 0.3]))
    tucked = bool(generator.random() < (0.6 if skirt else 0.25))
    lengths = {
        "shorts": generator.uniform(-0.33, -0.22),
        "calf": generator.uniform(-0.60, -0.52),
        "long": generator.uniform(-0.746, -0.732),
    }
    length = str(generator.choice(list(lengths), p=[0.22, 0.1, 0.68]))
    cuff = float(lengths[length])
    if skirt:
        cuff = float(generator.uniform(-0.55, -0.22))
    boots = bool(generator.random() < 0.2) and length != "long"
    return Outfit(
        sleeve=round(sleeve, 3),
        neckline=neckline,
        hem=round(float(generator.uniform(-0.035, 0.05)), 3),
        tucked=tucked,
        ease=round(float(generator.uniform(0.008, 0.026)), 4),
        bottom="skirt" if skirt else "trousers",
        waist=round(float(generator.uniform(0.115, 0.14)), 3),
        cuff=round(cuff, 3),
        leg_ease=round(float(generator.uniform(0.010, 0.034)), 4),
        shoe=round(float(generator.uniform(-0.66, -0.60) if boots else -0.752), 3),
    )


def arm_share(matrix: Any) -> np.ndarray:
    """How much each refined vertex follows an arm."""
    return matrix @ weight_of(ARM)


def arm_length(place: np.ndarray) -> np.ndarray:
    """Joints from the shoulder along either arm: 1 at the elbow, 2 at the wrist."""
    joints = template().joints
    mirrored = np.abs(place[:, 0])[:, None] * [1.0, 0.0, 0.0] + place * [0.0, 1.0, 1.0]
    shoulder, elbow, wrist = (joints[f"l-{j}"] for j in ("shoulder", "elbow", "hand"))
    upper, fore = elbow - shoulder, wrist - elbow
    first = ((mirrored - shoulder) @ upper) / (upper @ upper)
    second = ((mirrored - elbow) @ fore) / (fore @ fore)
    return np.minimum(first, 1.0) + np.maximum(second, 0.0)


def neckline_field(place: np.ndarray, kind: str) -> np.ndarray:
    """Positive above the neckline, metres on the template."""
    x, y, z = place.T

    def ring(height: float, slope: float, radius: float) -> np.ndarray:
        """Above a plane that falls to the front, and within a column around the neck."""
        above = y - (height - slope * (z + 0.02))
        within = radius - np.hypot(x, (z - 0.01) / 1.15)
        # A soft minimum rounds the corner between the two; the head is above every neckline.
        soft = -0.015 * np.logaddexp(-above / 0.015, -within / 0.015)
        return np.maximum(soft, y - 0.61)

    if kind == "shirt":
        return ring(0.590, 0.52, 0.085)
    crew = ring(0.580, 0.55, 0.092)
    if kind == "crew":
        return crew
    front = ramp(z, 0.0, 0.03)
    if kind == "vee":
        wedge = 0.8 * (y - 0.470 - 1.45 * np.abs(x))
        return np.maximum(crew, wedge - 0.3 * (1.0 - front))
    bowl = 0.105 - np.hypot(x, y - 0.575)
    return np.maximum(crew, bowl - 0.3 * (1.0 - front))


def hem_height(outfit: Outfit, place: np.ndarray) -> np.ndarray:
    """Height of the top's lower edge, a little lower behind; tucked in, it ends under the waist."""
    if outfit.tucked:
        return waist_height(outfit, place) - 0.035
    return outfit.hem + 0.05 * place[:, 2]


def waist_height(outfit: Outfit, place: np.ndarray) -> np.ndarray:
    """Height of the upper edge of trousers or skirt, a little higher behind."""
    return outfit.waist + 0.08 * (0.02 - place[:, 2])


def top_field(outfit: Outfit, place: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Negative where the top is."""
    on_arm = arm > 0.5
    sleeve = np.where(on_arm, 0.22 * (arm_length(place) - outfit.sleeve), -0.2)
    trunk = np.maximum(
        hem_height(outfit, place) - place[:, 1], neckline_field(place, outfit.neckline)
    )
    return np.where(on_arm, sleeve, trunk)


def bottom_field(outfit: Outfit, place: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Negative where trousers or skirt are."""
    waist = place[:, 1] - waist_height(outfit, place)
    return np.where(arm > 0.5, 0.2, np.maximum(waist, outfit.cuff - place[:, 1]))


def shoe_field(outfit: Outfit, place: np.ndarray) -> np.ndarray:
    """Negative where the shoes are: lower at the instep's sides than at heel and tongue."""
    return place[:, 1] - (outfit.shoe + 0.25 * np.maximum(place[:, 2] - 0.02, 0.0))


def covered(outfit: Outfit, place: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(N,) bool: skin that lies well inside a garment."""
    top = top_field(outfit, place, arm) < -COVER_MARGIN
    margin = 0.16 if outfit.bottom == "skirt" else COVER_MARGIN
    bottom = bottom_field(outfit, place, arm) < -margin
    shoe = shoe_field(outfit, place) < -0.012
    # Where the two overlap, neither hem is near the outside.
    lap = np.minimum(waist_height(outfit, place), outfit.waist) + 0.02
    between = (arm < 0.5) & (place[:, 1] < lap) & (place[:, 1] > hem_height(outfit, place) - 0.02)
    return top | bottom | shoe | between


@lru_cache(maxsize=4)
def refined(group: str, levels: int) -> tuple[Refinement, np.ndarray, np.ndarray]:
    """A group's refinement, its fine template coordinates and its share of the arms."""
    mesh = template().groups[group]
    fine = refine(mesh.quads, chart(group), len(template().vertices), levels)
    return fine, fine.matrix @ template().vertices, arm_share(fine.matrix)


def pattern(group: str, field: np.ndarray) -> Pattern:
    """The part of a group, refined twice, where `field` is negative."""
    fine, _, _ = refined(group, 2)
    return surface.cut(fine.matrix, triangles(fine.quads), triangles(fine.corners), field)


@dataclass(frozen=True, eq=False)
class Solid:
    """What a garment must stay outside of: (N, 3) vertices, normals, template coordinates."""

    vertices: np.ndarray
    normals: np.ndarray
    place: np.ndarray


def both(a: Solid, b: Solid) -> Solid:
    """Two solids as one."""
    return Solid(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.normals, b.normals]),
        np.concatenate([a.place, b.place]),
    )


def laid_over(
    cloth: Pattern,
    posed: np.ndarray,
    gap: np.ndarray,
    solid: Solid,
    folds: np.ndarray,
    rounds: int = 4,
    smoothing: int = 8,
) -> Piece:
    """A garment spanned over a solid like cloth that does not hug hollows.

    Args:
        posed: (19158, 3) posed base mesh.
        gap: (N,) metres kept from the solid.
        folds: (N,) metres added along the normals at the end.
        rounds: how often smoothing and pushing out alternate.
        smoothing: averaging steps in each round.
    """
    place = cloth.matrix @ template().vertices
    vertices = cloth.matrix @ posed
    vertices = vertices + gap[:, None] * surface.normals(vertices, cloth.faces)
    mean = surface.averaging(cloth.faces, len(vertices))
    for _ in range(rounds):
        for _ in range(smoothing):
            vertices = 0.5 * vertices + 0.5 * (mean @ vertices)
        vertices = surface.pushed_out(
            vertices, place, gap, solid.vertices, solid.normals, solid.place
        )
    # Pushing out leaves small steps: even them out once more, then add the folds.
    for _ in range(3):
        vertices = 0.5 * vertices + 0.5 * (mean @ vertices)
    vertices = vertices + folds[:, None] * surface.normals(vertices, cloth.faces)
    vertices = surface.pushed_out(
        vertices, place, np.minimum(gap, 0.004), solid.vertices, solid.normals, solid.place
    )
    return Piece(vertices, cloth.faces, cloth.uv)


def fold_field(
    generator: np.random.Generator, place: np.ndarray, count: int, height: float
) -> np.ndarray:
    """(N,) metres: ridges and valleys, most of them near joints and across the limb."""
    joints = template().joints
    names = ("elbow", "shoulder", "knee", "upper-leg")
    creases = np.array([joints[f"{side}-{name}"] for side in "lr" for name in names])
    result = np.zeros(len(place))
    for _ in range(count):
        centre = place[generator.integers(len(place))]
        if generator.random() < 0.5:
            near = creases[generator.integers(len(creases))]
            centre = near + generator.normal(0, 0.045, 3)
        across = generator.normal(0, 1, 3) * (0.45, 1.0, 0.45)
        across /= np.linalg.norm(across)
        length = generator.uniform(0.022, 0.05)
        offset = place - centre
        along = offset @ across
        aside = (offset * offset).sum(axis=1) - along**2
        envelope = np.exp(-((along / (0.7 * length)) ** 2) - aside / (2 * (2.2 * length) ** 2))
        result += generator.uniform(-1, 1) * np.cos(2 * np.pi * along / length) * envelope
    return height * np.tanh(result)


def ramp(value: np.ndarray, start: float, end: float) -> np.ndarray:
    """Smooth 0 to 1 from `start` to `end`."""
    t = np.clip((value - start) / (end - start), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@dataclass(frozen=True, eq=False)
class Sheet:
    """A garment as it is cut, before it lies on a body.

    Attributes:
        cloth: the pattern.
        place: (N, 3) template coordinates.
        gap: (N,) metres it keeps from what is under it.
        folds: (N,) metres of painted folds, where no solver makes real ones.
        rounds, smoothing: how `laid_over` spans it.
        limb: (N,) bool, sleeves and trouser legs.
        pin: (N,) 0 where it hangs free to 1 where a waistband or collar holds it.
    """

    cloth: Pattern
    place: np.ndarray
    gap: np.ndarray
    folds: np.ndarray
    rounds: int
    smoothing: int
    limb: np.ndarray
    pin: np.ndarray

    def laid(self, posed: np.ndarray, solid: Solid) -> np.ndarray:
        """(N, 3) spanned over a solid, with its painted folds."""
        return laid_over(
            self.cloth, posed, self.gap, solid, self.folds, self.rounds, self.smoothing
        ).vertices

    def started(self, shape: np.ndarray, solid: Solid, more: float) -> np.ndarray:
        """(N, 3) smooth over a solid, `more` metres further out than it need be."""
        gap, flat = self.gap + more, np.zeros(len(self.gap))
        return laid_over(self.cloth, shape, gap, solid, flat, 5, self.smoothing).vertices

    def finished(self, vertices: np.ndarray, flange: float = 0.05) -> tuple[Piece, Solid]:
        """The garment with turned-in hems, and its outside as a solid for the next layer.

        Args:
            flange: metres by which sleeves and trouser legs are closed towards the limb.
        """
        piece = Piece(vertices, self.cloth.faces, self.cloth.uv)
        reach = np.where(self.limb, flange, 0.01)
        return surface.hemmed(piece, 0.003, rings=6, reach=reach), self.outside(vertices)

    def outside(self, vertices: np.ndarray) -> Solid:
        """The garment as a solid that the next layer must stay outside of."""
        return Solid(vertices, surface.normals(vertices, self.cloth.faces), self.place)


def trousers(outfit: Outfit, generator: np.random.Generator) -> Sheet:
    """Trousers of the outfit's length and width."""
    _, place, arm = refined(TIGHTS, 2)
    cloth = pattern(TIGHTS, bottom_field(outfit, place, arm))
    place = cloth.matrix @ template().vertices
    return Sheet(
        cloth,
        place,
        gap=0.005 + outfit.leg_ease * ramp(place[:, 1], 0.05, -0.62),
        folds=fold_field(generator, place, 70, 0.005) * ramp(place[:, 1], outfit.waist, 0.03),
        rounds=4,
        smoothing=8,
        limb=place[:, 1] < -0.1,
        pin=waistband(outfit, place),
    )


def skirt(outfit: Outfit, generator: np.random.Generator) -> Sheet:
    """A skirt from the skirt helper; folds run downwards and open towards the hem."""
    _, place, arm = refined(SKIRT, 2)
    cloth = pattern(SKIRT, bottom_field(outfit, place, arm))
    place = cloth.matrix @ template().vertices
    around = np.arctan2(place[:, 0], place[:, 2])
    down = ramp(place[:, 1], outfit.waist - 0.02, outfit.cuff)
    waves = sum(
        generator.uniform(0.3, 1.0) * np.cos(k * around + generator.uniform(0, 2 * np.pi))
        for k in (3, 5, 7, 9, 11)
    )
    return Sheet(
        cloth,
        place,
        gap=0.005 + 0.012 * down,
        folds=0.007 * waves * down,
        rounds=5,
        smoothing=14,
        limb=np.zeros(len(place), dtype=bool),
        pin=waistband(outfit, place),
    )


def waistband(outfit: Outfit, place: np.ndarray) -> np.ndarray:
    """(N,) 1 in the band that holds trousers or a skirt, softly 0 below."""
    return ramp(waist_height(outfit, place) - place[:, 1], 0.04, 0.015)


def top(outfit: Outfit, generator: np.random.Generator) -> Sheet:
    """Shirt, blouse or jersey; untucked it goes over the waistband."""
    _, place, arm = refined(TIGHTS, 2)
    cloth = pattern(TIGHTS, top_field(outfit, place, arm))
    place = cloth.matrix @ template().vertices
    arm = arm_share(cloth.matrix)
    ease = 0.25 * outfit.ease if outfit.tucked else outfit.ease
    trunk = 0.005 + ease * ramp(place[:, 1], 0.40, 0.10)
    end = arm_length(place) / outfit.sleeve
    sleeve = 0.005 + (0.5 * ease + 0.004) * ramp(end, 0.2, 1.0)
    gap = trunk + (sleeve - trunk) * ramp(arm, 0.2, 0.8)
    # A collar or neckband is a second layer of cloth.
    neck = neckline_field(place, outfit.neckline)
    band = ramp(neck, -COLLAR_WIDTH, -COLLAR_WIDTH + 0.004)
    gap = gap + np.where(arm > 0.5, 0.0, 0.003 * band)
    calm = ramp(neck, -0.02, -0.08)
    pin = np.where(arm > 0.5, 0.0, ramp(neck, -0.03, -0.01))
    if outfit.tucked:
        # What is tucked in is held by the waistband over it.
        pin = np.maximum(pin, ramp(place[:, 1] - waist_height(outfit, place), 0.01, -0.01))
    return Sheet(
        cloth,
        place,
        gap,
        folds=fold_field(generator, place, 80, 0.0045) * calm,
        rounds=5,
        # A loose top hangs straight from the chest; a tucked one follows the waist.
        smoothing=8 if outfit.tucked else 24,
        limb=arm > 0.5,
        pin=pin,
    )


def shoe_last(rest: np.ndarray) -> np.ndarray:
    """Rest base mesh with the feet of the tights made into shoes: a sole, and room for toes."""
    used = np.unique(template().groups[TIGHTS].quads)
    place = template().vertices[used]
    foot = place[:, 1] < -0.70
    used, place = used[foot], place[foot]
    height = place[:, 1] - place[:, 1].min()
    result = rest.copy()
    for side in (1.0, -1.0):
        one = place[:, 0] * side > 0
        v = rest[used[one]]
        h = height[one]
        # Away from the foot's own upright axis, most at the sole's rim.
        middle = v.mean(axis=0)
        aside = (v - middle) * [1.0, 0.0, 1.0]
        aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-6)
        rim = 1.0 - ramp(h, 0.012, 0.05)
        widened = v + aside * (0.004 + 0.005 * rim)[:, None]
        sole = v[:, 1].min() - 0.016
        widened[:, 1] = np.where(h < 0.016, sole, widened[:, 1] - 0.010 * rim + 0.006 * (1 - rim))
        result[used[one]] = widened
    return result


def shoes(outfit: Outfit, last: np.ndarray, foot: Solid) -> Piece:
    """Shoes from the posed last (see `shoe_last`)."""
    _, place, arm = refined(TIGHTS, 2)
    field = np.where(arm > 0.5, 0.2, shoe_field(outfit, place))
    cloth = pattern(TIGHTS, field)
    place = cloth.matrix @ template().vertices
    vertices = cloth.matrix @ last
    outward = surface.normals(vertices, cloth.faces)
    vertices = vertices + (0.003 * ramp(place[:, 1], -0.80, -0.77))[:, None] * outward
    vertices = surface.pushed_out(
        vertices, place, np.full(len(vertices), 0.003), foot.vertices, foot.normals, foot.place
    )
    plain = Piece(vertices, cloth.faces, cloth.uv)
    return surface.hemmed(plain, 0.002, rings=4, reach=np.full(len(vertices), 0.02))
