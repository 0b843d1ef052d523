"""The whole figure as one surface: skin, clothes with their trims, shoes, eyes, hair."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from subjects.open import trims
from subjects.open.base import surface
from subjects.open.base.atlas import chart
from subjects.open.base.measure import fold_angles
from subjects.open.base.subdivision import Refinement, refine, triangles
from subjects.open.base.surface import Piece, Solid
from subjects.open.base.template import BODY, EYES, bare_body, template
from subjects.open.bodies import body
from subjects.open.bodies.posed import Posed
from subjects.open.clothes.dressing import bare_solid, dress, hidden
from subjects.open.clothes.garments import arm_share, lapped
from subjects.open.clothes.outfit import Outfit, Top
from subjects.open.clothes.shoes import shoe_field, shoe_last, shoes
from subjects.open.clothes.worn import Worn
from subjects.open.hair import style as hair
from subjects.open.hair.head import Head
from subjects.open.texture import Look

NECK, CHIN = 0.60, 0.62
"""Template heights above which hair lies on the skin, and grows."""
IN_SHOE = 0.012
"""Metres under a shoe's rim from which the foot is not seen."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A dressed human.

    Attributes:
        surface: everything to be seen, its lowest point at y = 0.
        ground: metres that it was lowered by.
        garments: what became of each garment, JSON-ready, from the innermost outwards.
    """

    surface: Piece
    ground: float
    garments: list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Skin:
    """The bare body, refined once.

    Attributes:
        fine: its refinement; corners are atlas coordinates, then the base mesh's own.
        faces: (F, 3) int.
        solid: its vertices, normals and template coordinates.
        arm: (N,) how much each vertex follows an arm.
    """

    fine: Refinement
    faces: np.ndarray
    solid: Solid
    arm: np.ndarray


def figure(
    posed: Posed,
    shapes: np.ndarray,
    outfit: Outfit,
    look: Look,
    generator: np.random.Generator,
    scratch: Path,
) -> Figure:
    """Dress a posed body.

    Args:
        shapes: (K, 19158, 3) see `dressing.dress`; the last is the posed body.
        scratch: a folder for the solver.

    Raises:
        DrapeError, SolverError: see `dressing.dress`.
    """
    skin = _skin(posed.vertices)
    clothes, reports = dress(outfit, shapes, skin.fine, skin.solid, generator, scratch)
    haired, scalp = _haired(skin, look, generator)
    last = body.skin(shoe_last(posed.rest.vertices), posed.transforms)
    pieces = {"shoes": surface.joined(shoes(outfit.footwear, outfit.shoe, last, skin.solid))}
    above: list[Piece] = []
    for k, worn in enumerate(clothes):
        under = hidden(outfit, worn.place, worn.arm, worn.vertices, clothes[k + 1 :])
        is_top = isinstance(worn.garment, Top)
        trimmed = trims.of_top(worn, outfit, haired) if is_top else trims.of_bottom(worn)
        parts = {worn.garment.kind: worn.hemmed(under)}
        if trimmed:
            parts[f"trims of the {worn.garment.kind}"] = surface.joined(trimmed)
        pieces |= parts
        if is_top:
            above += parts.values()
    pieces["skin"] = _shown(skin, haired.vertices, outfit, clothes)
    pieces["eyes"] = surface.joined([_eye(eye, posed.vertices) for eye in EYES])
    locks = hair.styled(
        look.hair_style, look.headwear, Head(scalp, _under_hair(haired, above)), generator
    )
    if locks:
        pieces["hair"] = surface.joined(locks)

    used, bare = bare_body()
    folds = fold_angles(pieces, posed.vertices[used], bare)
    for report in reports:
        fold = folds.get(report["garment"])
        report["fold_deg"] = round(fold.angle_deg, 2) if fold else None
        report["fold_pixels"] = fold.pixels if fold else 0
    whole = surface.compact(surface.joined(list(pieces.values())))
    ground = float(whole.vertices[:, 1].min())
    return Figure(
        Piece(whole.vertices - [0.0, ground, 0.0], whole.faces, whole.uv), ground, reports
    )


def _skin(vertices: np.ndarray) -> Skin:
    mesh = template().groups[BODY]
    corners = np.concatenate([chart(BODY), mesh.uv], axis=2)
    fine = refine(mesh.quads, corners, len(template().vertices), 1)
    return Skin(fine, triangles(fine.quads), bare_solid(fine, vertices), arm_share(fine.matrix))


def _haired(skin: Skin, look: Look, generator: np.random.Generator) -> tuple[Solid, Solid]:
    """The skin with its scalp raised, and the scalp alone."""
    place = skin.solid.place
    own = np.zeros((len(place), 2))
    own[skin.fine.quads.ravel()] = skin.fine.corners[..., 2:].reshape(-1, 2)
    grown = np.where(place[:, 1] > CHIN, hair.growth(place, own), -1.0)
    rough = generator.uniform(-1, 1, len(place))
    mean = surface.averaging(skin.faces, len(place))
    for _ in range(3):
        rough = mean @ rough
    rough /= np.abs(rough).max()
    raised = hair.raised(
        skin.solid.vertices, skin.solid.normals, grown, look.hair_style, look.headwear, rough
    )
    normals = surface.normals(raised, skin.faces)
    on = grown > 0.004
    return Solid(raised, normals, place), Solid(raised[on], normals[on], place[on])


def _shown(skin: Skin, haired: np.ndarray, outfit: Outfit, clothes: list[Worn]) -> Piece:
    """The skin that is not under clothes for good."""
    place = skin.solid.place
    under = hidden(outfit, place, skin.arm, skin.solid.vertices, clothes)
    under |= lapped(outfit, place, skin.arm)
    under |= shoe_field(outfit.shoe, place) < -IN_SHOE
    seen = ~under[skin.faces].all(axis=1)
    uv = triangles(skin.fine.corners)[..., :2]
    return Piece(haired, skin.faces[seen], uv[seen])


def _eye(name: str, vertices: np.ndarray) -> Piece:
    ball = template().groups[name]
    fine = refine(ball.quads, chart(name), len(template().vertices), 1)
    return Piece(fine.matrix @ vertices, triangles(fine.quads), triangles(fine.corners))


def _under_hair(skin: Solid, clothes: list[Piece]) -> Solid:
    """What hair lies on, by nearness in space alone: head, collars and shoulders."""
    head = skin.place[:, 1] > NECK
    vertices = [skin.vertices[head], *(piece.vertices for piece in clothes)]
    normals = [skin.normals[head], *(surface.normals(p.vertices, p.faces) for p in clothes)]
    count = sum(map(len, vertices))
    return Solid(np.concatenate(vertices), np.concatenate(normals), np.zeros((count, 3)))
