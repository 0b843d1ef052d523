"""The texture of one human: every chart and cell of the atlas, painted."""

from __future__ import annotations

import numpy as np

from subjects.open.base.atlas import CELLS, GROUPS, OUTER, texels
from subjects.open.base.template import BODY, EYES, SKIRT, TIGHTS
from subjects.open.clothes import garments
from subjects.open.clothes.outfit import Outfit
from subjects.open.clothes.shoes import shoe_field
from subjects.open.texture.bottoms import paint_legs, paint_skirt
from subjects.open.texture.brush import Clouds
from subjects.open.texture.eyes import paint_eye
from subjects.open.texture.footwear import paint_shoes
from subjects.open.texture.look import Look
from subjects.open.texture.skin import paint_skin
from subjects.open.texture.suit import Suit, suit
from subjects.open.texture.tops import paint_top
from subjects.open.texture.trimmings import trimmings


def paint(look: Look, outfit: Outfit, size: int, generator: np.random.Generator) -> np.ndarray:
    """The atlas, (size, size, 3) uint8 sRGB, row 0 at the top; charts of nothing worn are black."""
    baked = texels(size)
    colour = np.zeros((len(baked.pixel), 3), dtype=np.float32)

    def put(name: str, painted: np.ndarray) -> None:
        colour[baked.group == GROUPS.index(name)] = painted

    def of(name: str) -> tuple[np.ndarray, np.ndarray]:
        chosen = baked.group == GROUPS.index(name)
        return baked.place[chosen], baked.source[chosen]

    cloud = Clouds(generator)
    put(BODY, paint_skin(look, *of(BODY), cloud))
    put(TIGHTS, _inner(look, outfit, suit(TIGHTS, size), cloud))
    if outfit.outer is not None and look.outer is not None:
        jacket = suit(OUTER, size)
        put(OUTER, paint_top(look.outer, outfit.outer, outfit, look, jacket, cloud))
    if outfit.bottom is None or outfit.bottom.kind == "skirt":
        put(SKIRT, paint_skirt(look, outfit, suit(SKIRT, size), cloud))
    for eye in EYES:
        joint = eye.removeprefix("helper-")
        put(eye, paint_eye(look, of(eye)[0], joint, cloud))
    painters = trimmings(look, cloud)
    for name in CELLS:
        put(name, painters[name](*of(name)[1].T))
    picture = np.round(np.clip(colour, 0.0, 1.0) * 255.0).astype(np.uint8)
    return picture[baked.nearest].reshape(size, size, 3)


def _inner(look: Look, outfit: Outfit, suit: Suit, cloud: Clouds) -> np.ndarray:
    """Top, trousers and shoes, which share one chart and no texel of it."""
    place = suit.place
    y = place[:, 1]
    colour = paint_top(look.top, outfit.top, outfit, look, suit, cloud)
    bottom = outfit.bottom
    shoe_top = outfit.shoe
    if bottom is not None and bottom.kind != "skirt":
        legs = np.flatnonzero(~suit.on_arm & below_top(outfit, place))
        colour[legs] = paint_legs(look.bottom, bottom, suit, legs, cloud)
        shoe_top = max(shoe_top, bottom.cuff)
    foot = np.flatnonzero((shoe_field(outfit.shoe, place) < 0.004) & (y < shoe_top))
    colour[foot] = paint_shoes(look, outfit, place[foot], cloud)
    return colour


def below_top(outfit: Outfit, place: np.ndarray) -> np.ndarray:
    """(N,) bool: where the suit's chart shows the bottom rather than the top."""
    if outfit.top.tucked and outfit.bottom is not None:
        edge = garments.waist_height(outfit.bottom, place) + 0.004
    else:
        edge = garments.hem_height(outfit, place) - 0.004
    return place[:, 1] < edge
