"""Textures of open humans: an atlas without overlaps, paint where it belongs, people who differ."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from subjects.open.base.atlas import CELLS, GROUPS, MARGIN, OUTER, PLACES, cell, chart, texels
from subjects.open.base.template import BODY, SKIRT, TIGHTS, template
from subjects.open.clothes.outfit import Outfit, draw_material, draw_outfit
from subjects.open.texture import Look, draw_look, paint
from subjects.open.texture.motif import motif
from subjects.open.texture.palette import lightness

SIZE = 512
PHENOTYPE = {"gender": 1.0, "caucasian": 0.9, "asian": 0.1, "african": 0.1}


def rectangles() -> list[tuple[str, tuple[float, float, float, float]]]:
    return [(name, r) for name, places in PLACES.items() for r in places] + list(CELLS.items())


def outfit_of(kind: str, bottom: str | None = "trousers", jacket: bool = False) -> Outfit:
    """The first drawn outfit of a kind."""
    for k in range(3000):
        outfit = draw_outfit(np.random.default_rng(k), True, 0.9)
        worn = outfit.bottom.kind if outfit.bottom else None
        if outfit.top.kind == kind and worn == bottom and (outfit.outer is not None) == jacket:
            return outfit
    raise AssertionError(f"no {kind} with {bottom} in 3000 outfits")


def look_of(outfit: Outfit, seed: int = 0, **changed: Any) -> Look:
    return replace(draw_look(np.random.default_rng(seed), PHENOTYPE, 30.0, outfit), **changed)


def painted(look: Look, outfit: Outfit, seed: int = 3) -> np.ndarray:
    return paint(look, outfit, SIZE, np.random.default_rng(seed))


def changed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(T,) bool of the covered texels that differ."""
    return (a.reshape(-1, 3) != b.reshape(-1, 3)).any(axis=1)[texels(SIZE).pixel]


def of(*names: str) -> np.ndarray:
    return np.isin(texels(SIZE).group, [GROUPS.index(name) for name in names])


def test_no_two_rectangles_of_the_atlas_overlap() -> None:
    every = rectangles()
    for k, (name, (u0, v0, u1, v1)) in enumerate(every):
        assert 0.0 <= u0 < u1 <= 1.0, name
        assert 0.0 <= v0 < v1 <= 1.0, name
        for other, (s0, t0, s1, t1) in every[:k]:
            apart = u1 <= s0 or s1 <= u0 or v1 <= t0 or t1 <= v0
            assert apart, f"{name} and {other}"
    assert sum((r[2] - r[0]) * (r[3] - r[1]) for _, r in every) > 0.95


