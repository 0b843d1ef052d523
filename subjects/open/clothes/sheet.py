"""A garment before cloth falls: its cut, its ease, and what holds it up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from subjects.open.base import surface
from subjects.open.base.atlas import OUTER
from subjects.open.base.ramp import ramp
from subjects.open.base.subdivision import loop
from subjects.open.base.surface import Pattern, Solid
from subjects.open.base.template import SKIRT, TIGHTS, template
from subjects.open.clothes.garments import (
    DRESS_SEAM,
    arm_length,
    arm_share,
    bottom_field,
    dress_skirt_field,
    neckline_field,
    pattern,
    refined,
    top_field,
    waist_height,
)
from subjects.open.clothes.outfit import Bottom, Outfit, Top
from subjects.open.clothes.worn import Worn

CALM = 40
"""Averaging steps after which a cloth's normals are those of its limb, not of its hollows."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A garment as it is cut, before it lies on a body.

    Attributes:
        garment: what it is.
        cloth: the pattern.
        place: (N, 3) template coordinates.
        arm: (N,) how much each vertex follows an arm.
        gap: (N,) metres it keeps from what is under it.
        folds: (N,) metres of painted folds, where no solver makes real ones.
        rounds, smoothing: how it is spanned over a solid.
        pin: (N,) 0 where it hangs free to 1 where a waistband or collar holds it.
    """

    garment: Top | Bottom
    cloth: Pattern
    place: np.ndarray
    arm: np.ndarray
    gap: np.ndarray
    folds: np.ndarray
    rounds: int
    smoothing: int
    pin: np.ndarray

    @cached_property
    def mean(self) -> sparse.csr_matrix:
        """See `surface.averaging`."""
        return surface.averaging(self.cloth.faces, len(self.place))

    def finer(self) -> tuple[Sheet, sparse.csr_matrix]:
        """The sheet with each triangle as four, and the matrix that its vertices come from."""
        up, faces, uv = loop(self.cloth.faces, self.cloth.uv)
        cloth = Pattern((up @ self.cloth.matrix).tocsr(), faces, uv)
        values = {
            name: up @ getattr(self, name) for name in ("place", "arm", "gap", "folds", "pin")
        }
        return replace(self, cloth=cloth, smoothing=4 * self.smoothing, **values), up

    def laid(self, posed: np.ndarray, solid: Solid, more: float = 0.0) -> np.ndarray:
        """(N, 3) spanned over a solid like cloth that does not hug hollows, without folds.

        Args:
            posed: (19158, 3) posed base mesh.
            more: metres by which it lies further out than it need.
        """
        gap = self.gap + more
        vertices = origin = self.carried(posed, more)
        faces = self.cloth.faces
        for _ in range(self.rounds):
            vertices = surface.evened(vertices, faces, self.mean, origin, self.smoothing)
            vertices = surface.pushed_out(vertices, self.place, gap, solid)
        # Pushing out leaves small steps: even them out once more.
        vertices = surface.evened(vertices, faces, self.mean, origin, 3)
        return surface.pushed_out(vertices, self.place, np.minimum(gap, 0.004), solid)

    def folded(self, vertices: np.ndarray, solid: Solid) -> np.ndarray:
        """`vertices` with the painted folds, where no solver makes real ones."""
        outward = surface.normals(vertices, self.cloth.faces)
        vertices = vertices + self.folds[:, None] * outward
        return surface.pushed_out(vertices, self.place, np.minimum(self.gap, 0.004), solid)

    def carried(self, shape: np.ndarray, more: float = 0.0) -> np.ndarray:
        """(N, 3) where the skin below carries the cloth as the body takes `shape`.

        It stands off the way that the skin faces by and large: off each side of a hollow it would
        meet itself. A top spans the hollow of the seat from the first.
        """
        vertices: np.ndarray = self.cloth.matrix @ shape
        calm = vertices
        for _ in range(CALM):
            calm = 0.5 * calm + 0.5 * (self.mean @ calm)
        outward = surface.normals(calm, self.cloth.faces)
        if isinstance(self.garment, Top):
            x, y, z = self.place.T
            seat = ramp(np.abs(x), 0.09, 0.05) * ramp(y, 0.14, 0.08) * ramp(z, 0.01, -0.02)
            vertices = vertices + seat[:, None] * (calm - vertices)
        return vertices + (self.gap + more)[:, None] * outward

    def worn(self, vertices: np.ndarray) -> Worn:
        """The garment where its cloth lies."""
        return Worn(self.garment, self.cloth, self.place, self.arm, vertices)


def sheets(outfit: Outfit, generator: np.random.Generator) -> list[Sheet]:
    """The outfit's garments from the innermost outwards."""
    upper = (_dress if outfit.top.kind == "dress" else _top)(outfit, outfit.top, generator)
    result = [upper]
    if outfit.bottom is not None:
        make = _skirt if outfit.bottom.kind == "skirt" else _trousers
        lower = make(outfit.bottom, generator)
        result = [upper, lower] if outfit.top.tucked else [lower, upper]
    if outfit.outer is not None:
        result.append(_top(outfit, outfit.outer, generator))
    return result


