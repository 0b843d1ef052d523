"""Shoes: a last around the foot, an upper cut over it, a sole under it and laces on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from subjects.open.base import lattice, surface
from subjects.open.base.chart import Chart
from subjects.open.base.ramp import ramp
from subjects.open.base.subdivision import loop
from subjects.open.base.surface import Pattern, Piece, Solid
from subjects.open.base.template import TIGHTS, template
from subjects.open.clothes.garments import pattern, refined

INSOLE = 0.003
"""Metres between the tights and the last's underside."""
TOE_ROOM = 0.010
"""Metres that the last stands off the toes."""
SOLE_ZONE = 0.016
"""Template metres above the ground in which the upper gives the sole its outline."""
AROUND = 96
"""Vertices around a sole."""
BELOW = (0.96, 0.88, 0.78, 0.66, 0.54, 0.42, 0.30, 0.18, 0.0)
"""Rings of the sole's underside, shares of its outline."""
SLENDER = 2.6
"""About how much longer than wide a sole is."""
SMOOTHING = 5
"""Averaging steps that take the anatomy out of the upper."""
FOOT = -0.70
"""Template height below which there is only foot."""
GROUND = -0.821
"""Template height of the tights' soles."""
UNDERSIDE = 0.010
"""Template metres over it up to which the last is flat."""
LEVEL, TILTED = 5.0, 9.0
"""Degrees up to which a foot stands on the ground, and from which it does not."""
BALL = 0.08
"""Template z from which the toes bend."""


@dataclass(frozen=True)
class Make:
    """How a kind of shoe is built, metres."""

    welt: float
    """Height of the sole's upper edge over the last's underside."""
    under: float
    """How far the sole goes below it."""
    rim: float
    """How far the sole stands out."""
    arch: float
    """How far the sole is hollowed before the heel."""
    cap: float
    """Relief of toe cap and heel counter."""
    padding: float
    """Of the upper edge."""
    toe: float
    """Where the toe cap begins, template metres ahead."""
    bow: float
    """How far its seam bends back at the sides, per metre squared."""
    heel: float
    """Where the heel's counter ends."""
    laced: tuple[float, float] | None
    """From where to where there are laces; none on boots that are pulled on."""


MAKES = {
    "sneakers": Make(
        0.010, 0.014, 0.0030, 0.0, 0.0018, 0.0030, 0.165, 60.0, -0.022, (0.034, 0.114)
    ),
    "leather": Make(
        0.006, 0.014, 0.0028, 0.009, 0.0014, 0.0008, 0.145, 40.0, -0.028, (0.036, 0.086)
    ),
    "boots": Make(0.008, 0.017, 0.0030, 0.010, 0.0014, 0.0020, 0.170, 40.0, -0.030, None),
}
MIDDLE = 0.222
"""Where a foot's middle line lies, template metres off the body's middle plane."""
LACE_PITCH = 0.014
LACE_SLANT = 0.5
LACE_WIDTH = 0.006
LACED = 0.0195
"""Half the way from eyelet to eyelet."""
TONGUE, FACING = 0.013, 0.029
"""Half the widths of the tongue and of the facings on both of its sides."""
TONGUE_RISE = 0.024
"""How far the tongue goes up beyond the rim."""


def shoe_field(shoe: float, place: np.ndarray) -> np.ndarray:
    """Negative where the shoes are: lower at the instep's sides than at heel and tongue.

    Args:
        shoe: template height of the shoe's upper edge.
        place: (N, 3) template coordinates.
    """
    x, y, z = place.T
    aside = np.abs(x) - MIDDLE
    tongue = TONGUE_RISE * np.exp(-((aside / 0.022) ** 2)) * ramp(z, 0.010, 0.045)
    return y - (shoe + 0.25 * np.maximum(z - 0.02, 0.0) + tongue)


