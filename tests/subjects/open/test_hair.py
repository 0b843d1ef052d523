"""Hair and hats: closed, outward, on the scalp and off the face, in every pose of the head."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.ray.ray_pyembree import RayMeshIntersector

from subjects.open.base import surface
from subjects.open.base.atlas import CELLS, chart
from subjects.open.base.subdivision import refine, triangles
from subjects.open.base.surface import Piece, Solid
from subjects.open.base.template import BODY, template
from subjects.open.hair import style as hair
from subjects.open.hair.head import MIDDLE, Head

LOOSE = ("short", "bob", "long", "curly")


@lru_cache(maxsize=1)
def skin() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Refined template skin: places, faces, and how far above the hairline."""
    group = template().groups[BODY]
    fine = refine(
        group.quads, np.concatenate([chart(BODY), group.uv], axis=2), len(template().vertices), 1
    )
    place = fine.matrix @ template().vertices
    uv = np.zeros((len(place), 2))
    uv[fine.quads.ravel()] = fine.corners[..., 2:].reshape(-1, 2)
    grown = np.where(place[:, 1] > 0.62, hair.growth(place, uv), -1.0)
    return place, triangles(fine.quads), grown


def head_of(style: str, headwear: str = "none", turn: Rotation | None = None) -> Head:
    place, faces, grown = skin()
    vertices = (turn or Rotation.identity()).apply(place - MIDDLE) * 1.03 + [0.1, 1.5, 0.2]
    raised = hair.raised(
        vertices,
        surface.normals(vertices, faces),
        grown,
        style,
        headwear,
        np.zeros(len(place)),
    )
    normal = surface.normals(raised, faces)
    grows, near = grown > 0.004, place[:, 1] > 0.35
    return Head(
        Solid(raised[grows], normal[grows], place[grows]),
        Solid(raised[near], normal[near], place[near]),
    )


def styled(style: str, headwear: str = "none", seed: int = 1) -> list[Piece]:
    return hair.styled(style, headwear, head_of(style, headwear), np.random.default_rng(seed))


def combined(pieces: list[Piece]) -> trimesh.Trimesh:
    whole = surface.joined(pieces)
    return trimesh.Trimesh(whole.vertices, whole.faces, process=False)


WITH_LOCKS = list(hair.CUTS)
WORN = [(style, "none") for style in WITH_LOCKS]
WORN += [
    (style, hat) for style in ("short", "long", "ponytail", "afro") for hat in ("cap", "beanie")
]


@pytest.mark.parametrize(("style", "headwear"), WORN)
def test_hair_is_closed_and_faces_outward(style: str, headwear: str) -> None:
    pieces = styled(style, headwear)
    mesh = combined(pieces)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert len(mesh.faces) <= 64_000
    low, high = mesh.bounds
    x, y = np.meshgrid(np.arange(low[0], high[0], 0.004), np.arange(low[1], high[1], 0.004))
    for back in (1.0, -1.0):
        start = np.stack([x.ravel(), y.ravel(), np.full(x.size, 5.0 * back)], axis=1)
        along = np.tile([0.0, 0.0, -back], (len(start), 1))
        face = RayMeshIntersector(mesh).intersects_first(start + 1.3e-4, along)
        toward = mesh.face_normals[face[face >= 0], 2] * back
        assert (toward > -1e-6).mean() > 0.99


@pytest.mark.parametrize("style", WITH_LOCKS)
def test_hair_lies_on_the_head_and_off_the_face(style: str) -> None:
    head = head_of(style)
    vertices = surface.joined(hair.styled(style, "none", head, np.random.default_rng(2))).vertices
    height, _ = head.above(vertices)
    assert (height < -0.012).mean() < 0.01
    assert (height > 0.003).mean() > 0.3
    local = head.local(vertices)
    # Nothing hangs over nose and mouth; a fringe may reach the brows.
    over = (np.abs(local[:, 0]) < 0.035) & (local[:, 1] < 0.715) & (local[:, 2] > 0.11)
    assert over.mean() < 0.004


