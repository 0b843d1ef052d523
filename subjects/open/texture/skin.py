"""Skin, face and the hair painted on it, by the texel."""

from __future__ import annotations

import numpy as np

from subjects.open.base.mask import masked
from subjects.open.base.ramp import ramp
from subjects.open.base.template import template
from subjects.open.hair import style as hair
from subjects.open.texture.brush import Clouds, line, mix, tinted
from subjects.open.texture.look import Look
from subjects.open.texture.palette import lightness

HEAD = 0.59
"""Template height above which the body is a head."""
MOUTH = 0.6735
"""Template height of the line between the lips."""


def hair_colour(look: Look, strand: np.ndarray) -> np.ndarray:
    """(N, 3) of strands; `strand` (N,) in about [-1, 1] sets them apart."""
    base = np.array(look.hair, dtype=np.float32)
    light = base * 1.45 + 0.02
    colour = mix(np.broadcast_to(base * 0.72, (len(strand), 3)), light, 0.5 + 0.42 * strand)
    if look.grey > 0:
        # Single strands lose their colour, more and more of them.
        silver = ramp(strand, 1.15 - 2.0 * look.grey, 1.45 - 2.0 * look.grey)
        tinted(colour, (0.66, 0.65, 0.64), 0.5 * silver + 0.25 * look.grey)
    return colour


def paint_skin(look: Look, place: np.ndarray, source: np.ndarray, cloud: Clouds) -> np.ndarray:
    """(N, 3) of the whole skin at template coordinates (N, 3), base-mesh chart (N, 2)."""
    place = place.astype(np.float32)
    y = place[:, 1]
    skin = np.array(look.skin, dtype=np.float32)
    dark = 1.0 - lightness(skin)
    mottle = 0.022 * cloud(place, 0.045) + 0.016 * cloud(place, 0.010) + 0.010 * cloud.grain(len(y))
    colour = skin * (1.0 + mottle[:, None])
    blood = cloud(place, 0.016)
    tinted(colour, skin * [1.03, 0.90, 0.89], 0.35 * look.flush * np.maximum(blood, 0.0))
    _limbs(colour, look, place, source, dark)
    some = np.flatnonzero(y > HEAD)
    colour[some] = _head(look, colour[some], place[some], source[some], cloud)
    return colour


def _limbs(
    colour: np.ndarray, look: Look, place: np.ndarray, source: np.ndarray, dark: float
) -> None:
    """Hands and feet: pale palms and soles on dark skin, redder knuckles, nails; elbows, knees."""
    x, y, z = place.T
    skin = np.array(look.skin)
    joints = template().joints
    hand, palm_side = joints["l-hand"], np.array([-0.55, -0.55, 0.62])
    some = np.flatnonzero((np.abs(x) > 0.36) & (y < 0.30) & (y > 0.1))
    tint = colour[some]
    # The palm faces inwards and down in the template; seen by which side of the hand's plane.
    aside = np.abs(x[some]) - hand[0], y[some] - hand[1], z[some] - hand[2]
    knuckle, tip = joints["l-finger-3-1"] - hand, joints["l-finger-3-4"] - hand
    across = joints["l-finger-5-1"] - joints["l-finger-2-1"]
    normal = np.cross(knuckle, across)
    normal /= np.linalg.norm(normal) * np.sign(normal @ palm_side)
    bend = knuckle / np.linalg.norm(knuckle)
    local = np.stack(aside, axis=1)
    reach = local @ bend
    # Fingers curl towards the palm: the dividing surface curls with them.
    curl = np.interp(
        reach, [0.0, np.linalg.norm(knuckle), tip @ bend], [0.0, 0.0, (tip - knuckle) @ normal]
    )
    inner = ramp(local @ normal - curl, 0.0, 0.007) * ramp(reach, 0.0, 0.02)
    pale = skin + (np.array([0.86, 0.66, 0.56]) - skin) * np.clip(dark - 0.15, 0.05, 0.62)
    tinted(tint, pale, 0.85 * inner)
    tinted(tint, skin * [1.0, 0.84, 0.82], 0.30 * look.flush * inner)
    for finger in "12345":
        for joint in "123":
            at = joints[f"l-finger-{finger}-{joint}"] - hand
            near = np.exp(-((local - at) ** 2).sum(axis=1) / 0.009**2)
            tinted(tint, skin * [0.93, 0.76, 0.74], 0.45 * near * (1 - inner))
    colour[some] = tint
    for name, wide in (("elbow", 0.035), ("knee", 0.045)):
        at = joints[f"l-{name}"]
        near = np.exp(-(((np.abs(x) - at[0]) ** 2 + (y - at[1]) ** 2) / wide**2))
        near = near * (ramp(z, 0.0, -0.02) if name == "elbow" else ramp(z, 0.03, 0.07))
        tinted(colour, skin * [0.90, 0.76, 0.73], 0.35 * near)
    tinted(colour, pale, 0.8 * ramp(y, -0.808, -0.814))
    nails = masked("fingernails", source) + masked("toenails", source)
    tinted(colour, skin * 0.62 + [0.31, 0.24, 0.23], 0.75 * nails)


