"""Sneakers, leather shoes and boots by the texel."""

from __future__ import annotations

import numpy as np

from subjects.open.base.ramp import ramp
from subjects.open.clothes.outfit import Outfit
from subjects.open.clothes.shoes import MAKES, shoe_field
from subjects.open.texture.brush import Clouds, box, felled, line, mix, stitched, tinted
from subjects.open.texture.look import Look
from subjects.open.texture.palette import Colour

FOOT = 0.222
"""Where a foot's middle line lies, metres off the template's middle plane."""
WELT = -0.797
"""Template height of the sole's upper edge."""
LACE_PITCH = 0.014


def paint_shoes(look: Look, outfit: Outfit, place: np.ndarray, cloud: Clouds) -> np.ndarray:
    """(M, 3) of shoes at template coordinates (M, 3)."""
    x, y, z = place.T
    aside = np.abs(x) - FOOT
    leather = outfit.footwear != "sneakers"
    colour = np.empty((len(place), 3), dtype=np.float32)
    colour[:] = look.shoes
    fine = cloud.grain(len(place))
    wrinkles = ramp(1.0 - np.abs(cloud(place, (0.03, 0.012, 0.009))), 0.86, 1.0)
    if leather:
        # Leather creases over the ball of the foot, and is darker in its folds.
        bend = np.exp(-(((z - 0.115) / 0.02) ** 2)) * ramp(y, -0.80, -0.785)
        colour *= (1.0 + 0.05 * cloud(place, 0.02) + 0.02 * fine)[:, None]
        tinted(colour, np.array(look.shoes) * 0.6, 0.5 * wrinkles * bend)
    else:
        colour *= (1.0 + 0.03 * fine)[:, None]
    dark = np.array(look.shoes) * 0.55
    rim = shoe_field(outfit.shoe, place)
    {"sneakers": _sneaker, "leather": _oxford, "boots": _boot}[outfit.footwear](
        colour, look, place, aside, dark
    )
    tinted(colour, dark, 0.6 * stitched(rim + 0.006, x + z))
    tinted(colour, dark, 0.5 * ramp(rim, -0.003, 0.0))
    # The sole, its edge grooved, and the seam above it.
    tread = 0.9 + 0.1 * ramp(np.abs((y / 0.006) % 1.0 - 0.5), 0.15, 0.3)
    sole = np.array(look.soles) * tread[:, None] * (1.0 + 0.02 * fine)[:, None]
    colour = mix(colour, sole, ramp(y, WELT + 0.0008, WELT - 0.0008))
    tinted(colour, dark, 0.7 * line(y - WELT - 0.001))
    if leather:
        tinted(colour, (0.66, 0.56, 0.42), stitched(y - WELT + 0.003, x + z, 0.006) * 0.7)
    return colour


