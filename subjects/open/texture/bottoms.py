"""Trousers, shorts and skirts by the texel."""

from __future__ import annotations

import numpy as np

from subjects.open.base.ramp import ramp
from subjects.open.clothes import garments
from subjects.open.clothes.outfit import Bottom, Outfit
from subjects.open.texture.brush import Clouds, box, felled, line, stitched, tinted
from subjects.open.texture.fabric import Fabric, woven
from subjects.open.texture.look import Look
from subjects.open.texture.suit import LEG_RADIUS, Suit
from subjects.open.texture.tops import thread

WAISTBAND = 0.036
FLY = 0.15
"""Metres below the waist at which the fly ends."""


def paint_legs(
    fabric: Fabric, bottom: Bottom, suit: Suit, some: np.ndarray, cloud: Clouds
) -> np.ndarray:
    """(M, 3) of trousers or shorts at the texels `some` (M,) of a chart."""
    place = suit.place[some]
    x, y, z = place.T
    around = suit.around_leg[some]
    angle = suit.leg[some]
    colour = woven(fabric, around, y, cloud)
    dark, sewn = np.array(fabric.base) * 0.55, np.array(thread(fabric))
    under = garments.waist_height(bottom, place) - y
    front, back = z > 0.03, z < -0.02
    denim = fabric.weave == "twill"
    soft = fabric.weave in ("jersey", "brushed")
    if denim:
        _fade(colour, fabric, bottom, place, angle, cloud)

    # Side seam, inseam and the seam between the legs.
    hips = y > -0.02
    side = np.where(hips, (z - 0.012) * (np.abs(x) > 0.09), LEG_RADIUS * (angle - np.pi / 2))
    side = np.where(hips & (np.abs(x) <= 0.09), 1.0, side)
    inner = np.where(y < -0.07, LEG_RADIUS * (angle + np.pi / 2), 1.0)
    middle = np.where((front | back) & (y > -0.09), x, 1.0)
    seams = np.maximum.reduce([line(side), line(inner), line(middle)])
    tinted(colour, dark, 0.6 * seams * (under > WAISTBAND))
    if denim:
        tinted(colour, sewn, (under > WAISTBAND) * felled(inner - 0.003, y))
        tinted(colour, sewn, (under > WAISTBAND) * back * felled(middle - 0.003, y))
    band = np.maximum(stitched(under - WAISTBAND, around), stitched(under - 0.004, around))
    if soft:
        groove = ramp(np.abs(around / 0.009 % 1.0 - 0.5), 0.10, 0.36)
        tinted(colour, dark, 0.35 * groove * ramp(under, WAISTBAND, WAISTBAND - 0.002))
        cords = np.where(front, line(np.abs(x) - 0.010 - 0.05 * under, 0.004), 0.0)
        cords = cords * ramp(under, 0.012, 0.016) * ramp(under, 0.115, 0.11)
        tinted(colour, (0.88, 0.87, 0.84), cords)
        end = y - bottom.cuff
        if bottom.kind == "trousers":
            tinted(colour, dark, 0.35 * groove * ramp(end, 0.05, 0.048))
            tinted(colour, dark, 0.5 * line(end - 0.05))
    else:
        tinted(colour, dark, 0.5 * line(under - WAISTBAND - 0.003))
        tinted(colour, sewn, band)
        _fly(colour, sewn, x, under, front)
        _pockets(colour, dark, sewn, bottom, x, y, under, front, back, denim)
        tinted(colour, sewn, felled(y - bottom.cuff - 0.016, around, 0.003))
        if fabric.weave in ("plain", "felt") and bottom.kind == "trousers":
            # Ironed edges down the front of the legs.
            press = np.where((y < -0.10) & (np.abs(angle) < 1.0), line(angle * LEG_RADIUS), 0.0)
            tinted(colour, np.array(fabric.base) * 1.12 + 0.01, 0.5 * press)
    return colour


def _fly(
    colour: np.ndarray, sewn: np.ndarray, x: np.ndarray, under: np.ndarray, front: np.ndarray
) -> None:
    """A row of stitches beside the opening that turns into it below."""
    deep = np.clip((under - FLY + 0.045) / 0.045, 0.0, 1.0)
    edge = 0.030 * np.sqrt(np.maximum(1.0 - deep**2, 0.0))
    shown = front & (under > WAISTBAND) & (under < FLY) & (x > -0.002)
    tinted(colour, sewn, shown * felled(x - edge, under, 0.004))