def _head(
    look: Look, colour: np.ndarray, place: np.ndarray, source: np.ndarray, cloud: Clouds
) -> np.ndarray:
    x, y, z = place.T
    skin = np.array(look.skin, dtype=np.float32)
    face = z > 0.06
    fine = cloud(place, (0.0014, 0.0035, 0.0035))
    red = skin * [1.02, 0.80, 0.78]
    lips = masked("lips", source)

    def spot(u: float, v: float, wide: float, high: float) -> np.ndarray:
        """A soft patch, on both sides alike."""
        away = ((np.abs(x) - u) / wide) ** 2 + ((y - v) / high) ** 2
        return np.where(face, np.exp(-away), 0.0)

    # Blood shows in cheeks, nose, ears and chin; the jaw is cooler, the brow yellower.
    flush = 0.16 + 0.36 * look.flush
    tinted(colour, red, flush * spot(0.042, 0.694, 0.020, 0.018))
    tinted(colour, red, 0.9 * flush * spot(0.0, 0.694, 0.013, 0.011))
    tinted(colour, red, 0.5 * flush * spot(0.0, 0.640, 0.016, 0.010))
    tinted(colour, red, 0.35 * masked("ears", source))
    tinted(colour, skin * [1.02, 1.0, 0.94], 0.30 * spot(0.0, 0.775, 0.045, 0.018))
    tinted(colour, skin * [0.80, 0.74, 0.76], 0.28 * spot(0.030, 0.714, 0.013, 0.005))
    tinted(colour, skin * [0.62, 0.46, 0.44], 0.75 * spot(0.0095, 0.6855, 0.0042, 0.0022))
    if look.freckles > 0:
        speck = cloud(place, 0.0031) + 0.5 * cloud(place, 0.0062)
        bridge = np.maximum(spot(0.030, 0.700, 0.026, 0.016), spot(0.0, 0.703, 0.016, 0.016))
        where = ramp(speck, 0.60, 0.85) * (0.18 + 0.82 * bridge) * face
        tinted(colour, skin * [0.76, 0.58, 0.46], 0.62 * look.freckles * where)

    # Lips: the upper one darker, fine upright creases, a dark line between.
    upper = ramp(y, MOUTH - 0.001, MOUTH + 0.001)
    crease = cloud(np.stack([x, y], axis=1), (0.0011, 0.02))
    lip = np.array(look.lips, dtype=np.float32) * (1.0 - 0.10 * upper + 0.05 * crease)[:, None]
    tinted(colour, lip, 0.80 * lips)
    tinted(colour, skin * [0.60, 0.32, 0.32], masked("inside-mouth", source))
    tinted(colour, np.array(look.lips) * 0.55, 0.7 * lips * line(y - MOUTH, 0.0012))

    colour = _eyes_and_brows(look, colour, place, fine)
    if look.beard > 0:
        colour = _beard(look, colour, place, lips, fine, cloud)
    return _scalp(look, colour, place, source, fine, cloud)