def _seams(footwear: str, place: np.ndarray, aside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metres behind the toe cap's seam and ahead of the heel counter's, (M,) each."""
    _, y, z = place.T
    make = MAKES[footwear]
    return make.toe - make.bow * aside**2 - z, z - make.heel - 0.25 * (y + 0.76)


def _laces(
    colour: np.ndarray,
    laces: Colour,
    place: np.ndarray,
    aside: np.ndarray,
    span: tuple[float, float] | None,
) -> None:
    """Rows over the instep between two rows of eyelets; the laces themselves lie on top."""
    if span is None:
        return
    _, y, z = place.T
    within = (z > span[0]) & (z < span[1]) & (y > -0.785)
    phase = (z / LACE_PITCH) % 1.0 - 0.5
    slant = 0.010 * np.sign(aside) * (np.abs(aside) / 0.02)
    row = ramp(np.abs(((z + slant) / LACE_PITCH) % 1.0 - 0.5), 0.27, 0.20)
    tinted(colour, laces, within * row * ramp(np.abs(aside), 0.019, 0.017))
    hole = np.hypot(np.abs(aside) - 0.0195, phase * LACE_PITCH)
    tinted(colour, (0.10, 0.10, 0.10), within * ramp(hole, 0.0026, 0.0016))


def _sneaker(
    colour: np.ndarray, look: Look, place: np.ndarray, aside: np.ndarray, dark: np.ndarray
) -> None:
    _, y, z = place.T
    panels, sewn = look.shoe_panels, np.array(look.shoe_panels) * 0.7
    toe, heel = _seams("sneakers", place, aside)
    tinted(colour, panels, ramp(-toe, -0.001, 0.001) * (y > -0.80))
    tinted(colour, sewn, felled(toe - 0.003, aside) * (y > WELT))
    tinted(colour, panels, ramp(heel, 0.001, -0.001))
    tinted(colour, sewn, felled(heel - 0.003, y))
    # The facing that holds the eyelets, the tongue between its halves, a stripe on each side.
    tongue = (z > 0.030) & (z < 0.118) & (y > -0.785)
    tinted(colour, panels, tongue * ramp(np.abs(aside), 0.014, 0.012))
    tinted(colour, dark, tongue * 0.8 * line(np.abs(aside) - 0.014))
    tinted(colour, dark, tongue * 0.6 * stitched(np.abs(aside) - 0.026, z))
    flank = (np.abs(aside) > 0.018) & (z > 0.0) & (z < 0.12)
    sweep = y + 0.786 - 0.20 * (0.07 - z)
    tinted(colour, panels, flank * ramp(np.abs(sweep), 0.0075, 0.0060))
    _laces(colour, look.laces, place, aside, MAKES["sneakers"].laced)


def _oxford(
    colour: np.ndarray, look: Look, place: np.ndarray, aside: np.ndarray, dark: np.ndarray
) -> None:
    _, y, z = place.T
    upper = y > WELT
    toe, heel = _seams("leather", place, aside)
    tinted(colour, dark, upper * (0.6 * line(toe) + 0.7 * stitched(toe + 0.003, aside)))
    quarter = z - 0.088 + 5.0 * np.maximum(np.abs(aside) - 0.02, 0.0)
    tinted(colour, dark, upper * (0.6 * line(quarter) + 0.6 * stitched(quarter + 0.003, y)))
    tinted(colour, dark, upper * 0.7 * felled(heel, y))
    slit = (z > 0.030) & (z < 0.088) & (y > -0.785)
    tinted(colour, dark, slit * ramp(np.abs(aside), 0.005, 0.004))
    _laces(colour, look.laces, place, aside, MAKES["leather"].laced)


def _boot(
    colour: np.ndarray, look: Look, place: np.ndarray, aside: np.ndarray, dark: np.ndarray
) -> None:
    _, y, z = place.T
    upper = y > WELT
    vamp = y + 0.765 - 0.5 * (z - 0.05)
    tinted(colour, dark, upper * (z > -0.01) * (0.6 * line(vamp) + 0.6 * felled(vamp - 0.003, z)))
    toe, heel = _seams("boots", place, aside)
    tinted(colour, dark, upper * 0.7 * np.maximum(felled(heel, y), felled(toe + 0.003, aside)))
    # An elastic gusset over each ankle.
    gusset = box(z, y, (0.004, -0.715), (0.021, 0.045)) * (np.abs(aside) > 0.012)
    gusset = np.where(np.abs(aside) > 0.012, gusset, 1.0)
    groove = ramp(np.abs((z / 0.004) % 1.0 - 0.5), 0.1, 0.3)
    inside = ramp(gusset, 0.001, -0.001)
    tinted(colour, np.array(look.shoes) * 0.45, inside * (0.65 + 0.35 * groove))
    tinted(colour, dark, 0.7 * stitched(gusset - 0.003, y + z))
    pull = box(aside, y, (0.0, -0.65), (0.008, 0.03)) + 10.0 * (z > -0.01)
    tinted(colour, look.shoe_panels, ramp(pull, 0.001, -0.001))
