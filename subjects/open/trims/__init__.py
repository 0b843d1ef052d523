"""What is sewn on or worn with the clothes, as relief: fronts differ from backs by it.

A trim is laid over a garment as it came to lie on the body. Its lengths are real metres; where it
is, is named in template coordinates.
"""

from __future__ import annotations

import numpy as np

from subjects.open.base.chart import Chart
from subjects.open.base.surface import Piece, Solid
from subjects.open.clothes.outfit import Bottom, Outfit, Top
from subjects.open.clothes.worn import Worn
from subjects.open.trims import belt, buttons, chart, collar, hood, pockets, zips
from subjects.open.trims.band import edge, line

PLACKET_WIDTH = 0.032
EDGE_WIDTH = 0.028
BUTTON = 0.011
COAT_BUTTON = 0.018
ZIP_WIDTH, ZIP_TAPE = 0.009, 0.023
COAT_ZIP_WIDTH, COAT_ZIP_TAPE = 0.012, 0.020
NECK = 0.62
"""Template height above every neckline."""
SHORTEST = 40
"""Rows of a band; what is shorter is no front to be fastened."""
SIDE_POCKET = 0.130
BREAST = (0.080, 0.415)
"""The middle of a breast pocket's mouth, template x and y."""


def of_top(worn: Worn, outfit: Outfit, around: Solid) -> list[Piece]:
    """Collar or hood, and what the front carries: buttons, a zip, a pocket.

    Args:
        worn: the top or the jacket.
        around: what a collar and a hood must stay outside of: the body, its scalp raised by the
            hair; locks come later and lie over them.
    """
    top = worn.garment
    assert isinstance(top, Top)
    normal = chart.calmed(worn)
    front, neck = chart.sided(worn, normal, 1.0), chart.around_neck(worn, normal)
    pieces = []
    if top.back == "hood":
        pieces.append(hood.hood(worn, neck, around))
        pieces += hood.cords(front, NECK)
    elif top.neckline == "shirt":
        cut = collar.JACKET if top.kind == "jacket" else collar.SHIRT
        if outfit.outer is not None and top.kind != "jacket":
            cut = collar.UNDER_JACKET
        cell = "jacket_collar" if top.kind == "jacket" else "collar"
        pieces.append(collar.collar(worn, neck, around, cut, cell))
    else:
        pieces.append(collar.neckband(neck, "collar"))
    pieces += _fastened(front, top, outfit) if top.opening == 0 else _edged(front, top)
    pieces += _pocketed(worn, normal, front, outfit)
    return pieces


def of_bottom(worn: Worn) -> list[Piece]:
    """Pockets on the back, and a belt."""
    bottom = worn.garment
    assert isinstance(bottom, Bottom)
    normal = chart.calmed(worn)
    pieces = []
    if bottom.pockets:
        back = chart.sided(worn, normal, -1.0)
        shape = pockets.square(0.128, 0.140, point=0.026)
        for side in (-1.0, 1.0):
            mouth = (side * 0.082, bottom.waist - 0.056)
            pieces.append(pockets.patch(back, mouth, shape, 0.0020, 0.002, "back_pocket", -1.0))
    if bottom.belt:
        pieces += belt.belt(chart.around_waist(worn, normal))
    return pieces


def _fastened(front: Chart, top: Top, outfit: Outfit) -> list[Piece]:
    """A closed front."""
    lower = top.hem - 1.0
    if top.tucked and outfit.bottom is not None:
        lower = outfit.bottom.waist + 0.014
    middle = line(front, 0.0, NECK, lower)
    if len(middle) < SHORTEST or top.front not in ("buttons", "zip"):
        return []
    if top.front == "zip":
        return zips.teeth(front, middle, ZIP_WIDTH, ZIP_TAPE, "collar")
    cloth, centre, out = buttons.placket(front, middle, PLACKET_WIDTH, "collar")
    return [cloth, *buttons.buttons(centre, out, BUTTON)]


def _edged(front: Chart, top: Top) -> list[Piece]:
    """Both edges of an open front; buttons are on the right one, as on a man's jacket."""
    pieces: list[Piece] = []
    for side in (-1.0, 1.0):
        width = EDGE_WIDTH if top.front == "buttons" else COAT_ZIP_TAPE
        middle = edge(front, side, NECK, top.hem - 0.1, inward=0.55 * width)
        if len(middle) < SHORTEST:
            continue
        if top.front == "zip":
            pieces += zips.teeth(front, middle, COAT_ZIP_WIDTH, COAT_ZIP_TAPE, "jacket_collar")
            continue
        cloth, centre, out = buttons.placket(front, middle, width, "jacket_collar")
        pieces.append(cloth)
        if side < 0:
            pieces += buttons.buttons(centre, out, COAT_BUTTON)
    return pieces


def _pocketed(worn: Worn, normal: np.ndarray, front: Chart, outfit: Outfit) -> list[Piece]:
    top = worn.garment
    assert isinstance(top, Top)
    if top.kind == "hoodie" and top.front == "pocket":
        return [pockets.kangaroo(front, (0.0, top.hem + 0.215), "pocket")]
    if top.kind == "jacket":
        return _side_pockets(chart.around_trunk(worn, normal), top)
    if outfit.outer is None and (top.front == "pocket" or top.kind == "shirt"):
        shape = pockets.square(0.098, 0.112)
        return [pockets.patch(front, BREAST, shape, 0.0020, 0.002, "pocket", 1.0)]
    return []


def _side_pockets(trunk: Chart, top: Top) -> list[Piece]:
    """A jacket's pockets, beside the bands of its open front."""
    mouth = top.hem + 0.205
    angle = np.arange(0.0, 1.5, 0.02)
    pieces = []
    for side in (-1.0, 1.0):
        held = trunk.holds(np.stack([side * angle, np.full(len(angle), mouth - 0.07)], axis=1))
        first = float(angle[held.argmax()])
        away = EDGE_WIDTH + 0.012 + 0.5 * SIDE_POCKET
        across = float(trunk.scale(np.array([side * (first + 0.5), mouth]))[0])
        centre = (side * (first + away / across), mouth)
        shape = pockets.square(SIDE_POCKET, 0.145)
        pieces.append(pockets.patch(trunk, centre, shape, 0.003, 0.003, "jacket_pocket", 1.0))
    return pieces


__all__ = ["of_bottom", "of_top"]