def shoe_last(rest: np.ndarray) -> np.ndarray:
    """Rest base mesh (19158, 3) with the feet of the tights made into lasts.

    A last is flat below and has room for the toes.
    """
    used = np.unique(template().groups[TIGHTS].quads)
    place = template().vertices[used]
    foot = place[:, 1] < FOOT
    used, place = used[foot], place[foot]
    height = place[:, 1] - place[:, 1].min()
    result = rest.copy()
    for side in (1.0, -1.0):
        one = place[:, 0] * side > 0
        v, h, z = rest[used[one]], height[one], place[one, 2]
        # Away from the foot's own upright axis, most at the sole's rim.
        middle = v.mean(axis=0)
        aside = (v - middle) * [1.0, 0.0, 1.0]
        aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-6)
        rim = 1.0 - ramp(h, 0.012, 0.05)
        toe = ramp(z, 0.10, 0.19)
        last = v + aside * (0.004 + 0.005 * rim + TOE_ROOM * toe)[:, None]
        lift = 0.006 * (1 - rim) + 0.010 * toe * ramp(h, 0.01, 0.04)
        flat = v[:, 1].min() - INSOLE
        last[:, 1] = np.where(h < 0.016, flat, last[:, 1] - 0.5 * INSOLE * rim + lift)
        result[used[one]] = last
    return result


def shoes(footwear: str, shoe: float, last: np.ndarray, foot: Solid) -> list[Piece]:
    """A pair of shoes.

    Args:
        footwear: sneakers, leather or boots.
        shoe: template height of the upper edge.
        last: (19158, 3) posed base mesh with lasts, see `shoe_last`.
        foot: the bare body, posed.
    """
    make = MAKES[footwear]
    _, place, arm = refined(TIGHTS)
    coarse = pattern(TIGHTS, np.where(arm > 0.5, 0.2, shoe_field(shoe, place)))
    up, faces, uv = loop(coarse.faces, coarse.uv)
    cloth = Pattern((up @ coarse.matrix).tocsr(), faces, uv)
    place = cloth.matrix @ template().vertices
    laid = cloth.matrix @ last
    vertices = _upper(cloth, place, laid, foot)

    pieces: list[Piece] = []
    aside = np.abs(place[:, 0]) - MIDDLE
    outward = surface.normals(vertices, cloth.faces)
    shaped = vertices + _relief(make, shoe, place, aside)[:, None] * outward
    out = surface.normals(shaped, cloth.faces)
    for side in (1.0, -1.0):
        one = place[:, 0] * side > 0
        frame = Frame.fitted(place[one], laid[one])
        local = frame.local(vertices[one]), frame.local(laid[one])
        pieces.append(_sole(make, frame, *local, place[one]))
        instep = (one & (place[:, 2] > 0.0) & (place[:, 1] > -0.79))[cloth.faces].all(axis=1)
        faces = cloth.faces[instep]
        flat = np.stack([aside, place[:, 2]], axis=1)[faces]
        pieces += _laces(make, Chart(faces, flat, shaped, out, np.ones(2)), side)
    plain = Piece(shaped, cloth.faces, cloth.uv)
    return [surface.hemmed(plain, 0.003, rings=4, reach=0.02), *pieces]


@dataclass(frozen=True, eq=False)
class Frame:
    """A foot's own axes: left, up along the shin at rest, and ahead to the toes.

    Attributes:
        origin: (3,) under the middle of the foot.
        axes: (3, 3) its rows are the axes in the world.
    """

    origin: np.ndarray
    axes: np.ndarray

    @staticmethod
    def fitted(place: np.ndarray, last: np.ndarray) -> Frame:
        """Of a posed last (N, 3): up is square to its underside, ahead is its longest way.

        Source: Kabsch 1976, for the rigid motion from the template to the last.
        """
        low = place[:, 1] < FOOT - 0.03
        a, b = place[low], last[low]
        u, _, vt = np.linalg.svd(_moments(b, a))
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
        # Toes point outwards in the template too.
        x, z = np.linalg.eigh(_moments(a[:, [0, 2]], a[:, [0, 2]]))[1][:, 1]
        ahead = turn @ np.array([x, 0.0, z]) * np.sign(z)
        below = last[(place[:, 1] < GROUND + UNDERSIDE) & (place[:, 2] < BALL)]
        up = np.linalg.eigh(_moments(below, below))[1][:, 0]
        up = up * np.sign(up @ turn[:, 1])
        ahead = ahead - (ahead @ up) * up
        ahead /= np.linalg.norm(ahead)
        return Frame(b.mean(axis=0), np.stack([np.cross(up, ahead), up, ahead]))

    def local(self, points: np.ndarray) -> np.ndarray:
        """World (..., 3) to the foot's axes."""
        result: np.ndarray = (points - self.origin) @ self.axes.T
        return result

    def world(self, points: np.ndarray) -> np.ndarray:
        """The foot's axes (..., 3) to the world."""
        result: np.ndarray = points @ self.axes + self.origin
        return result


