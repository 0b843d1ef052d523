"""What is sewn on or worn with the clothes, and hair, by the texel of their cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from subjects.open.base.atlas import HAIR
from subjects.open.base.ramp import ramp
from subjects.open.texture.brush import Clouds, felled, line, stitched, tinted
from subjects.open.texture.fabric import Fabric, woven
from subjects.open.texture.look import Look
from subjects.open.texture.motif import motif
from subjects.open.texture.palette import Colour, rounded
from subjects.open.texture.skin import hair_colour
from subjects.open.texture.tops import thread

Painter = Callable[[np.ndarray, np.ndarray], np.ndarray]


def trimmings(look: Look, cloud: Clouds) -> dict[str, Painter]:
    """For each cell what gives the colours (N, 3) at its u, v (N,) in [0, 1]."""
    top, bottom, outer = look.top, look.bottom, look.outer or look.top

    def cloth(fabric: Fabric, wide: float, high: float, hem: float) -> Painter:
        """A piece of cloth of a size in metres, stitched along its edge."""

        def painter(u: np.ndarray, v: np.ndarray) -> np.ndarray:
            x, y = (u - 0.5) * wide, v * high
            colour = woven(fabric, x, y + 0.3, cloud)
            edge = np.minimum.reduce([u * wide, (1 - u) * wide, y])
            tinted(colour, thread(fabric), felled(edge - 0.002, x + y, 0.005))
            tinted(colour, thread(fabric), stitched((1 - v) * high - hem, x))
            return colour

        return painter

    def collar(fabric: Fabric, base: Colour | None) -> Painter:
        """Collars, bands and plackets lie in one cell whatever their shape: no pattern, no seam."""
        square = np.linspace(0.0, 0.24, 40)
        across, along = (g.ravel() for g in np.meshgrid(square, square))
        mean = base or rounded(woven(fabric, across, along, cloud).mean(axis=0))
        plain = replace(fabric, pattern="plain", base=mean)
        return lambda u, v: woven(plain, u * 0.42, v * 0.30, cloud)

    ribbed = top.weave in ("jersey", "brushed", "knit")
    return {
        HAIR: lambda u, v: _strands(look, u, v, cloud),
        "button": lambda u, v: _button(look, u, v, cloud),
        "metal": lambda u, v: _metal(look, u, v, cloud),
        "belt": lambda u, v: _belt(look, u, v, cloud),
        "lace": lambda u, v: _lace(look, u, v),
        "sole": lambda u, v: _sole(look, u, v, cloud),
        "collar": collar(top, look.collar if ribbed else None),
        "jacket_collar": collar(outer, None),
        "pocket": cloth(top, 0.12, 0.13, 0.020),
        "back_pocket": lambda u, v: _back_pocket(bottom, u, v, cloud),
        "jacket_pocket": cloth(outer, 0.12, 0.13, 0.030),
        "hood": cloth(top, 0.50, 0.36, 0.022),
        "lining": lambda u, v: _lining(look, u, v, cloud),
        "cap": lambda u, v: _headwear(look, u, v, cloud),
    }


def _filled(colour: Colour | np.ndarray, count: int) -> np.ndarray:
    result = np.empty((count, 3), dtype=np.float32)
    result[:] = colour
    return result


def _strands(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    """Strands side by side over u; v runs from the tips up to the roots, which are darker."""
    source = np.stack([u, v], axis=1)
    strand = 0.55 * cloud(source, (0.011, 0.6)) + 0.45 * cloud(source, (0.005, 0.22))
    strand = strand + 0.35 * cloud(source, (0.07, 1.5))
    colour = hair_colour(look, strand)
    colour *= (1.06 - 0.20 * ramp(v, 0.55, 1.0))[:, None]
    return colour


def _button(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    colour = _filled(look.buttons, len(u))
    colour *= (1.0 + 0.03 * cloud(np.stack([u, v], axis=1), 0.3))[:, None]
    r = np.hypot(u - 0.5, v - 0.5)
    dark = np.array(look.buttons) * 0.55
    tinted(colour, dark, 0.5 * ramp(np.abs(r - 0.36), 0.05, 0.01))
    hole = np.hypot(np.abs(u - 0.5) - 0.11, np.abs(v - 0.5) - 0.11)
    tinted(colour, np.array(look.buttons) * 0.25, ramp(hole, 0.07, 0.045))
    yarn = np.where(np.abs(v - 0.5) < 0.11, ramp(np.abs(np.abs(u - 0.5) - 0.11), 0.035, 0.02), 0.0)
    tinted(colour, thread(look.top), 0.8 * yarn)
    return colour


def _metal(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    colour = _filled(look.metal, len(u))
    return colour * (1.0 + 0.06 * cloud(np.stack([u, v], axis=1), (0.4, 0.03)))[:, None]


def _belt(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    """u once around, 0.5 in front; v across."""
    x, y = u * 0.92, v * 0.034
    colour = _filled(look.belt, len(u))
    colour *= (1.0 + 0.07 * cloud(np.stack([x, y], axis=1), 0.006))[:, None]
    edge = np.minimum(y, 0.034 - y)
    tinted(colour, np.array(look.belt) * 0.6 + 0.05, 0.7 * stitched(edge - 0.004, x))
    tinted(colour, np.array(look.belt) * 0.6, 0.6 * ramp(edge, 0.0015, 0.0))
    front = x - 0.46
    hole = np.hypot((front % 0.025) - 0.0125, y - 0.017)
    shown = (np.abs(front) > 0.025) & (front > 0) & (front < 0.15)
    tinted(colour, (0.06, 0.05, 0.05), shown * ramp(hole, 0.0026, 0.0016))
    return colour


def _lace(look: Look, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    plait = np.sin(40.0 * (u + v)) * np.sin(40.0 * (u - v))
    return _filled(look.laces, len(u)) * (1.0 + 0.08 * plait)[:, None].astype(np.float32)


def _sole(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    """u along or around the sole, v from its lower to its upper edge."""
    colour = _filled(look.soles, len(u))
    colour *= (1.0 + 0.04 * cloud(np.stack([u, v], axis=1), (0.02, 0.4)))[:, None]
    dark = np.array(look.soles) * 0.78
    tinted(colour, dark, 0.7 * line(v - 0.72, 0.05))
    tinted(colour, dark * 0.9, 0.5 * ramp(v, 0.14, 0.0))
    return colour


def _back_pocket(fabric: Fabric, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    x, y = (u - 0.5) * 0.14, v * 0.15
    colour = woven(fabric, x, y, cloud)
    sewn = thread(fabric)
    edge = np.minimum.reduce([u * 0.14, (1 - u) * 0.14, y])
    tinted(colour, sewn, felled(edge - 0.002, x + y, 0.005))
    tinted(colour, sewn, felled((1 - v) * 0.15 - 0.014, x, -0.009))
    if fabric.weave == "twill":
        tinted(colour, fabric.second, 0.35 * fabric.wear * ramp(edge, 0.035, 0.0))
        # Two arcs that meet in the middle.
        arc = y - 0.085 + 0.022 * np.cos(np.abs(x) / 0.07 * np.pi)
        tinted(colour, sewn, felled(arc, x))
    return colour


def _lining(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    colour = _filled(look.lining, len(u))
    quilt = np.minimum(np.abs((8.0 * (u + v)) % 1.0 - 0.5), np.abs((8.0 * (u - v)) % 1.0 - 0.5))
    tinted(colour, np.array(look.lining) * 0.7, 0.35 * ramp(quilt, 0.06, 0.02))
    return colour * (1.0 + 0.02 * cloud.grain(len(u)))[:, None]


def _headwear(look: Look, u: np.ndarray, v: np.ndarray, cloud: Clouds) -> np.ndarray:
    """u around the head, 0.5 in front; v from 0.25 at the edge up; below that the brim's rows."""
    fabric = look.headwear_fabric
    x, y = (u - 0.5) * 0.58, v * 0.20
    colour = woven(fabric, x, y, cloud)
    if look.headwear == "beanie":
        return colour
    sewn = thread(fabric)
    crown = v > 0.25
    # Six panels, each seam between two rows of thread; eyelets high up in each panel.
    panel = ((u + 1.0 / 12.0) * 6.0) % 1.0 - 0.5
    taper = np.clip(1.0 - v, 0.05, 1.0) * 0.095
    seam = (np.abs(panel) - 0.5) * taper
    tinted(colour, np.array(fabric.base) * 0.55, crown * 0.7 * line(seam))
    tinted(colour, sewn, crown * stitched(np.abs(seam) - 0.004, y))
    hole = np.hypot(panel * taper, (v - 0.72) * 0.20)
    tinted(colour, np.array(fabric.base) * 0.35, ramp(hole, 0.0035, 0.0022))
    rows = np.abs((v / 0.25 * 6.0) % 1.0 - 0.5) * 0.012
    tinted(colour, sewn, ~crown * stitched(rows, x))
    some = np.flatnonzero(crown & (np.abs(x) < 0.06))
    first, second = motif(look.front_print ^ 5, 2.4 * x[some], 2.4 * (y[some] - 0.098))
    part = colour[some]
    tinted(part, look.motif_second, 0.9 * second)
    tinted(part, look.headwear_motif, 0.95 * first)
    colour[some] = part
    return colour