@pytest.mark.parametrize("style", WITH_LOCKS)
def test_hair_covers_the_scalp(style: str) -> None:
    head = head_of(style)
    mesh = combined(hair.styled(style, "none", head, np.random.default_rng(2)))
    direction = np.random.default_rng(0).normal(size=(400, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    point, _, off = head.on_scalp(direction)
    well_inside = (off < 0.05) & (head.local(point)[:, 1] > 0.77)
    start = point[well_inside] - 0.004 * head.turned(direction[well_inside])
    hit = RayMeshIntersector(mesh).intersects_any(start, head.turned(direction[well_inside]))
    assert well_inside.sum() > 60
    assert hit.mean() > 0.7


@pytest.mark.parametrize("style", ["bald", "cropped"])
def test_no_locks_grow_on_a_bald_or_cropped_head(style: str) -> None:
    assert styled(style) == []
    assert len(styled(style, "cap")) == 3


@pytest.mark.parametrize("style", ["long", "ponytail"])
def test_long_hair_falls_whichever_way_the_head_is_turned(style: str) -> None:
    turn = Rotation.from_euler("xz", [35, 20], degrees=True)
    head = head_of(style, turn=turn)
    vertices = surface.joined(hair.styled(style, "none", head, np.random.default_rng(4))).vertices
    lowest_scalp = head.scalp.vertices[:, 1].min()
    assert vertices[:, 1].min() < lowest_scalp - 0.03
    assert np.allclose(head.local(head.world(head.scalp.place)), head.scalp.place)


def test_lengths_are_told_apart() -> None:
    lowest = {s: head_of(s).local(surface.joined(styled(s)).vertices)[:, 1].min() for s in LOOSE}
    assert lowest["long"] < lowest["bob"] - 0.04 < lowest["short"] - 0.04
    assert lowest["short"] > 0.60


@pytest.mark.parametrize("style", WITH_LOCKS)
def test_the_same_draw_gives_the_same_hair_and_another_other_hair(style: str) -> None:
    first = surface.joined(styled(style, seed=5))
    again, other = surface.joined(styled(style, seed=5)), surface.joined(styled(style, seed=6))
    assert first.vertices.tobytes() == again.vertices.tobytes()
    assert first.uv.tobytes() == again.uv.tobytes()
    assert first.vertices.tobytes() != other.vertices.tobytes()


@pytest.mark.parametrize(("style", "headwear"), WORN)
def test_the_chart_is_the_cell_of_what_is_shown(style: str, headwear: str) -> None:
    for piece in styled(style, headwear):
        inside = [
            ((piece.uv >= [u0, v0]) & (piece.uv <= [u1, v1])).all()
            for u0, v0, u1, v1 in (CELLS["hair"], CELLS["cap"])
        ]
        assert sum(inside) == 1


@pytest.mark.parametrize("headwear", ["cap", "beanie"])
def test_a_hat_covers_the_crown_and_no_hair_comes_through(headwear: str) -> None:
    head = head_of("short", headwear)
    pieces = hair.styled("short", headwear, head, np.random.default_rng(3))
    hat = combined(pieces[: 3 if headwear == "cap" else 1])
    crown = head.local(head.scalp.vertices)[:, 1] > 0.80
    point, normal = head.scalp.vertices[crown], head.scalp.normals[crown]
    assert RayMeshIntersector(hat).intersects_any(point - 0.002 * normal, normal).all()
    top = hat.bounds[1, 1]
    locks = pieces[-1].vertices
    assert locks[:, 1].max() < top - 0.05


def test_a_caps_brim_is_in_front_and_its_button_on_top() -> None:
    head = head_of("bald", "cap")
    crown, brim, button = (head.local(p.vertices) for p in styled("bald", "cap"))
    forehead = head.local(head.solid.vertices)
    forehead = forehead[(forehead[:, 1] > 0.77) & (forehead[:, 1] < 0.80), 2].max()
    assert 0.05 < brim[:, 2].max() - forehead < 0.11
    assert brim[:, 2].min() > 0.05
    assert abs(brim[:, 0].mean()) < 0.003
    assert button[:, 1].max() == pytest.approx(crown[:, 1].max(), abs=0.012)
    assert button[:, 1].max() > crown[:, 1].max()
    assert np.abs(button[:, [0, 2]] - MIDDLE[[0, 2]]).max() < 0.012