def test_texels_lie_in_their_groups_rectangles() -> None:
    baked = texels(SIZE)
    u = (baked.pixel % SIZE + 0.5) / SIZE
    v = 1.0 - (baked.pixel // SIZE + 0.5) / SIZE
    places = {name: [r for n, r in rectangles() if n == name] for name in GROUPS}
    for index, name in enumerate(GROUPS):
        own = baked.group == index
        assert own.sum() > 20, name
        inside = np.zeros(int(own.sum()), dtype=bool)
        for u0, v0, u1, v1 in places[name]:
            inside |= (u[own] > u0) & (u[own] < u1) & (v[own] > v0) & (v[own] < v1)
        assert inside.all(), name
    assert len(np.unique(baked.pixel)) == len(baked.pixel)


def test_the_jackets_chart_shows_the_suit_a_second_time() -> None:
    tights = template().groups[TIGHTS]
    covered = (template().vertices[tights.quads][..., 1] > -0.15).all(axis=1)
    u0, v0, u1, v1 = PLACES[OUTER][0]
    corners = chart(OUTER)[covered]
    assert (corners > [u0, v0]).all()
    assert (corners < [u1, v1]).all()
    # Where a quad's middle lies in the texture, the bake has the quad's place.
    baked = texels(SIZE)
    at = corners.mean(axis=1)
    pixel = ((1 - at[:, 1]) * SIZE).astype(int) * SIZE + (at[:, 0] * SIZE).astype(int)
    index = np.searchsorted(baked.pixel, pixel)
    # At the chart's edge the pixel's own middle may lie outside.
    shown = baked.pixel[index] == pixel
    assert shown.mean() > 0.97
    middle = template().vertices[tights.quads[covered]].mean(axis=1)
    away = np.linalg.norm(baked.place[index] - middle, axis=1)[shown]
    assert away.max() < 0.015
    assert (baked.group[index[shown]] == GROUPS.index(OUTER)).all()


@pytest.mark.parametrize("name", list(CELLS))
def test_a_cell_is_addressed_by_u_and_v(name: str) -> None:
    u0, v0, u1, v1 = CELLS[name]
    corners = cell(name, np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    assert np.allclose(corners, [[u0 + MARGIN, v0 + MARGIN], [u1 - MARGIN, v1 - MARGIN]])
    own = of(name)
    baked = texels(SIZE)
    at = cell(name, *baked.source[own].T)
    column, row = baked.pixel[own] % SIZE, baked.pixel[own] // SIZE
    assert np.allclose(at * SIZE, np.stack([column + 0.5, SIZE - row - 0.5], axis=1), atol=1e-6)


@pytest.mark.parametrize("side", ["front", "back"])
def test_a_print_is_on_its_own_side_alone(side: str) -> None:
    outfit = outfit_of("tee")
    bare = replace(outfit, top=replace(outfit.top, front="nothing", back="nothing"))
    front, back = ("print", "nothing") if side == "front" else ("nothing", "print")
    printed = replace(outfit, top=replace(bare.top, front=front, back=back))
    look = look_of(outfit, motif=(1.0, 0.0, 0.0), motif_second=(0.0, 1.0, 0.0))
    differs = changed(painted(look, bare), painted(look, printed))
    z = texels(SIZE).place[differs, 2]
    assert len(z) > 200
    assert (of(TIGHTS)[differs]).all()
    assert (z > 0.0).all() if side == "front" else (z < 0.0).all()


def test_prints_can_be_read() -> None:
    from subjects.open.texture.motif import _text

    x, y = np.meshgrid(np.linspace(-0.02, 0.02, 41), np.linspace(-0.03, 0.03, 61))
    letter = _text("L", x.ravel(), y.ravel(), 0.01).reshape(x.shape)
    assert letter[:, :14].mean() > 2 * letter[:, 27:].mean()  # the stem is at the left
    assert letter[:12].mean() > 2 * letter[49:].mean()  # and the foot below


@pytest.mark.parametrize("seed", range(12))
def test_every_motif_has_two_soft_colours_within_the_chest(seed: int) -> None:
    x, y = (
        g.ravel() for g in np.meshgrid(np.linspace(-0.2, 0.2, 201), np.linspace(-0.2, 0.2, 201))
    )
    first, second = motif(seed, x, y)
    both = np.maximum(first, second)
    assert both.min() >= 0.0
    assert np.maximum(first, second).max() <= 1.0 + 1e-6
    assert first.mean() > 0.005
    assert both[(np.abs(x) > 0.14) | (np.abs(y) > 0.13)].max() == 0.0


def test_a_jacket_is_painted_on_its_own_chart() -> None:
    outfit = outfit_of("tee", jacket=True)
    look = look_of(outfit)
    assert look.outer is not None
    red = replace(look, outer=replace(look.outer, base=(0.8, 0.1, 0.1)))
    differs = changed(painted(look, outfit), painted(red, outfit))
    assert (differs & of(OUTER)).sum() > 0.9 * of(OUTER).sum()
    assert not (differs & ~of(OUTER, "jacket_collar", "jacket_pocket")).any()


def test_trousers_and_top_share_no_texel() -> None:
    outfit = outfit_of("tee")
    look = look_of(outfit)
    a = painted(look, outfit)
    blue = replace(look, bottom=replace(look.bottom, base=(0.1, 0.2, 0.9), second=(0.1, 0.2, 0.9)))
    red = replace(look, top=replace(look.top, base=(0.9, 0.1, 0.1), second=(0.9, 0.1, 0.1)))
    lower = changed(a, painted(blue, outfit)) & of(TIGHTS)
    upper = changed(a, painted(red, outfit)) & of(TIGHTS)
    assert lower.sum() > 1000
    assert upper.sum() > 1000
    assert not (lower & upper).any()
    y = texels(SIZE).place[:, 1]
    assert y[lower].max() < 0.2
    assert y[upper].min() > -0.2


def test_a_dress_is_one_cloth_above_and_below_its_seam() -> None:
    outfit = outfit_of("dress", bottom=None)
    look = look_of(outfit)
    look = replace(look, top=replace(look.top, pattern="plain", base=(0.2, 0.6, 0.4)))
    picture = painted(look, outfit).reshape(-1, 3)[texels(SIZE).pixel]
    y = texels(SIZE).place[:, 1]
    bodice = np.median(picture[of(TIGHTS) & (y > 0.2) & (y < 0.4)], axis=0)
    skirt = np.median(picture[of(SKIRT) & (y > outfit.top.hem) & (y < 0.1)], axis=0)
    assert np.abs(bodice - skirt).max() <= 4


def test_the_same_draw_gives_the_same_bytes_and_another_person_others() -> None:
    outfit = outfit_of("shirt")
    look = look_of(outfit)
    first = painted(look, outfit)
    assert first.dtype == np.uint8
    assert first.shape == (SIZE, SIZE, 3)
    assert (painted(look, outfit) == first).all()
    other = painted(look_of(outfit, seed=1), outfit, seed=4)
    for group in (BODY, TIGHTS, "hair"):
        assert changed(first, other)[of(group)].mean() > 0.9


def test_palms_are_lighter_than_the_backs_of_dark_hands() -> None:
    outfit = outfit_of("tee")
    look = look_of(outfit, skin=(0.30, 0.20, 0.16))
    baked = texels(SIZE)
    picture = painted(look, outfit).reshape(-1, 3)[baked.pixel] / 255.0
    joints = template().joints
    hand = of(BODY) & (np.linalg.norm(baked.place - joints["l-finger-3-1"], axis=1) < 0.03)
    # The knuckles' plane divides the hand; the palm looks inwards and forwards.
    side = (baked.place - joints["l-finger-3-1"])[hand] @ [-0.55, -0.55, 0.62]
    palm, back = side > 0.008, side < -0.008
    assert palm.sum() > 20
    assert back.sum() > 20
    light = np.array([lightness(c) for c in picture[hand]])
    assert light[palm].mean() > 1.25 * light[back].mean()


def test_people_span_the_tones_and_grey_with_age() -> None:
    outfit = outfit_of("tee")

    def looks(count: int, age: float, **who: float) -> list[Look]:
        return [
            draw_look(np.random.default_rng(k), PHENOTYPE | who, age, outfit) for k in range(count)
        ]

    tones = [lightness(look.skin) for look in looks(120, 30.0)]
    tones += [lightness(look.skin) for look in looks(120, 30.0, caucasian=0.0, african=1.0)]
    assert min(tones) < 0.22
    assert max(tones) > 0.85
    assert max(np.diff(sorted(tones))) < 0.12

    def greyed(age: float) -> float:
        drawn = looks(120, age, gender=0.0)
        return float(np.mean([max(x.grey, x.hair_name in ("grey", "white")) for x in drawn]))

    assert greyed(25.0) < 0.1 < 0.4 < greyed(70.0)


def test_hats_beards_and_styles_come_in_their_shares() -> None:
    outfit = outfit_of("tee")
    men, women = (
        [
            draw_look(np.random.default_rng(k), PHENOTYPE | {"gender": g}, 40.0, outfit)
            for k in range(500)
        ]
        for g in (0.0, 1.0)
    )
    capped = np.mean([look.headwear == "cap" for look in men + women])
    assert 0.09 < capped < 0.15
    assert not any(look.beard for look in women)
    assert 0.3 < np.mean([look.beard > 0 for look in men]) < 0.7
    assert not any(look.hair_style == "bald" for look in women)
    long = ("long", "bob", "ponytail", "bun")
    assert np.mean([look.hair_style in long for look in women]) > 0.5
    assert np.mean([look.hair_style in long for look in men]) < 0.25


def test_a_look_is_json_ready() -> None:
    look = look_of(outfit_of("tee", jacket=True))
    read = json.loads(json.dumps(look.as_json()))
    assert read["top"]["base"] == list(look.top.base)
    assert read["headwear"] in ("none", "cap", "beanie")


@pytest.mark.parametrize("material", ["denim", "leather", "wool"])
def test_a_material_shows_in_the_cloth(material: str) -> None:
    generator = np.random.default_rng(0)
    outfit = outfit_of("tee", jacket=True)
    assert outfit.outer is not None
    made = replace(outfit.outer, material=draw_material(generator, [material]))
    look = look_of(replace(outfit, outer=made))
    assert look.outer is not None
    assert look.outer.weave == {"denim": "twill", "leather": "grain", "wool": "felt"}[material]
