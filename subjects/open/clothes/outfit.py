"""What an open human wears, as numbers: which garments, how they are cut and of what cloth."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Material:
    """A cloth, in the solver's terms."""

    name: str
    """jersey, cotton, denim, ...: what it is sold as."""
    mass: float
    """Of a vertex, in the solver's kilograms."""
    stiffness: float
    """Against stretch; shear has a third of it."""
    bending: float
    """Against folding: 0.02 is soft, 1 is stiff."""
    slack: float
    """How much longer than at the start the cloth wants to be: it shows as folds."""
    thickness: float
    """Metres between the cloth's outer and inner face, seen where a hem is turned in."""

    @property
    def soft(self) -> bool:
        """Whether it folds by its own weight."""
        return self.bending <= SOFT_BENDING


SOFT_BENDING = 0.15
# name -> mass, stretch stiffness, bending (log-uniform), slack, thickness: each from, to.
MATERIALS: dict[str, tuple[tuple[float, float], ...]] = {
    "viscose": ((0.10, 0.16), (12, 16), (0.02, 0.05), (0.02, 0.05), (0.0016, 0.0022)),
    "jersey": ((0.12, 0.20), (12, 18), (0.03, 0.10), (0.01, 0.04), (0.0020, 0.0028)),
    "cotton": ((0.14, 0.22), (15, 25), (0.08, 0.25), (0.01, 0.03), (0.0022, 0.0030)),
    "fleece": ((0.20, 0.30), (14, 22), (0.10, 0.40), (0.01, 0.03), (0.0040, 0.0055)),
    "denim": ((0.24, 0.34), (20, 30), (0.25, 0.80), (0.005, 0.02), (0.0030, 0.0040)),
    "wool": ((0.22, 0.32), (16, 26), (0.15, 0.50), (0.005, 0.02), (0.0034, 0.0046)),
    "leather": ((0.28, 0.36), (24, 34), (0.50, 1.20), (0.0, 0.01), (0.0034, 0.0044)),
}


@dataclass(frozen=True)
class Top:
    """A garment of the trunk; lengths in template metres (a body of 1.67 m)."""

    kind: str
    """tee, shirt, sweater, hoodie, dress or jacket."""
    sleeve: float
    """Joints from the shoulder: 0.45 short, 1.0 to the elbow, 1.9 long."""
    neckline: str
    """crew, vee, scoop or shirt."""
    hem: float
    """Height of the lower edge."""
    ease: float
    """How far it stands off below the chest."""
    tucked: bool
    """Whether it goes into the trousers or skirt."""
    opening: float
    """Half the width by which the front stands open; 0 is closed."""
    front: str
    """What the front carries: buttons, zip, print, pocket or nothing."""
    back: str
    """What the back carries: print, yoke, hood or nothing."""
    material: Material

    @property
    def loose(self) -> bool:
        """Whether it hangs free of the trunk."""
        return not self.tucked and self.ease >= 0.016


@dataclass(frozen=True)
class Bottom:
    """A garment of the hips and legs; lengths in template metres."""

    kind: str
    """trousers, shorts or skirt."""
    waist: float
    """Height of the upper edge."""
    cuff: float
    """Height of the lower edge."""
    ease: float
    """How far a leg stands off at the cuff, or a skirt at its hem."""
    belt: bool
    """Whether a belt with a buckle holds it: where a tucked top leaves it to be seen."""
    pockets: bool
    """Whether it has pockets on the back."""
    material: Material

    @property
    def loose(self) -> bool:
        """Whether it hangs free of the legs."""
        return self.kind == "skirt" or self.ease >= 0.022


@dataclass(frozen=True)
class Outfit:
    """Everything worn, from the skin outwards."""

    top: Top
    bottom: Bottom | None
    """None under a dress."""
    outer: Top | None
    """An open jacket over the top, or none."""
    footwear: str
    """sneakers, leather or boots."""
    shoe: float
    """Height of the shoe's upper edge."""

    def as_json(self) -> dict[str, Any]:
        """The outfit, JSON-ready."""
        return asdict(self)


def draw_material(generator: np.random.Generator, names: list[str]) -> Material:
    """One of `names`, a little different each time."""
    name = names[int(generator.integers(len(names)))]
    mass, stiffness, bending, slack, thickness = MATERIALS[name]
    return Material(
        name=name,
        mass=round(float(generator.uniform(*mass)), 3),
        stiffness=round(float(generator.uniform(*stiffness)), 2),
        bending=round(float(np.exp(generator.uniform(*np.log(bending)))), 4),
        slack=round(float(generator.uniform(*slack)), 4),
        thickness=round(float(generator.uniform(*thickness)), 5),
    )


TOPS = ("tee", "shirt", "sweater", "hoodie", "dress")
CLOTH_OF = {
    "tee": ["jersey", "jersey", "viscose", "cotton"],
    "shirt": ["cotton", "cotton", "viscose", "denim"],
    "sweater": ["jersey", "wool", "fleece"],
    "hoodie": ["fleece", "jersey"],
    "dress": ["viscose", "jersey", "cotton"],
    "jacket": ["denim", "wool", "leather", "fleece"],
    "trousers": ["denim", "denim", "cotton", "wool", "jersey"],
    "shorts": ["denim", "cotton", "jersey"],
    "skirt": ["viscose", "cotton", "jersey", "denim"],
}
LONG_SLEEVE = (1.66, 1.88)
SEAT = -0.022
"""Template height of the lowest hem of a top: below, the clothing helper parts into legs."""


