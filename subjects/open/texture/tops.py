"""Tops and jackets by the texel: seams, stitching, ribbing, bands, panels and prints."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from subjects.open.base.ramp import ramp
from subjects.open.clothes import garments
from subjects.open.clothes.outfit import Outfit, Top
from subjects.open.texture.brush import Clouds, felled, line, stitched, tinted
from subjects.open.texture.fabric import Fabric, woven
from subjects.open.texture.look import Look
from subjects.open.texture.motif import motif
from subjects.open.texture.palette import Colour, lightness, rounded
from subjects.open.texture.suit import ARM_JOINT, Suit

ARMHOLE = 0.135
"""Joints from the shoulder to the seam of the sleeve."""
YOKE_FRONT, YOKE_BACK, YOKE_JACKET = 0.505, 0.470, 0.435
RIB = {"sweater": 0.050, "hoodie": 0.055}
"""Metres of ribbing at cuffs and hem."""
BLOCK_LINE = 0.345
PRINT_FRONT, PRINT_BACK = 0.365, 0.390


def thread(fabric: Fabric) -> Colour:
    """What a fabric is sewn with: golden on denim, else its own tone."""
    if fabric.weave == "twill" and lightness(fabric.base) > 0.17:
        return (0.72, 0.54, 0.30)
    if lightness(fabric.base) < 0.22:
        return rounded(np.array(fabric.base) * 1.35 + 0.05)
    return rounded(np.array(fabric.base) * 0.74)


def paint_top(
    fabric: Fabric, top: Top, outfit: Outfit, look: Look, suit: Suit, cloud: Clouds
) -> np.ndarray:
    """(N, 3) of a top, or of the jacket over it, all over a chart's texels."""
    x, y, z = suit.place.T
    trunk = ~suit.on_arm
    colour = woven(fabric, suit.around, suit.along, cloud)
    if fabric.pattern == "block":
        # Sleeves and chest of one colour, the rest of another.
        tinted(colour, fabric.second, ramp(y, BLOCK_LINE - 0.001, BLOCK_LINE + 0.001))
        tinted(colour, fabric.second, suit.on_arm.astype(np.float32))
    if fabric.weave == "twill":
        _fade(colour, fabric, top, outfit, suit, cloud)
    dark, sewn = np.array(fabric.base) * 0.55, np.array(thread(fabric))
    _sew(colour, fabric, top, outfit, suit, dark)
    if top.kind in RIB:
        _rib(colour, top, outfit, suit, dark)
    elif top.kind == "jacket" and fabric.weave in ("brushed", "felt"):
        _rib(colour, top, outfit, suit, dark, 0.045)
    front, back = trunk & (z > 0.02), trunk & (z < -0.01)
    if top.kind == "jacket":
        _panels(colour, top, suit, dark, sewn)
    elif top.front == "buttons":
        # The placket's edge stitching; buttons and placket lie on top.
        tinted(colour, sewn, np.where(front, stitched(np.abs(x) - 0.0165, y), 0.0))
    if top.kind == "shirt" or top.back == "yoke":
        yoke = np.where(back, stitched(y - YOKE_BACK, x), 0.0)
        yoke = np.maximum(yoke, np.where(front, stitched(y - YOKE_FRONT, x), 0.0))
        tinted(colour, sewn, yoke)
        pleat = np.where(back & (y < YOKE_BACK), line(np.abs(x) - 0.012, 0.0013), 0.0)
        tinted(colour, dark, 0.5 * pleat * ramp(y, 0.30, 0.45))
    if top.front == "print" and top.kind != "jacket":
        _print(colour, look, look.front_print, x, y - PRINT_FRONT, trunk & (z > 0.045))
    if top.back == "print":
        _print(colour, look, look.back_print, -x, y - PRINT_BACK, trunk & (z < -0.012))
    if top.kind not in ("shirt", "jacket"):
        _neckband(colour, look, top, suit, dark)
    return colour


def _sew(
    colour: np.ndarray, fabric: Fabric, top: Top, outfit: Outfit, suit: Suit, dark: np.ndarray
) -> None:
    """The seams that every top has: sleeves, sides, shoulders, hem and cuffs."""
    x, y, z = suit.place.T
    on_arm, trunk = suit.on_arm, ~suit.on_arm
    sewn = thread(fabric)
    heavy = fabric.weave in ("twill", "grain")
    hole = ARM_JOINT * (suit.arm - ARMHOLE)
    near = np.abs(x) > 0.12
    seam = np.where(near & (y > 0.30), line(hole, 0.0018), 0.0)
    seam = np.maximum(seam, np.where(trunk & (np.abs(x) > 0.09), line(z - 0.004, 0.0015), 0.0))
    seam = np.maximum(seam, np.where(on_arm, line(suit.around + 0.072, 0.0015), 0.0))
    tinted(colour, dark, 0.55 * seam)
    if heavy or top.kind == "shirt":
        tinted(colour, sewn, np.where(near & (y > 0.30), felled(hole - 0.003, z + y), 0.0))
    if top.kind in RIB:
        return
    cuff = ARM_JOINT * (top.sleeve - suit.arm)
    cuffed = top.kind in ("shirt", "jacket") and top.sleeve > 1.3
    if cuffed:  # a sewn-on cuff, edged on both sides
        marks = np.maximum(felled(cuff - 0.058, suit.around), stitched(cuff - 0.004, suit.around))
        tinted(colour, dark, np.where(on_arm, 0.5 * line(cuff - 0.062), 0.0))
    else:
        marks = felled(cuff - 0.018, suit.around, 0.004)
    tinted(colour, sewn, np.where(on_arm, marks, 0.0))
    if not (top.tucked or top.kind == "dress"):
        edge = y - garments.hem_height(outfit, suit.place, top)
        turned = 0.010 if top.kind == "shirt" else 0.020
        tinted(colour, sewn, np.where(trunk, felled(edge - turned, suit.around, 0.004), 0.0))


