"""Shoes: flat soles under the foot, uppers around it, and three kinds that differ."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

import seeds
from subjects.open.base import surface
from subjects.open.base.atlas import CELLS, chart
from subjects.open.base.subdivision import refine, triangles
from subjects.open.base.surface import Piece, Solid
from subjects.open.base.template import BODY, template
from subjects.open.bodies import body
from subjects.open.bodies.poses import POSES
from subjects.open.bodies.skeleton import rotations
from subjects.open.clothes.shoes import MAKES, shoe_field, shoe_last, shoes

SEED = 5
HEIGHT = {"sneakers": -0.752, "leather": -0.752, "boots": -0.63}


@lru_cache(maxsize=2)
def posed(pose: str) -> tuple[np.ndarray, Solid]:
    """The base mesh with lasts, and the bare body."""
    _, phenotype = body.draw_phenotype(seeds.generator(SEED, "shoes", "phenotype"), 25, 45)
    rest = body.rest_body(phenotype)
    transforms = body.bone_transforms(rest, rotations(POSES[pose], rest))
    mesh = template().groups[BODY]
    fine = refine(mesh.quads, chart(BODY), len(template().vertices), 1)
    at, faces = fine.matrix @ body.skin(rest.vertices, transforms), triangles(fine.quads)
    foot = Solid(at, surface.normals(at, faces), fine.matrix @ template().vertices)
    return body.skin(shoe_last(rest.vertices), transforms), foot


@lru_cache(maxsize=6)
def pair(footwear: str, pose: str = "stand") -> list[Piece]:
    return shoes(footwear, HEIGHT[footwear], *posed(pose))


def within(piece: Piece, name: str) -> bool:
    u0, v0, u1, v1 = CELLS[name]
    return bool(((piece.uv >= (u0, v0)) & (piece.uv <= (u1, v1))).all())


def soles(footwear: str, pose: str = "stand") -> list[Piece]:
    return [p for p in pair(footwear, pose) if within(p, "sole")]


def volume(piece: Piece) -> float:
    corner = piece.vertices[piece.faces] - piece.vertices.mean(axis=0)
    return float(np.linalg.det(corner).sum()) / 6.0


@pytest.mark.parametrize("footwear", MAKES)
def test_soles_are_flat_closed_and_below_the_foot(footwear: str) -> None:
    _, foot = posed("stand")
    both = soles(footwear)
    assert len(both) == 2
    for sole, side in zip(both, (1.0, -1.0), strict=True):
        own = foot.vertices[foot.place[:, 0] * side > 0]
        lowest = sole.vertices[:, 1].min()
        assert 0.014 < own[:, 1].min() - lowest < 0.035
        # Heel and ball stand on one plane, over most of the sole's length.
        floor = sole.vertices[sole.vertices[:, 1] < lowest + 0.0015]
        length = np.ptp(sole.vertices[:, 2])
        assert np.ptp(floor[:, 2]) > 0.75 * length
        assert 0.22 < length < 0.36
        assert 0.00015 < volume(sole) < 0.0012
        edges = np.concatenate(
            [sole.faces[:, [0, 1]], sole.faces[:, [1, 2]], sole.faces[:, [2, 0]]]
        )
        one_way = {tuple(e) for e in edges.tolist() if e[0] != e[1]}
        back = {(b, a) for a, b in one_way}
        open_edges = np.array(sorted(one_way - back)).reshape(-1, 2)
        # Only the two middles, where a ring shrinks to a point, are not welded.
        at = sole.vertices[open_edges]
        assert np.linalg.norm(at[:, 0] - at[:, 1], axis=1).max(initial=0.0) < 1e-9


def test_soles_stand_out_from_the_upper() -> None:
    for footwear, make in MAKES.items():
        upper = pair(footwear)[0]
        for sole in soles(footwear):
            level = np.median(sole.vertices[:, 1])
            near = np.abs(upper.vertices - sole.vertices.mean(axis=0)).max(axis=1) < 0.2
            ring = upper.vertices[near & (np.abs(upper.vertices[:, 1] - level) < 0.012)]
            for axis in (0, 2):
                assert sole.vertices[:, axis].max() > ring[:, axis].max() + 0.3 * make.rim
                assert sole.vertices[:, axis].min() < ring[:, axis].min() - 0.3 * make.rim


@pytest.mark.parametrize("pose", ["stand", "jog"])
@pytest.mark.parametrize("footwear", MAKES)
def test_the_foot_stays_in_the_shoe(footwear: str, pose: str) -> None:
    last, foot = posed(pose)
    upper = shoes(footwear, HEIGHT[footwear], last, foot)[0]
    outward = surface.normals(upper.vertices, upper.faces)
    inside = shoe_field(HEIGHT[footwear], foot.place) < -0.02
    skin = foot.vertices[inside & (foot.place[:, 1] < -0.6)][::5]
    # The hem's inner layer faces inwards: only what looks outwards counts.
    count = np.unique(upper.faces).max() + 1
    apart = ((skin[:, None] - upper.vertices[None, :count]) ** 2).sum(axis=2)
    near = apart.argmin(axis=1)
    above = ((skin - upper.vertices[near]) * outward[near]).sum(axis=1)
    assert np.quantile(above, 0.99) < 0.0015


def test_soles_turn_with_the_foot() -> None:
    flat, raised = soles("sneakers", "stand"), soles("sneakers", "jog")
    tilt = [np.ptp(s.vertices[:, 1]) for s in raised]
    assert max(tilt) > 2 * max(np.ptp(s.vertices[:, 1]) for s in flat)
    for one, other in zip(flat, raised, strict=True):
        assert volume(one) == pytest.approx(volume(other), rel=0.1)


def test_kinds_differ() -> None:
    laces = {name: sum(within(p, "lace") for p in pair(name)) for name in MAKES}
    assert laces["sneakers"] > laces["leather"] > laces["boots"] == 0
    tops = {name: pair(name)[0].vertices[:, 1].max() for name in MAKES}
    assert tops["boots"] > tops["sneakers"] + 0.06
    hollow = {}
    for name in MAKES:
        sole = soles(name)[0]
        z = sole.vertices[:, 2]
        share = (z - z.min()) / np.ptp(z)
        arch = sole.vertices[(share > 0.32) & (share < 0.40), 1].min()
        hollow[name] = arch - sole.vertices[:, 1].min()
    assert hollow["sneakers"] < 0.002
    assert hollow["leather"] > 0.006
    with pytest.raises(KeyError):
        shoes("clogs", -0.75, *posed("stand"))


def test_laces_lie_on_the_instep_and_face_out() -> None:
    upper = pair("sneakers")[0]
    for lace in (p for p in pair("sneakers") if within(p, "lace")):
        corner = lace.vertices[lace.faces]
        area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(axis=0)
        assert area[1] > 0
        middle = lace.vertices.mean(axis=0)
        assert np.linalg.norm(upper.vertices - middle, axis=1).min() < 0.012
        assert 0.03 < np.ptp(lace.vertices[:, 0]) < 0.06


def test_the_same_foot_has_the_same_shoes() -> None:
    again = shoes("leather", HEIGHT["leather"], *posed("stand"))
    for a, b in zip(pair("leather"), again, strict=True):
        assert a.vertices.tobytes() == b.vertices.tobytes()
        assert a.uv.tobytes() == b.uv.tobytes()