def _top(outfit: Outfit, top: Top, generator: np.random.Generator) -> Sheet:
    """Shirt, jersey or jacket; untucked it goes over the waistband."""
    group = TIGHTS if top is outfit.top else OUTER
    _, place, arm = refined(group)
    cloth = pattern(group, top_field(outfit, top, place, arm))
    place, arm = cloth.matrix @ template().vertices, arm_share(cloth.matrix)
    ease = 0.25 * top.ease if top.tucked else top.ease
    trunk = 0.005 + ease * ramp(place[:, 1], 0.40, 0.10)
    sleeve = 0.005 + (0.5 * ease + 0.004) * ramp(arm_length(place) / top.sleeve, 0.2, 1.0)
    gap = trunk + (sleeve - trunk) * ramp(arm, 0.2, 0.8)
    neck = neckline_field(place, top.neckline)
    pin = np.where(arm > 0.5, 0.0, ramp(neck, -0.03, -0.01))
    if top.tucked and outfit.bottom is not None:
        # What is tucked in is held by the waistband over it.
        under = place[:, 1] - waist_height(outfit.bottom, place)
        pin = np.maximum(pin, ramp(under, 0.01, -0.01))
    return Sheet(
        garment=top,
        cloth=cloth,
        place=place,
        arm=arm,
        gap=gap,
        folds=_fold_field(generator, place, 80, 0.0045) * ramp(neck, -0.02, -0.08),
        rounds=5,
        # A loose top hangs straight from the chest; a tucked one follows the waist.
        smoothing=2 if top.tucked else 6,
        pin=pin,
    )


def _trousers(bottom: Bottom, generator: np.random.Generator) -> Sheet:
    """Trousers or shorts of any length and width."""
    _, place, arm = refined(TIGHTS)
    cloth = pattern(TIGHTS, bottom_field(bottom, place, arm))
    place = cloth.matrix @ template().vertices
    calm = ramp(place[:, 1], bottom.waist, 0.03)
    return Sheet(
        garment=bottom,
        cloth=cloth,
        place=place,
        arm=arm_share(cloth.matrix),
        gap=0.005 + bottom.ease * ramp(place[:, 1], 0.05, min(bottom.cuff, -0.30)),
        folds=_fold_field(generator, place, 70, 0.005) * calm,
        rounds=4,
        smoothing=2,
        pin=_waistband(bottom, place),
    )


def _skirt(bottom: Bottom, generator: np.random.Generator) -> Sheet:
    """A skirt from the skirt helper; folds run downwards and open towards the hem."""
    _, place, arm = refined(SKIRT)
    cloth = pattern(SKIRT, bottom_field(bottom, place, arm))
    place = cloth.matrix @ template().vertices
    down = ramp(place[:, 1], bottom.waist - 0.02, bottom.cuff)
    return Sheet(
        garment=bottom,
        cloth=cloth,
        place=place,
        arm=np.zeros(len(place)),
        gap=0.005 + bottom.ease * down,
        folds=_flutes(generator, place, down),
        rounds=5,
        smoothing=4,
        pin=_waistband(bottom, place),
    )