def _pockets(
    colour: np.ndarray,
    dark: np.ndarray,
    sewn: np.ndarray,
    bottom: Bottom,
    x: np.ndarray,
    y: np.ndarray,
    under: np.ndarray,
    front: np.ndarray,
    back: np.ndarray,
    denim: bool,
) -> None:
    """Mouths of the front pockets, yoke or welts behind; patch pockets lie on top."""
    if denim:
        round_mouth = np.hypot(np.abs(x) - 0.150, under - WAISTBAND) - 0.078
        shown = front & (under > WAISTBAND) & (np.abs(x) < 0.15)
    else:
        round_mouth = np.abs(x) - 0.095 - 0.42 * (under - WAISTBAND)
        shown = front & (under > WAISTBAND) & (under < 0.17)
    tinted(colour, dark, shown * 0.7 * line(round_mouth))
    tinted(colour, sewn, shown * felled(round_mouth - 0.004, under))
    if denim:
        vee = under - 0.082 + 0.22 * np.abs(x)
        tinted(colour, sewn, back * felled(vee, x))
        tinted(colour, dark, back * 0.5 * line(vee + 0.003))
    elif not bottom.pockets:
        welt = box(np.abs(x), y, (0.075, 0.035), (0.055, 0.006))
        tinted(colour, dark, back * 0.7 * line(welt))


def _fade(
    colour: np.ndarray,
    fabric: Fabric,
    bottom: Bottom,
    place: np.ndarray,
    angle: np.ndarray,
    cloud: Clouds,
) -> None:
    """Denim pales on thighs, knees and seat, in creases from the groin, and at the hem."""
    x, y, z = place.T
    front = np.exp(-((angle / 0.85) ** 2))
    thigh = front * np.exp(-(((y + 0.17) / 0.13) ** 2))
    knee = front * np.exp(-(((y + 0.36) / 0.07) ** 2))
    seat = ramp(z, -0.03, -0.07) * np.exp(-(((y - 0.0) / 0.08) ** 2))
    # Creases run from the groin outwards and up; each side has its own.
    outward = np.abs(x) - 0.02
    fan = np.arctan2(y + 0.055, np.maximum(outward, 0.005))
    key = np.stack([fan, np.sign(x)], axis=1)
    crease = ramp(cloud(key, (0.11, 1.3)), 0.25, 0.75)
    crease = (
        crease
        * ramp(z, 0.03, 0.07)
        * np.exp(-(((y + 0.02) / 0.065) ** 2))
        * ramp(outward, 0.0, 0.03)
    )
    hem = np.exp(-np.abs(y - bottom.cuff) / 0.010)
    uneven = 0.75 + 0.25 * cloud(place, 0.035)
    share = 0.62 * thigh + 0.40 * knee + 0.35 * seat + 0.40 * crease + 0.3 * hem
    tinted(colour, fabric.second, fabric.wear * share * uneven + 0.05 * cloud(place, 0.10))


def paint_skirt(look: Look, outfit: Outfit, suit: Suit, cloud: Clouds) -> np.ndarray:
    """(N, 3) of a skirt, or of a dress's lower part, over its own chart."""
    bottom = outfit.bottom
    fabric = look.top if bottom is None else look.bottom
    x, y, z = suit.place.T
    colour = woven(fabric, suit.around, y, cloud)
    dark, sewn = np.array(fabric.base) * 0.55, np.array(thread(fabric))
    hem = outfit.top.hem if bottom is None else bottom.cuff
    tinted(colour, sewn, stitched(y - hem - 0.022, suit.around))
    tinted(colour, dark, 0.45 * line(y - hem - 0.001, 0.002))
    side = np.where(np.abs(x) > 0.06, line(z - 0.004), 0.0)
    tinted(colour, dark, 0.45 * side)
    if bottom is None:
        tinted(colour, dark, 0.55 * line(y - garments.DRESS_SEAM + 0.013, 0.002))
        return colour
    under = garments.waist_height(bottom, suit.place) - y
    tinted(colour, dark, 0.5 * line(under - 0.033))
    tinted(
        colour,
        sewn,
        np.maximum(stitched(under - 0.030, suit.around), stitched(under - 0.004, suit.around)),
    )
    below = under > 0.033
    if fabric.weave == "twill":
        front = z > 0.02
        tinted(colour, dark, below * front * 0.6 * line(x))
        tinted(colour, sewn, below * felled(side - 1.0 + 0.003, y))
        _fly(colour, sewn, x, under, front)
        _pockets(colour, dark, sewn, bottom, x, y, under, front, z < -0.02, True)
    else:
        tinted(colour, dark, below * (z < 0) * (under < 0.18) * 0.6 * line(x))
    return colour