def _moments(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(D, D) second moments of (N, D) points, summed in one order whatever the threads."""
    result: np.ndarray = np.einsum("ni,nj->ij", a - a.mean(axis=0), b - b.mean(axis=0))
    return result


def _upper(cloth: Pattern, place: np.ndarray, last: np.ndarray, foot: Solid) -> np.ndarray:
    """(N, 3) the leather over the last: it bridges what the foot has of hollows and toes."""
    mean = surface.averaging(cloth.faces, len(last))
    vertices, gap = last, np.full(len(last), 0.003)
    for _ in range(3):
        for _ in range(SMOOTHING):
            vertices = 0.5 * vertices + 0.5 * (mean @ vertices)
        vertices = surface.pushed_out(vertices, place, gap, foot)
    for _ in range(2):
        vertices = 0.5 * vertices + 0.5 * (mean @ vertices)
    return vertices


def _relief(make: Make, shoe: float, place: np.ndarray, aside: np.ndarray) -> np.ndarray:
    """(N,) metres that cap, counter, the facings beside the tongue and the upper edge stand off."""
    _, y, z = place.T
    seam = 0.004
    cap = ramp(z + make.bow * aside**2 - make.toe, -seam, seam)
    counter = ramp(make.heel + 0.25 * (y + 0.76) - z, -seam, seam)
    high = np.maximum(cap, counter)
    if make.laced:
        along = ramp(z, make.laced[0] - 0.012, make.laced[0] - 0.004)
        along *= ramp(z, make.laced[1] + 0.010, make.laced[1] + 0.002)
        off = np.abs(aside)
        facing = ramp(off, TONGUE - 0.003, TONGUE + 0.002) * ramp(off, FACING + seam, FACING)
        high = np.maximum(high, 1.2 * along * facing)
    padded = ramp(shoe_field(shoe, place), -0.018, -0.006)
    return np.maximum(make.cap * high, make.padding * padded)


def _sole(
    make: Make, frame: Frame, upper: np.ndarray, last: np.ndarray, place: np.ndarray
) -> Piece:
    """A sole of the upper's outline, which bends with the toes and is flat otherwise.

    Args:
        upper, last: (N, 3) in the foot's axes.
    """
    low = upper[place[:, 1] < GROUND + SOLE_ZONE]
    middle = np.array([low[:, 0].mean(), 0.5 * (low[:, 2].min() + low[:, 2].max())])
    x, z = low[:, 0] - middle[0], (low[:, 2] - middle[1]) / SLENDER
    angle = np.linspace(-np.pi, np.pi, AROUND, endpoint=False)
    turn = np.arctan2(x, z)
    apart = np.abs(np.mod(turn[:, None] - angle + np.pi, 2 * np.pi) - np.pi)
    reach = np.where(apart < 0.09, np.hypot(x, z)[:, None], 0.0).max(axis=0)
    reach = gaussian_filter1d(reach, 2.0, mode="wrap")
    line = np.stack([reach * np.sin(angle), SLENDER * reach * np.cos(angle)], axis=1)
    along = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    away = np.stack([along[:, 1], -along[:, 0]], axis=1)
    away *= np.sign((away * line).sum(axis=1, keepdims=True))
    away /= np.linalg.norm(away, axis=1, keepdims=True)

    # The last's underside by station: level but for toes that bend.
    bottom = last[place[:, 1] < GROUND + UNDERSIDE]
    station = np.linspace(bottom[:, 2].min(), bottom[:, 2].max(), 12)
    under = np.array(
        [bottom[np.abs(bottom[:, 2] - s) < 0.02, 1].min(initial=np.inf) for s in station]
    )
    flat = float(np.median(under[np.isfinite(under)]))
    under = np.where(np.isfinite(under) & (np.abs(under - flat) > 0.006), under, flat)
    under = gaussian_filter1d(under, 1.0, mode="nearest")

    length = np.ptp(low[:, 2])
    rim, top, deep = make.rim, make.welt, -make.under
    profile = [
        (-0.006, top - 0.001),
        (0.4 * rim, top + 0.0005),
        (0.8 * rim, top),
        (rim, top - 0.0015),
        (0.9 * rim, 0.5 * (top + deep)),
        (1.1 * rim, deep + 0.004),
        (0.9 * rim, deep + 0.001),
        (0.3 * rim, deep),
    ]
    # Closed above too, inside the upper: no gap shows where that rounds in at the heel.
    rings = [share * line for share in (0.0, 0.6)]
    rings += [line + out * away for out, _ in profile]
    rings += [share * line for share in BELOW]
    levels = [top - 0.002] * 2 + [level for _, level in profile] + [deep] * len(BELOW)
    plan = np.stack(rings, axis=1) + middle
    high = np.broadcast_to(levels, plan.shape[:2]).copy()
    share = (plan[..., 1] - low[:, 2].min()) / length
    lowest = np.clip((top - high) / (top - deep), 0.0, 1.0)
    # Before the heel the sole is hollow; at the toes it rises.
    hollow = make.arch * ramp(share, 0.23, 0.31) * ramp(share, 0.56, 0.42)
    spring = 0.004 * ramp(share, 0.88, 1.05)
    high += lowest * (hollow + spring)
    high += np.interp(plan[..., 1], station, under)
    points = frame.world(np.stack([plan[..., 0], high, plan[..., 1]], axis=-1))
    # A foot that stands treads its sole level.
    up = frame.axes[1]
    stands = ramp(up[1:2], *np.cos(np.radians([TILTED, LEVEL])))
    tilt = ((points - points.mean(axis=(0, 1)))[..., [0, 2]] @ up[[0, 2]]) / up[1]
    points[..., 1] += stands * lowest * tilt
    u = np.linspace(0, 1, AROUND + 1)
    v = np.concatenate([[1.0, 1.0], np.linspace(1.0, 0.35, len(profile)), 0.3 * np.array(BELOW)])
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    return lattice.woven(points[::-1], "sole", uv[::-1], round_about=True)


def _laces(make: Make, instep: Chart, side: float) -> list[Piece]:
    """Rows of laces over the tongue.

    Args:
        instep: its chart has metres outwards from the foot's middle line, and ahead.
        side: 1 for the left foot.
    """
    if make.laced is None:
        return []
    first, last = make.laced
    turn = np.linspace(-0.15, 1.15, 7) * np.pi
    width, high = 0.5 * LACE_WIDTH * np.cos(turn), 0.0006 + 0.0018 * np.sin(turn)
    share = np.linspace(-LACED, LACED, 13)
    height = np.repeat(high[None], len(share), axis=0)
    height[[0, -1]] = -0.0015
    pieces = []
    for row in np.arange(np.ceil(first / LACE_PITCH - 0.5), np.floor(last / LACE_PITCH - 0.5) + 1):
        ahead = (row + 0.5) * LACE_PITCH - LACE_SLANT * share
        points = np.stack(np.broadcast_arrays(share[:, None], ahead[:, None] + width), axis=-1)
        if not instep.holds(points).all():
            continue
        lace = instep.laid(points, height, calm=4)
        pieces.append(lattice.woven(lace if side > 0 else lace[:, ::-1], "lace"))
    return pieces
