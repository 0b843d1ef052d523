"""The draw of one human's colours: skin, hair and eyes by descent and age, clothes that match."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from subjects.open.clothes.outfit import Outfit
from subjects.open.texture.fabric import Fabric, draw_fabric
from subjects.open.texture.palette import (
    ACCENTS,
    BUTTONS,
    DENIM,
    EYE_COLOURS,
    HAIR_COLOURS,
    LEATHER,
    METAL,
    NEUTRALS,
    RUBBER,
    SKIN,
    TRAINERS,
    TROUSERS,
    Colour,
    contrasting,
    picked,
    rounded,
)

FRECKLED = 0.25
"""Share of fair people with freckles."""
CAPPED, BEANIED = 0.12, 0.05
"""Shares of people who wear a cap or a beanie."""


@dataclass(frozen=True)
class Look:
    """The colours of one human and what is printed on the clothes."""

    skin: Colour
    lips: Colour
    flush: float
    """How red cheeks, nose, ears and knuckles are, 0 to 1."""
    freckles: float
    """How many there are, 0 to 1."""
    hair_style: str
    hair_name: str
    hair: Colour
    grey: float
    """Share of grey strands."""
    headwear: str
    """none, cap or beanie."""
    headwear_fabric: Fabric
    headwear_motif: Colour
    beard: float
    """0 none, 0.35 stubble, up to 1 a full beard."""
    eye_name: str
    eyes: Colour
    top: Fabric
    bottom: Fabric
    outer: Fabric | None
    collar: Colour
    lining: Colour
    motif: Colour
    motif_second: Colour
    front_print: int
    """Seed of the print on the front, where the outfit has one."""
    back_print: int
    buttons: Colour
    metal: Colour
    belt: Colour
    shoes: Colour
    shoe_panels: Colour
    laces: Colour
    soles: Colour

    def as_json(self) -> dict[str, Any]:
        """The colours, JSON-ready."""
        return asdict(self)


def draw_look(
    generator: np.random.Generator, phenotype: dict[str, float], age: float, outfit: Outfit
) -> Look:
    """Colours that go with the phenotype, and with each other.

    Args:
        phenotype: anny's, by name: gender, caucasian, asian and african count.
        age: years; hair greys and thins with it.
    """
    return Look(
        **_draw_person(generator, phenotype, age),
        **_draw_clothes(generator, outfit),
        **_draw_accessories(generator, outfit),
    )


def _draw_person(
    generator: np.random.Generator, phenotype: dict[str, float], age: float
) -> dict[str, Any]:
    share = np.array([phenotype[k] for k in ("caucasian", "asian", "african")])
    share = share**2 / (share**2).sum()
    depth = float(np.clip(share @ [0.22, 0.36, 0.76] + generator.normal(0, 0.11), 0.0, 1.0))
    at = depth * (len(SKIN) - 1)
    tone = np.array([np.interp(at, np.arange(len(SKIN)), SKIN[:, k]) for k in range(3)])
    # Warmer or cooler, at the same depth.
    tone = tone * (1.0 + generator.normal(0, 0.018) * np.array([0.5, 0.0, -1.0]))
    lips = tone * [0.88, 0.70, 0.70] + [0.02, 0.0, 0.008]
    male = phenotype["gender"] < 0.5
    fair = float(share[0] * (1.0 - depth))
    names = list(HAIR_COLOURS)[:6]
    odds = np.array([1.0, 1.2, 1.6 * fair, 1.2 * fair, 1.2 * fair, 0.5 * fair])
    name = str(generator.choice(names, p=odds / odds.sum()))
    grey = float(np.clip((age - 34.0) / 40.0 + generator.normal(0, 0.18), 0.0, 1.0))
    if not male and generator.random() < 0.5:
        grey *= 0.25  # dyed
    grey = grey if grey > 0.12 else 0.0
    if grey > 0.75:
        name = "white" if generator.random() < 0.35 else "grey"
    hair_colour = np.array(HAIR_COLOURS[name]) / 255.0 * (1 + generator.normal(0, 0.06))
    style = _draw_style(generator, male, age, float(share[2]))
    eye_odds = np.array([1.0, 0.9, 0.6 * fair, 0.4 * fair, 1.2 * fair, 0.5 * fair])
    eye = str(generator.choice(list(EYE_COLOURS), p=eye_odds / eye_odds.sum()))
    beard = float(generator.choice([0.0, 0.35, 1.0], p=[0.5, 0.3, 0.2])) if male else 0.0
    red = name == "red"
    freckled = fair > 0.4 and generator.random() < (0.8 if red else FRECKLED)
    return {
        "skin": rounded(tone),
        "lips": rounded(lips),
        "flush": round(float(generator.uniform(0.25, 1.0) * (1.0 - 0.75 * depth)), 3),
        "freckles": round(float(generator.uniform(0.35, 1.0)), 3) if freckled else 0.0,
        "hair_style": style,
        "hair_name": name,
        "hair": rounded(hair_colour),
        "grey": round(grey, 3) if grey <= 0.75 else 0.0,
        "beard": beard,
        "eye_name": eye,
        "eyes": rounded(np.array(EYE_COLOURS[eye]) / 255.0 * (1 + generator.normal(0, 0.06))),
    }


def _draw_style(generator: np.random.Generator, male: bool, age: float, african: float) -> str:
    if male:
        bald = 0.04 + 0.18 * float(np.clip((age - 30) / 40, 0, 1))
        odds = {"bald": bald, "cropped": 0.24, "short": 0.46, "curly": 0.10, "bob": 0.04}
        odds |= {"long": 0.04, "ponytail": 0.02, "bun": 0.02}
    else:
        odds = {"cropped": 0.02, "short": 0.14, "bob": 0.22, "long": 0.28, "ponytail": 0.14}
        odds |= {"bun": 0.10, "curly": 0.10}
    odds["afro"] = 0.45 * african
    if african > 0.5:
        odds |= {"curly": 0.2, "cropped": 0.35 if male else 0.08}
    total = sum(odds.values())
    return str(generator.choice(list(odds), p=[o / total for o in odds.values()]))


def _draw_clothes(generator: np.random.Generator, outfit: Outfit) -> dict[str, Any]:
    """One accent at most among top, bottom and jacket; the rest neutral or denim."""
    bottom = outfit.bottom
    # A jacket leaves the accent to what it shows; a skirt or shorts may take it.
    places = ["top", "top", "top", "none"] + (
        ["bottom"] if bottom and bottom.kind != "trousers" else []
    )
    places += ["outer"] if outfit.outer else []
    accent = places[int(generator.integers(len(places)))]

    def base(where: str, material: str) -> Colour:
        if material == "denim":
            return picked(generator, DENIM)
        if material == "leather":
            return picked(generator, LEATHER)
        if where == accent:
            return picked(generator, ACCENTS)
        return picked(generator, TROUSERS if where == "bottom" else NEUTRALS)

    top = outfit.top
    top_fabric = draw_fabric(generator, top.kind, top.material.name, base("top", top.material.name))
    bottom_fabric = top_fabric
    if bottom is not None:
        name = bottom.material.name
        bottom_base = base("bottom", name)
        for _ in range(8):  # no suit of one colour by accident
            if np.abs(np.array(bottom_base) - top_fabric.base).max() > 0.15:
                break
            bottom_base = base("bottom", name)
        kind = bottom.kind
        bottom_fabric = draw_fabric(generator, kind, name, bottom_base)
        if top_fabric.pattern not in ("plain", "heather", "block"):
            # One loud pattern is enough.
            bottom_fabric = replace(bottom_fabric, pattern="plain")
    outer = None
    if outfit.outer is not None:
        name = outfit.outer.material.name
        outer = draw_fabric(generator, "jacket", name, base("outer", name))
    collar = top_fabric.base
    if top.kind in ("tee", "sweater", "hoodie") and generator.random() < 0.35:
        collar = top_fabric.second
    motif = contrasting(generator, top_fabric.base, 0.35)
    return {
        "top": top_fabric,
        "bottom": bottom_fabric,
        "outer": outer,
        "collar": collar,
        "lining": contrasting(generator, (outer or top_fabric).base, 0.12),
        "motif": motif,
        "motif_second": picked(generator, ACCENTS),
        "front_print": int(generator.integers(2**31)),
        "back_print": int(generator.integers(2**31)),
    }


def _draw_accessories(generator: np.random.Generator, outfit: Outfit) -> dict[str, Any]:
    leather = picked(generator, LEATHER)
    soles = picked(generator, RUBBER[:1] if generator.random() < 0.6 else RUBBER)
    shoes, panels = leather, rounded(np.array(leather) * 0.85)
    laces = rounded(np.array(leather) * 0.7)
    if outfit.footwear == "sneakers":
        shoes = picked(generator, TRAINERS)
        plain = generator.random() < 0.4
        panels = shoes if plain else picked(generator, TRAINERS + ACCENTS[:6])
        laces = rounded(np.array([0.92, 0.91, 0.88])) if generator.random() < 0.7 else shoes
    elif generator.random() < 0.6:
        soles = rounded(np.array([0.13, 0.12, 0.11]))
    headwear = str(
        generator.choice(["none", "cap", "beanie"], p=[1 - CAPPED - BEANIED, CAPPED, BEANIED])
    )
    hat = picked(generator, NEUTRALS if generator.random() < 0.6 else ACCENTS)
    material, garment = ("wool", "sweater") if headwear == "beanie" else ("cotton", "trousers")
    fabric = replace(draw_fabric(generator, garment, material, hat), pattern="plain")
    return {
        "headwear": headwear,
        "headwear_fabric": fabric,
        "headwear_motif": contrasting(generator, hat, 0.3),
        "buttons": picked(generator, BUTTONS),
        "metal": picked(generator, METAL),
        "belt": leather if generator.random() < 0.7 else picked(generator, LEATHER),
        "shoes": shoes,
        "shoe_panels": panels,
        "laces": laces,
        "soles": soles,
    }
