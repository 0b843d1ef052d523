"""Trims: relief where real clothes have it, of real size, closed, outside, in their own cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from trimesh.ray.ray_pyembree import RayMeshIntersector

import seeds
from subjects.open import trims
from subjects.open.base import surface
from subjects.open.base.atlas import CELLS, chart
from subjects.open.base.subdivision import refine, triangles
from subjects.open.base.surface import Piece, Solid
from subjects.open.base.template import BODY, template
from subjects.open.bodies import body
from subjects.open.bodies.poses import POSES
from subjects.open.bodies.skeleton import rotations
from subjects.open.clothes.outfit import Bottom, Material, Outfit, Top, draw_outfit
from subjects.open.clothes.sheet import sheets
from subjects.open.clothes.worn import Worn
from subjects.open.trims import buttons, collar
from subjects.open.trims.chart import around_neck, calmed, sided

SEED = 5
COTTON = Material("cotton", 0.18, 20.0, 0.1, 0.01, 0.0026)
PLAIN = Top("tee", 0.5, "crew", -0.02, 0.014, False, 0.0, "nothing", "nothing", COTTON)
JEANS = Bottom("trousers", 0.12, -0.72, 0.02, False, True, COTTON)
SHIRT = replace(PLAIN, kind="shirt", neckline="shirt", front="buttons", sleeve=1.8)
HOODIE = replace(PLAIN, kind="hoodie", back="hood", front="zip", sleeve=1.8, ease=0.026)
JACKET = replace(SHIRT, kind="jacket", opening=0.06, ease=0.026)


def wear(top: Top, bottom: Bottom | None = JEANS, outer: Top | None = None) -> Outfit:
    return Outfit(top=top, bottom=bottom, outer=outer, footwear="sneakers", shoe=-0.752)


OUTFITS = {
    "shirt": wear(replace(SHIRT, tucked=True), replace(JEANS, belt=True)),
    "tee": wear(replace(PLAIN, front="pocket")),
    "vee": wear(replace(PLAIN, neckline="vee")),
    "scoop": wear(replace(PLAIN, kind="dress", neckline="scoop", front="buttons", hem=-0.4), None),
    "hoodie": wear(HOODIE),
    "pouch": wear(replace(HOODIE, front="pocket")),
    "jacket": wear(SHIRT, outer=JACKET),
    "zipped": wear(PLAIN, outer=replace(JACKET, front="zip")),
}


@dataclass(frozen=True, eq=False)
class Clothed:
    """Garments on a body, and their trims by garment."""

    outfit: Outfit
    around: Solid
    worn: list[Worn]
    trims: list[list[Piece]]


@lru_cache(maxsize=1)
def standing() -> tuple[np.ndarray, Solid]:
    _, phenotype = body.draw_phenotype(seeds.generator(SEED, "trims", "phenotype"), 25, 45)
    rest = body.rest_body(phenotype)
    posed = body.skin(rest.vertices, body.bone_transforms(rest, rotations(POSES["stand"], rest)))
    mesh = template().groups[BODY]
    fine = refine(mesh.quads, chart(BODY), len(template().vertices), 1)
    at, faces = fine.matrix @ posed, triangles(fine.quads)
    return posed, Solid(at, surface.normals(at, faces), fine.matrix @ template().vertices)


@lru_cache(maxsize=len(OUTFITS))
def clothed(name: str) -> Clothed:
    outfit = OUTFITS[name]
    posed, bare = standing()
    solid, worn = bare, []
    for coarse in sheets(outfit, seeds.generator(SEED, name, "cloth")):
        sheet, _ = coarse.finer()
        lying = sheet.worn(sheet.folded(sheet.laid(posed, solid), solid))
        worn.append(lying)
        solid = surface.both(solid, Solid(lying.vertices, lying.normals, lying.place))
    return Clothed(outfit, bare, worn, [trimmed(w, outfit, bare) for w in worn])


def trimmed(worn: Worn, outfit: Outfit, around: Solid) -> list[Piece]:
    if isinstance(worn.garment, Top):
        return trims.of_top(worn, outfit, around)
    return trims.of_bottom(worn)


def of_kind(name: str, kind: str) -> tuple[Worn, list[Piece]]:
    made = clothed(name)
    k = [w.garment.kind for w in made.worn].index(kind)
    return made.worn[k], made.trims[k]


def cells(piece: Piece) -> set[str]:
    """The atlas cells that hold all corners of at least one of the piece's triangles."""
    found = set()
    inside = np.zeros(len(piece.uv), dtype=bool)
    for name, (u0, v0, u1, v1) in CELLS.items():
        within = ((piece.uv >= (u0, v0)) & (piece.uv <= (u1, v1))).all(axis=(1, 2))
        if within.any():
            found.add(name)
        inside |= within
    assert inside.all()
    return found