def _eyes_and_brows(
    look: Look, colour: np.ndarray, place: np.ndarray, fine: np.ndarray
) -> np.ndarray:
    x, y, z = place.T
    skin = np.array(look.skin)
    eye = template().joints["l-eye"]
    ex, ey = np.abs(x) - eye[0], y - eye[1]
    near = (z > 0.085).astype(np.float32)
    ring = np.hypot(ex / 0.0165, (ey + 0.0005) / 0.0075)
    tinted(colour, skin * [0.80, 0.74, 0.74], near * 0.55 * np.exp(-((ring / 1.8) ** 4)))
    # The wet rim, then lashes: dense above, sparse below.
    tinted(colour, skin * [0.95, 0.66, 0.64], near * 0.5 * np.exp(-(((ring - 0.80) / 0.12) ** 2)))
    lashes = np.exp(-(((ring - 1.0) / 0.12) ** 2)) * np.where(ey > 0, 1.0, 0.28)
    tinted(colour, np.array(look.hair) * 0.35 + 0.02, near * 0.80 * lashes)
    fold = np.exp(-(((ring - 1.55) / 0.10) ** 2)) * (ey > 0.004)
    tinted(colour, skin * [0.74, 0.64, 0.62], near * 0.45 * fold)
    # Brows arch over the eye and thin out towards the temple; single hairs slant outwards.
    t = (np.abs(x) - 0.012) / 0.043
    arch = eye[1] + 0.0215 + 0.0035 * np.sin(np.pi * np.clip(t, 0, 1) * 0.8)
    width = 0.0042 * (1.0 - 0.55 * np.clip(t, 0, 1))
    brow = np.exp(-(((y - arch) / width) ** 2)) * ramp(t, -0.10, 0.10) * ramp(t, 1.08, 0.80)
    hairs = ramp(np.sin((np.abs(x) * 1.6 - (y - arch) * 1.1) / 0.00042), -0.9, 0.5)
    fair = lightness(np.array(look.hair)) > 0.45 and look.hair_name not in ("grey", "white")
    brow_colour = np.array(look.hair) * (0.62 if fair else 0.80)
    share = brow * (0.62 + 0.22 * hairs + 0.25 * fine)
    tinted(colour, brow_colour, np.where(z > 0.06, share, 0.0))
    return colour


def _beard(
    look: Look,
    colour: np.ndarray,
    place: np.ndarray,
    lips: np.ndarray,
    fine: np.ndarray,
    cloud: Clouds,
) -> np.ndarray:
    x, y, z = place.T
    edge = 0.004 * cloud(place, 0.009) + 0.0015 * fine
    # From the cheeks' line down to where jaw and neck meet.
    low = 0.612 + 0.45 * np.maximum(0.115 - z, 0.0)
    jaw = ramp(y + edge, 0.705, 0.680) * ramp(y + edge - low, 0.0, 0.012) * ramp(z, 0.025, 0.05)
    cheek = ramp(np.abs(x) * 0.62 + 0.640 - y + edge, -0.008, 0.008)
    moustache = np.exp(-(((y - 0.6815) / 0.0050) ** 2)) * ramp(np.abs(x), 0.030, 0.022) * (z > 0.11)
    bare = np.exp(-((x / 0.014) ** 2) - ((y - 0.6625) / 0.0035) ** 2)
    where = np.maximum(jaw * cheek, moustache) * (1.0 - 0.6 * bare) * (1.0 - lips)
    if look.beard < 0.6:
        # Stubble: single dots, and the bluish shade of the roots under the skin.
        dots = ramp(cloud.grain(len(y)), 0.3, 1.4)
        tinted(colour, np.array(look.skin) * [0.74, 0.73, 0.76], 0.45 * where)
        tinted(colour, hair_colour(look, fine) * 0.9, 0.65 * where * dots)
    else:
        strand = 0.7 * cloud(place, (0.0013, 0.008, 0.004)) + 0.4 * cloud.grain(len(y))
        tinted(colour, hair_colour(look, strand), 0.92 * ramp(where + 0.12 * fine, 0.15, 0.75))
    return colour


def _scalp(
    look: Look,
    colour: np.ndarray,
    place: np.ndarray,
    source: np.ndarray,
    fine: np.ndarray,
    cloud: Clouds,
) -> np.ndarray:
    x, y, z = place.T
    grown = hair.growth(place, source)
    if look.hair_style == "bald":
        shadow = 0.20 * ramp(grown, -0.005, 0.02) * (0.8 + 0.3 * fine)
        tinted(colour, np.array(look.hair) * 0.7 + np.array(look.skin) * 0.2, shadow)
        return colour
    grown = grown + 0.005 * cloud(place, 0.006) + 0.003 * fine
    around = np.arctan2(x, z - 0.04)
    strand = 0.6 * cloud(np.stack([around, y], axis=1), (0.030, 0.30)) + 0.5 * fine
    if look.hair_style == "cropped":
        # Skin shimmers through hair this short, most at its edge.
        strand = 0.22 * cloud.grain(len(y)) + 0.3 * cloud(place, 0.0022) - 0.25
        share = ramp(grown, -0.004, 0.030) * (0.86 + 0.10 * strand)
    else:
        share = ramp(grown, -0.003, 0.010)
    tinted(colour, hair_colour(look, strand), share)
    return colour