def _rib(
    colour: np.ndarray,
    top: Top,
    outfit: Outfit,
    suit: Suit,
    dark: np.ndarray,
    wide: float | None = None,
) -> None:
    wide = wide or RIB[top.kind]
    cuff = np.where(suit.on_arm, ARM_JOINT * (top.sleeve - suit.arm), 1.0)
    edge = suit.place[:, 1] - garments.hem_height(outfit, suit.place, top)
    from_end = np.where(suit.on_arm, cuff, edge)
    within = ramp(from_end, wide + 0.001, wide - 0.001)
    groove = ramp(np.abs(suit.around / 0.0075 % 1.0 - 0.5), 0.10, 0.34)
    tinted(colour, dark, within * (0.10 + 0.42 * groove))
    tinted(colour, dark, 0.6 * line(from_end - wide, 0.0018))


def _neckband(colour: np.ndarray, look: Look, top: Top, suit: Suit, dark: np.ndarray) -> None:
    """A band of the collar's colour along the neckline, ribbed, with its seam."""
    neck = _from_neckline(top, suit)
    if top.kind == "dress":
        tinted(colour, dark, 0.5 * stitched(neck + 0.008, suit.around))
        return
    wide = garments.COLLAR_WIDTH
    band = ramp(neck, -wide - 0.001, -wide + 0.001)
    tinted(colour, look.collar, band)
    angle = np.arctan2(suit.place[:, 0], suit.place[:, 2])
    groove = ramp(np.abs(angle * 0.085 / 0.005 % 1.0 - 0.5), 0.12, 0.36)
    tinted(colour, np.array(look.collar) * 0.7, 0.45 * band * groove)
    tinted(colour, dark, 0.7 * line(neck + wide))
    tinted(colour, dark, 0.45 * stitched(neck + wide + 0.005, suit.around))


def _from_neckline(top: Top, suit: Suit) -> np.ndarray:
    """(N,) metres from the neckline, negative below it, -1 far from it.

    The field that cuts the neckline grows unevenly: its zero line is right, its size no distance.
    """
    some = np.flatnonzero(~suit.on_arm & (suit.place[:, 1] > 0.36))
    place = suit.place[some]
    field = garments.neckline_field(place, top.neckline)
    edge = place[np.abs(field) < 0.0012]
    away, _ = cKDTree(edge[:: max(1, len(edge) // 3000)]).query(place, distance_upper_bound=0.05)
    result = np.full(len(suit.place), -1.0, dtype=np.float32)
    result[some] = np.where(field < 0, -np.minimum(away, 1.0), np.minimum(away, 1.0))
    return result


def _print(
    colour: np.ndarray, look: Look, seed: int, x: np.ndarray, y: np.ndarray, side: np.ndarray
) -> None:
    some = np.flatnonzero(side & (np.abs(x) < 0.135) & (np.abs(y) < 0.13))
    first, second = motif(seed, x[some], y[some])
    part = colour[some]
    grain = part / np.maximum(part.mean(axis=0), 0.05)  # ink lies in the weave
    tinted(part, np.array(look.motif_second) * (0.7 + 0.3 * grain), 0.95 * second)
    tinted(part, np.array(look.motif) * (0.7 + 0.3 * grain), 0.95 * first)
    colour[some] = part


def _panels(colour: np.ndarray, top: Top, suit: Suit, dark: np.ndarray, sewn: np.ndarray) -> None:
    """A jacket's yoke, its panel seams down front and back, and the edge of its opening."""
    x, y, z = suit.place.T
    trunk = ~suit.on_arm
    front, back = trunk & (z > 0.015), trunk & (z < -0.005)
    yoke = y - np.where(front, YOKE_JACKET, YOKE_BACK)
    below = ramp(yoke, 0.0, -0.002)
    slant_front = np.abs(x) - 0.105 + 0.10 * (YOKE_JACKET - y)
    slant_back = np.abs(x) - 0.085 + 0.08 * (YOKE_BACK - y)
    panel = np.where(front, slant_front, slant_back)
    seen = (front | back).astype(np.float32)
    if top.back == "nothing":
        seen = front.astype(np.float32)
    tinted(colour, dark, 0.5 * seen * np.maximum(line(yoke), line(panel) * below))
    tinted(colour, sewn, seen * felled(yoke - 0.004, x))
    tinted(colour, sewn, seen * below * felled(panel - 0.003, y))
    half = garments.opening_field(top, suit.place)
    tinted(colour, sewn, np.where(front, felled(half + 0.008, y, -0.022), 0.0))
    if top.front == "zip":
        tinted(colour, dark, np.where(front, 0.4 * ramp(half, -0.007, -0.005), 0.0))


def _fade(
    colour: np.ndarray, fabric: Fabric, top: Top, outfit: Outfit, suit: Suit, cloud: Clouds
) -> None:
    """Denim pales where it is rubbed: elbows, shoulders and along its edges."""
    x, y, _ = suit.place.T
    rub = 0.5 + 0.5 * cloud(suit.place, 0.07)
    elbow = np.where(suit.on_arm, np.exp(-(((suit.arm - 1.0) / 0.35) ** 2)), 0.0)
    shoulder = ramp(y, 0.44, 0.54) * ramp(np.abs(x), 0.24, 0.14)
    edge = np.exp(-np.abs(y - garments.hem_height(outfit, suit.place, top)) / 0.012)
    share = fabric.wear * (0.30 * rub + 0.30 * elbow + 0.18 * shoulder + 0.25 * edge)
    tinted(colour, fabric.second, share)