def _dress(outfit: Outfit, top: Top, generator: np.random.Generator) -> Sheet:
    """A dress: a top's bodice sewn to a skirt at the waist, one cloth."""
    bodice = _top(outfit, top, generator)
    _, place, _ = refined(SKIRT)
    skirt = pattern(SKIRT, dress_skirt_field(top, place))
    below = skirt.matrix @ template().vertices
    rims = []
    for cloth, at in ((bodice.cloth, bodice.place), (skirt, below)):
        # From the middle of the back, so that both begin at the same side.
        seam = np.where(np.abs(at[:, 1] - DRESS_SEAM) < 0.02, at[:, 2] + np.abs(at[:, 0]), 1.0)
        rims.append(_rim_from(cloth, at, seam))
    whole = surface.sewn(bodice.cloth, skirt, (rims[0], rims[1]))
    place = whole.matrix @ template().vertices
    n = len(bodice.place)
    down = ramp(place[:, 1], DRESS_SEAM + 0.02, top.hem)
    gap = np.concatenate([bodice.gap, np.zeros(len(below))])
    gap = np.where(np.arange(len(gap)) < n, np.minimum(gap, 0.012), 0.005 + 0.8 * top.ease * down)
    return replace(
        bodice,
        cloth=whole,
        place=place,
        arm=np.concatenate([bodice.arm, np.zeros(len(below))]),
        gap=gap,
        folds=np.concatenate([bodice.folds, _flutes(generator, below, down[n:])]),
        smoothing=3,
        pin=np.concatenate([bodice.pin, np.zeros(len(below))]),
    )


def _rim_from(cloth: Pattern, place: np.ndarray, seam: np.ndarray) -> np.ndarray:
    """The rim at the waist from its hindmost vertex, counter-clockwise seen from above."""
    border = np.flatnonzero(surface.on_border(cloth.faces))
    start = int(border[seam[border].argmin()])
    loop_ = surface.rim(cloth.faces, start)
    around = place[loop_][:, [2, 0]]
    z, x = around.T
    area = float((z * np.roll(x, -1) - x * np.roll(z, -1)).sum())
    return loop_ if area > 0 else np.roll(loop_[::-1], 1)


def _waistband(bottom: Bottom, place: np.ndarray) -> np.ndarray:
    """(N,) 1 in the band that holds trousers or a skirt, softly 0 below."""
    return ramp(waist_height(bottom, place) - place[:, 1], 0.04, 0.015)


def _flutes(generator: np.random.Generator, place: np.ndarray, down: np.ndarray) -> np.ndarray:
    """(N,) metres: folds that run down a skirt and open towards its hem."""
    around = np.arctan2(place[:, 0], place[:, 2])
    waves = sum(
        generator.uniform(0.3, 1.0) * np.cos(k * around + generator.uniform(0, 2 * np.pi))
        for k in (3, 5, 7, 9, 11)
    )
    return 0.007 * waves * down


def _fold_field(
    generator: np.random.Generator, place: np.ndarray, count: int, height: float
) -> np.ndarray:
    """(N,) metres: ridges and valleys, most of them near joints and across the limb."""
    joints = template().joints
    names = ("elbow", "shoulder", "knee", "upper-leg")
    creases = np.array([joints[f"{side}-{name}"] for side in "lr" for name in names])
    result = np.zeros(len(place))
    for _ in range(count):
        centre = place[generator.integers(len(place))]
        if generator.random() < 0.5:
            near = creases[generator.integers(len(creases))]
            centre = near + generator.normal(0, 0.045, 3)
        across = generator.normal(0, 1, 3) * (0.45, 1.0, 0.45)
        across /= np.linalg.norm(across)
        length = generator.uniform(0.022, 0.05)
        offset = place - centre
        along = offset @ across
        aside = (offset * offset).sum(axis=1) - along**2
        envelope = np.exp(-((along / (0.7 * length)) ** 2) - aside / (2 * (2.2 * length) ** 2))
        result += generator.uniform(-1, 1) * np.cos(2 * np.pi * along / length) * envelope
    return height * np.tanh(result)