def draw_outfit(generator: np.random.Generator, legs_down: bool, gender: float) -> Outfit:
    """One outfit.

    Args:
        legs_down: whether the pose leaves skirts, dresses and jackets their shape; a raised
            thigh hooks their hems.
        gender: anny's phenotype, 0 male to 1 female.
    """
    skirted = legs_down and gender > 0.5
    odds = np.array([0.34, 0.26, 0.16, 0.16, 0.22 if skirted else 0.0])
    kind = str(generator.choice(TOPS, p=odds / odds.sum()))
    skirt = bool(skirted and generator.random() < 0.45)
    top = _draw_top(generator, kind, skirt)
    bottom = None if kind == "dress" else _draw_bottom(generator, skirt, top.tucked)
    outer = None
    if legs_down and kind in ("tee", "shirt", "sweater") and generator.random() < 0.45:
        outer = _draw_jacket(generator, top)
        # A jacket lies over a top that does not billow.
        top = replace(top, ease=min(top.ease, 0.012), sleeve=min(top.sleeve, 1.75))
    bare_ankle = bottom is None or bottom.cuff > -0.70
    footwear = str(generator.choice(["sneakers", "leather"], p=[0.65, 0.35]))
    shoe = -0.752
    if bare_ankle and generator.random() < 0.25:
        footwear, shoe = "boots", float(generator.uniform(-0.66, -0.60))
    return Outfit(top, bottom, outer, footwear, round(shoe, 3))


def _draw_top(generator: np.random.Generator, kind: str, skirt: bool) -> Top:
    short = round(float(generator.uniform(0.40, 0.66)), 3)
    long = round(float(generator.uniform(*LONG_SLEEVE)), 3)
    sleeve = {"tee": short, "sweater": long, "hoodie": long}.get(kind)
    if sleeve is None:
        sleeve = short if generator.random() < (0.4 if kind == "shirt" else 0.65) else long
    elif kind == "tee" and generator.random() < 0.12:
        sleeve = round(float(generator.uniform(0.85, 1.1)), 3)
    neckline = "shirt" if kind == "shirt" else "crew"
    if kind in ("tee", "dress", "sweater"):
        neckline = str(generator.choice(["crew", "vee", "scoop"], p=[0.5, 0.28, 0.22]))
    # Bodies differ in what they like: from fitted to loose.
    ease = float(generator.uniform(0.006, 0.034))
    if kind in ("sweater", "hoodie"):
        ease = float(generator.uniform(0.016, 0.036))
    tucked = kind in ("tee", "shirt") and bool(generator.random() < (0.6 if skirt else 0.22))
    hem = generator.uniform(SEAT, 0.045)
    if kind == "dress":
        hem = generator.uniform(-0.56, -0.26)
    front = {
        "tee": (["print", "pocket", "nothing"], [0.55, 0.2, 0.25]),
        "shirt": (["buttons"], [1.0]),
        "sweater": (["nothing", "print", "zip"], [0.45, 0.35, 0.2]),
        "hoodie": (["zip", "print", "pocket"], [0.4, 0.3, 0.3]),
        "dress": (["buttons", "nothing"], [0.4, 0.6]),
    }[kind]
    back = {"shirt": "yoke", "hoodie": "hood"}.get(kind)
    if back is None:
        back = "print" if generator.random() < 0.3 else "nothing"
    return Top(
        kind=kind,
        sleeve=sleeve,
        neckline=neckline,
        hem=round(float(hem), 3),
        ease=round(ease, 4),
        tucked=tucked,
        opening=0.0,
        front=str(generator.choice(front[0], p=front[1])),
        back=back,
        material=draw_material(generator, CLOTH_OF[kind]),
    )


def _draw_jacket(generator: np.random.Generator, inner: Top) -> Top:
    return Top(
        kind="jacket",
        sleeve=round(float(generator.uniform(1.80, 1.92)), 3),
        neckline="shirt",
        hem=round(float(max(generator.uniform(SEAT, 0.03), min(inner.hem - 0.01, 0.0), SEAT)), 3),
        ease=round(float(generator.uniform(0.020, 0.034)), 4),
        tucked=False,
        opening=round(float(generator.uniform(0.035, 0.085)), 3),
        front=str(generator.choice(["zip", "buttons"])),
        back=str(generator.choice(["yoke", "print", "nothing"], p=[0.4, 0.2, 0.4])),
        material=draw_material(generator, CLOTH_OF["jacket"]),
    )


def _draw_bottom(generator: np.random.Generator, skirt: bool, tucked: bool) -> Bottom:
    kind = "skirt" if skirt else str(generator.choice(["trousers", "shorts"], p=[0.76, 0.24]))
    cuff = {
        "skirt": generator.uniform(-0.55, -0.20),
        "shorts": generator.uniform(-0.36, -0.20),
        "trousers": generator.uniform(-0.735, -0.71),
    }[kind]
    if kind == "trousers" and generator.random() < 0.14:
        cuff = generator.uniform(-0.62, -0.54)
    return Bottom(
        kind=kind,
        waist=round(float(generator.uniform(0.110, 0.135)), 3),
        cuff=round(float(cuff), 3),
        ease=round(float(generator.uniform(0.010, 0.040)), 4),
        belt=kind != "skirt" and tucked,
        pockets=bool(kind != "skirt" and generator.random() < 0.8),
        material=draw_material(generator, CLOTH_OF[kind]),
    )