def only(pieces: list[Piece], cell: str) -> list[Piece]:
    return [p for p in pieces if cells(p) == {cell}]


def height(pieces: list[Piece], at: np.ndarray, side: float) -> np.ndarray:
    """(N,) z (front, side 1) or -z (back) of what is first seen at x, y of `at` (N, 3)."""
    whole = surface.joined(pieces)
    caster = RayMeshIntersector(trimesh.Trimesh(whole.vertices, whole.faces, process=False))
    origins = np.stack([at[:, 0], at[:, 1], np.full(len(at), 5.0 * side)], axis=1)
    direction = np.tile([0.0, 0.0, -side], (len(at), 1))
    where, ray, _ = caster.intersects_location(origins, direction, multiple_hits=False)
    result = np.full(len(at), np.nan)
    result[ray] = where[:, 2] * side
    return result


def relief(name: str, at: np.ndarray, side: float) -> np.ndarray:
    """(N,) metres that trims stand off the clothes in the line of sight."""
    made = clothed(name)
    plain = [Piece(w.vertices, w.cloth.faces, w.cloth.uv) for w in made.worn]
    all_trims = [piece for group in made.trims for piece in group]
    return height(plain + all_trims, at, side) - height(plain, at, side)


def border(faces: np.ndarray) -> np.ndarray:
    """(E, 2) edges of one triangle only."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    once, count = np.unique(edges, axis=0, return_counts=True)
    return once[count == 1]


def welded(piece: Piece) -> np.ndarray:
    """(F, 3) faces with vertices of one position as one."""
    _, same = np.unique(np.round(piece.vertices, 9), axis=0, return_inverse=True)
    return same.ravel()[piece.faces]


def test_a_named_place_is_found_on_the_cloth() -> None:
    worn, _ = of_kind("tee", "tee")
    front = sided(worn, calmed(worn), 1.0)
    named = np.unique(front.faces)[::37]
    where, out = front.at(worn.place[named, :2])
    assert np.allclose(where, worn.vertices[named], atol=1e-9)
    assert np.allclose(np.linalg.norm(out, axis=1), 1.0)
    assert (out[:, 2] > 0).mean() > 0.95
    # Off the cloth, its border: the neck's hollow is taken to the neckline.
    assert not front.holds(np.array([[0.0, 0.60]]))[0]
    off, _ = front.at(np.array([[0.0, 0.60]]))
    edge = worn.vertices[np.unique(border(worn.cloth.faces))]
    assert np.linalg.norm(edge - off, axis=1).min() < 0.01


def test_buttons_are_relief_on_the_front_and_nothing_on_the_back() -> None:
    _, pieces = of_kind("shirt", "shirt")
    discs = only(pieces, "button")
    assert 4 <= len(discs) <= 8
    centres = np.array([d.vertices.mean(axis=0) for d in discs])
    front, back = relief("shirt", centres, 1.0), relief("shirt", centres, -1.0)
    assert front.min() > 0.0025  # disc on placket
    assert front.max() < 0.009
    assert np.array_equal(back, np.zeros(len(centres)))
    # The placket between two buttons stands off too, and less.
    between = relief("shirt", 0.5 * (centres[1:] + centres[:-1]), 1.0)
    assert between.min() > 0.001
    assert np.median(between) < np.median(front) - 0.001


def test_buttons_are_of_real_size_on_every_body() -> None:
    for diameter in (0.011, 0.018):
        disc = buttons.button(np.zeros(3), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), diameter)
        wide = np.ptp(disc.vertices, axis=0)
        assert wide[:2] == pytest.approx([diameter, diameter], rel=0.03)
        assert disc.vertices[:, 2].max() == pytest.approx(0.0025)
    for kind, name, diameter in (("shirt", "shirt", 0.011), ("jacket", "jacket", 0.018)):
        _, pieces = of_kind(name, kind)
        for disc in only(pieces, "button"):
            apart = np.linalg.norm(disc.vertices[:, None] - disc.vertices[None], axis=2)
            assert apart.max() == pytest.approx(diameter, abs=0.001)


def test_a_hood_lies_on_the_back_alone() -> None:
    worn, pieces = of_kind("hoodie", "hoodie")
    (hood,) = only(pieces, "hood")
    spot = np.abs(worn.place - [0.0, 0.46, -0.1]).max(axis=1).argmin()
    at = worn.vertices[[spot]]
    assert 0.02 < relief("hoodie", at, -1.0)[0] < 0.08
    chest = worn.vertices[[np.abs(worn.place - [0.06, 0.42, 0.1]).max(axis=1).argmin()]]
    assert relief("hoodie", chest, 1.0)[0] == 0.0
    # It is below the head and keeps out of the neck.
    _, bare = standing()
    lowest_chin = bare.vertices[bare.place[:, 1] > 0.72, 1].min()
    assert hood.vertices[:, 1].max() < lowest_chin + 0.02
    _, near = cKDTree(bare.vertices).query(hood.vertices, k=3)
    height = ((hood.vertices[:, None] - bare.vertices[near]) * bare.normals[near]).sum(axis=2)
    assert np.quantile(-height.min(axis=1), 0.98) < 0.004


@pytest.mark.parametrize("name", ["tee", "vee", "scoop"])
def test_a_neckband_follows_the_neckline(name: str) -> None:
    made = clothed(name)
    worn = next(w for w in made.worn if isinstance(w.garment, Top))
    neck = around_neck(worn, calmed(worn))
    band = collar.neckband(neck, "collar")
    # All of the neckline is under the band, and the band is no wider than it should be.
    rim = np.unique(border(worn.cloth.faces))
    rim = rim[(worn.place[rim, 1] > 0.35) & (worn.arm[rim] < 0.5)]
    near = np.linalg.norm(band.vertices[None] - worn.vertices[rim][:, None], axis=2)
    assert near.min(axis=1).max() < 0.008
    # A vee's point is cut straight down.
    assert near.min(axis=0).max() < 0.036
    assert np.median(near.min(axis=0)) < 0.015
    assert len(border(band.faces)) == 2 * collar.ROUND


def test_a_belt_is_closed_around_the_trousers_and_buckled_in_front() -> None:
    worn, pieces = of_kind("shirt", "trousers")
    strip = max(only(pieces, "belt"), key=lambda p: len(p.faces))
    middle = strip.vertices - worn.vertices[worn.place[:, 1] > 0.08].mean(axis=0)
    angle = np.sort(np.arctan2(middle[:, 0], middle[:, 2]))
    assert np.diff(angle).max() < 0.1
    assert 2 * np.pi - np.ptp(angle) < 0.1
    ends = border(strip.faces)
    assert len(ends) > 0
    _, count = np.unique(ends, return_counts=True)
    assert (count == 2).all()  # two closed lines and no free end
    metal = only(pieces, "metal")
    assert len(metal) == 2
    assert all(m.vertices[:, 2].mean() > strip.vertices[:, 2].mean() + 0.05 for m in metal)
    assert all(abs(m.vertices[:, 0].mean() - strip.vertices[:, 0].mean()) < 0.02 for m in metal)
    tall = np.ptp(strip.vertices.reshape(-1, 9, 3), axis=1)
    assert np.median(np.linalg.norm(tall, axis=1)) == pytest.approx(0.034, abs=0.006)


def test_a_belt_is_worn_where_a_tucked_top_shows_it_and_nowhere_else() -> None:
    random = np.random.default_rng(3)
    drawn = [draw_outfit(random, True, gender) for gender in (0.2, 0.8) for _ in range(100)]
    bottoms = [(outfit.top.tucked, outfit.bottom) for outfit in drawn if outfit.bottom]
    for tucked, bottom in bottoms:
        assert bottom.belt == (tucked and bottom.kind != "skirt")
    assert {bottom.belt for _, bottom in bottoms} == {True, False}
    assert any(tucked and not bottom.belt for tucked, bottom in bottoms)


def test_pockets_are_where_their_garments_have_them() -> None:
    _, tee = of_kind("tee", "tee")
    (chest,) = only(tee, "pocket")
    assert chest.vertices[:, 0].min() > 0.01  # over the heart
    middle = chest.vertices.mean(axis=0)[None]
    assert 0.001 < relief("tee", middle, 1.0)[0] < 0.006
    assert relief("tee", middle, -1.0)[0] == 0.0
    _, jeans = of_kind("shirt", "trousers")
    pair = only(jeans, "back_pocket")
    assert sorted(np.sign(p.vertices[:, 0].mean()) for p in pair) == [-1.0, 1.0]
    for pocket in pair:
        middle = pocket.vertices.mean(axis=0)[None]
        assert 0.001 < relief("shirt", middle, -1.0)[0] < 0.008
        assert relief("shirt", middle, 1.0)[0] == 0.0
    _, pouch = of_kind("pouch", "hoodie")
    (kangaroo,) = only(pouch, "pocket")
    assert abs(kangaroo.vertices[:, 0].mean() - standing()[0][:, 0].mean()) < 0.02
    assert 0.24 < np.ptp(kangaroo.vertices[:, 0]) < 0.34


def test_an_open_zip_runs_along_both_edges() -> None:
    worn, pieces = of_kind("zipped", "jacket")
    chains = sorted(only(pieces, "metal"), key=lambda p: -len(p.faces))[:2]
    left, right = sorted(chains, key=lambda p: p.vertices[:, 0].mean())
    assert left.vertices[:, 0].max() < right.vertices[:, 0].min()
    edge = cKDTree(worn.vertices[np.unique(border(worn.cloth.faces))])
    for chain in chains:
        assert np.ptp(chain.vertices[:, 1]) > 0.3
        assert np.median(edge.query(chain.vertices)[0]) < 0.018
        middle = chain.vertices[len(chain.vertices) // 2][None]
        assert relief("zipped", middle, -1.0)[0] == 0.0


EXPECTED = {
    "shirt": {"collar", "button", "pocket", "belt", "metal", "back_pocket"},
    "tee": {"collar", "pocket", "back_pocket"},
    "vee": {"collar", "back_pocket"},
    "scoop": {"collar", "button"},
    "hoodie": {"hood", "lace", "metal", "collar", "back_pocket"},
    "pouch": {"hood", "lace", "pocket", "back_pocket"},
    "jacket": {"collar", "jacket_collar", "button", "jacket_pocket", "back_pocket"},
    "zipped": {"collar", "jacket_collar", "metal", "jacket_pocket", "back_pocket"},
}


@pytest.mark.parametrize("name", OUTFITS)
def test_every_trim_is_painted_from_its_own_cell(name: str) -> None:
    found = set()
    for piece in (piece for group in clothed(name).trims for piece in group):
        mine = cells(piece)
        assert len(mine) == 1
        found |= mine
    assert found == EXPECTED[name]


@pytest.mark.parametrize("name", OUTFITS)
def test_trims_show_their_outside(name: str) -> None:
    made = clothed(name)
    count = 0
    for worn, pieces in zip(made.worn, made.trims, strict=True):
        tree = cKDTree(worn.vertices)
        for piece in pieces:
            count += len(piece.faces)
            corner = piece.vertices[piece.faces]
            assert np.isfinite(corner).all()
            if len(border(welded(piece))) == 0:
                middle = corner - piece.vertices.mean(axis=0)
                assert np.linalg.det(middle).sum() > 0
                continue
            area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            facing = (area * worn.normals[tree.query(corner.mean(axis=1))[1]]).sum(axis=1)
            # Edges stand steep; all in all a trim looks where its cloth looks.
            assert facing.sum() > 0.2 * np.linalg.norm(area, axis=1).sum()
    assert 100 < count < 40_000


def test_the_same_clothes_have_the_same_trims() -> None:
    made = clothed("jacket")
    again = [trimmed(w, made.outfit, made.around) for w in made.worn]
    for first, second in zip(made.trims, again, strict=True):
        for a, b in zip(first, second, strict=True):
            assert a.vertices.tobytes() == b.vertices.tobytes()
            assert a.faces.tobytes() == b.faces.tobytes()
            assert a.uv.tobytes() == b.uv.tobytes()
