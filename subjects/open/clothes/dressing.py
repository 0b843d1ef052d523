"""Putting the clothes on: inner before outer, laid over the posed body or draped by the solver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from subjects.open.base import surface
from subjects.open.base.measure import through_share, winding_numbers
from subjects.open.base.subdivision import Refinement, triangles
from subjects.open.base.surface import Solid
from subjects.open.base.template import bare_body, template, weight_of
from subjects.open.clothes import garments
from subjects.open.clothes.drape import DrapeError, Layer, check_stretch, drape
from subjects.open.clothes.outfit import Material, Outfit
from subjects.open.clothes.sheet import Sheet, sheets
from subjects.open.clothes.worn import Worn

HAND = ("wrist", "finger", "metacarpal")
FARTHEST = 0.026
"""Metres a frame that a limb may move on the way into the pose, at its fastest."""
FEWEST, MOST = 16, 40
"""Frames of the way into the pose."""
SETTLING = 8
"""Frames in which coarse cloth then comes to rest."""
FOLDING = 10
"""Frames in which the fine cloth, over the body at rest, finds its folds."""
COARSE_REACH, FINE_REACH = 0.010, 0.005
"""Metres within which cloth feels what is under it; more where a limb moves fast."""
COARSE_BENDING = 4.0
"""Times the cloth's own stiffness against folding."""
START_GAP = 0.008
"""Metres by which cloth begins further out than it may end, clear of the solver's collisions."""
LAYER_GAP = 0.004
"""Metres that draped cloth keeps from what is under it, at the end."""
GRAIN = 3
"""Averaging steps against the grain that single vertices make in solved cloth."""
HEM = 10
"""More of them along the hems."""
SPIKE = 0.0025
"""Metres that a vertex may stand off its neighbours' mean."""
FREED_GAP = 0.002
"""Metres off the skin at which cloth is laid that was inside the body."""
LARGEST_FREED = 0.03
"""Share of a garment's area that the solver may leave inside the body, to be freed."""
LARGEST_THROUGH = 0.005
"""Share of a garment's area that may lie inside the body."""
HIDING = 0.03
"""Metres within which cloth hides what is under it for good."""


def dress(
    outfit: Outfit,
    shapes: np.ndarray,
    skin: Refinement,
    solid: Solid,
    generator: np.random.Generator,
    scratch: Path,
) -> tuple[list[Worn], list[dict[str, Any]]]:
    """The outfit's garments on a body, from the innermost outwards.

    Args:
        shapes: (K, 19158, 3) base mesh from the reference pose to the body's own, for the solver
            to drape cloth on the way; of one shape alone, the garments are laid over it with
            painted folds.
        skin: the body's refinement.
        solid: what it is of the last shape, which the garments must stay outside of.
        scratch: a folder for the solver.

    Returns:
        the garments, and what became of each: JSON-ready.

    Raises:
        DrapeError: the cloth tore, exploded, did not settle or went through the body.
        SolverError: the solver itself failed.
    """
    coarse = sheets(outfit, generator)
    fine = [sheet.finer() for sheet in coarse]
    bare = _exposed(solid, shapes[-1])
    layers = None if len(shapes) == 1 else _draped(coarse, fine, shapes, skin, solid, scratch)
    result, reports = [], []
    for k, (sheet, _) in enumerate(fine):
        if layers is None:
            vertices = found = sheet.folded(sheet.laid(shapes[-1], solid), solid)
        else:
            found = layers[k].start
            vertices = _smooth(sheet, found, solid)
        vertices = _freed(sheet, vertices, shapes[-1], bare)
        if layers is not None:
            check_stretch(layers[k], vertices)
        worn = sheet.worn(vertices)
        result.append(worn)
        solid = surface.both(solid, worn.solid)
        reports.append(
            {
                "garment": worn.garment.kind,
                "material": worn.garment.material.name,
                "soft_and_loose": worn.garment.material.soft and worn.garment.loose,
                "freed_share": _inside(worn, found, shapes[-1], LARGEST_FREED),
                "through_share": _inside(worn, vertices, shapes[-1], LARGEST_THROUGH),
            }
        )
    return result, reports


def _inside(worn: Worn, vertices: np.ndarray, body: np.ndarray, bound: float) -> float:
    """Share of the garment's area inside the body where it lies at `vertices`.

    Raises:
        DrapeError: it reaches `bound`.
    """
    used, faces = bare_body()
    share = through_share(vertices, worn.cloth.faces, body[used], faces)
    if share >= bound:
        raise DrapeError(f"{share:.1%} of the {worn.garment.kind} lies inside the body")
    return round(share, 6)


def _draped(
    coarse: list[Sheet],
    fine: list[tuple[Sheet, csr_matrix]],
    shapes: np.ndarray,
    skin: Refinement,
    solid: Solid,
    scratch: Path,
) -> list[Layer]:
    """Coarse cloth goes along into the pose; fine cloth, begun where it came to rest, folds.

    Returns:
        the fine layers, `start` where they came to rest.
    """
    layers, under = [], bare_solid(skin, shapes[0])
    for sheet in coarse:
        start = sheet.laid(shapes[0], under, START_GAP)
        # Held cloth moves as the skin below it does.
        carried = np.stack([sheet.carried(shape) for shape in shapes])
        goal = carried + (start - carried[0])
        layers.append(Layer(start, goal, start, sheet.cloth.faces, sheet.pin, _stiffer(sheet)))
        under = surface.both(under, sheet.worn(start).solid)
    used, faces = bare_body()
    # Fingers would hook the hems that they pass.
    hand = weight_of(HAND)[used] > 0.5
    bare = faces[~hand[faces].any(axis=1)]
    rested = drape(
        layers,
        shapes[:, used],
        bare,
        scratch,
        moving=_frames(shapes[:, used][:, ~hand]),
        settling=SETTLING,
        reach=COARSE_REACH,
    )

    finer = []
    for (sheet, up), layer, vertices in zip(fine, layers, rested, strict=True):
        gap = np.full(len(sheet.place), LAYER_GAP)
        start = surface.pushed_out(up @ vertices, sheet.place, gap, solid)
        finer.append(
            replace(
                layer,
                material=sheet.garment.material,
                start=start,
                goal=start[None],
                flat=up @ layer.flat,
                faces=sheet.cloth.faces,
                pin=sheet.pin,
            )
        )
        solid = surface.both(solid, sheet.worn(start).solid)
    folded = drape(
        finer, shapes[-1:, used], faces, scratch, moving=0, settling=FOLDING, reach=FINE_REACH
    )
    return [replace(layer, start=last) for layer, last in zip(finer, folded, strict=True)]


def _stiffer(sheet: Sheet) -> Material:
    """What keeps coarse cloth from folding along its threads alone: fine cloth folds later."""
    cloth = sheet.garment.material
    return replace(cloth, bending=COARSE_BENDING * cloth.bending, slack=0.5 * cloth.slack)


def _frames(shapes: np.ndarray) -> int:
    """How many the body needs from its first shape (K, M, 3) to its last."""
    step = np.linalg.norm(np.diff(shapes, axis=0), axis=2).max(axis=0)
    fastest = float(np.quantile(step, 0.98)) * (len(shapes) - 1)
    return int(np.clip(np.ceil(fastest / FARTHEST), FEWEST, MOST))


def _smooth(sheet: Sheet, shape: np.ndarray, solid: Solid) -> np.ndarray:
    """Solved cloth without the solver's grain and spikes, clear of what is under it."""
    faces, mean = sheet.cloth.faces, sheet.mean
    shape = surface.evened(shape, faces, mean, shape, GRAIN)
    # A hem is a doubled edge: it does not crumple as single threads do.
    hem = surface.on_border(faces).astype(float)
    for _ in range(2):
        hem = np.maximum(hem, mean @ hem)
    shape = surface.evened(shape, faces, mean, shape, HEM, np.minimum(hem, 1.0))
    for gap in (LAYER_GAP, LAYER_GAP, LAYER_GAP / 2):
        shape = surface.pushed_out(
            _ironed(shape, mean), sheet.place, np.full(len(shape), gap), solid
        )
    return shape


def _freed(sheet: Sheet, shape: np.ndarray, body: np.ndarray, bare: Solid) -> np.ndarray:
    """Cloth without what is still inside the body: laid on the skin of its own limb there.

    A shirt's side that the arm came down on is inside the arm; it belongs on the trunk.
    """
    used, faces = bare_body()
    mean = sheet.mean
    tree = cKDTree(np.concatenate([bare.vertices, 0.6 * bare.place], axis=1))
    for rounds in (4, 4, 2, 0, 0):
        centroids = shape[sheet.cloth.faces].mean(axis=1)
        inside = winding_numbers(shape, body[used], faces) > 0
        inside[sheet.cloth.faces[winding_numbers(centroids, body[used], faces) > 0].ravel()] = True
        if not inside.any():
            break
        _, near = tree.query(np.concatenate([shape[inside], 0.6 * sheet.place[inside]], axis=1))
        shape = shape.copy()
        shape[inside] = bare.vertices[near] + FREED_GAP * bare.normals[near]
        around = inside.astype(float)
        for _ in range(3):
            around = np.maximum(around, mean @ around)
        for _ in range(rounds):
            shape = shape + 0.5 * around[:, None] * (mean @ shape - shape)
    return shape


def _ironed(shape: np.ndarray, mean: csr_matrix) -> np.ndarray:
    """Without the spikes that hard creases leave, and nothing else changed."""
    for _ in range(8):
        change = mean @ shape - shape
        spike = np.clip(np.linalg.norm(change, axis=1) / SPIKE - 1, 0, 1)
        for _ in range(2):  # its neighbourhood follows
            spike = np.maximum(spike, mean @ spike)
        shape = shape + 0.7 * spike[:, None] * change
    return shape


def hidden(
    outfit: Outfit, place: np.ndarray, arm: np.ndarray, vertices: np.ndarray, over: list[Worn]
) -> np.ndarray:
    """(N,) bool: what lies close under garments, well inside their hems, and is never seen.

    Args:
        place: (N, 3) template coordinates of skin or of an inner garment, which follows arms by
            `arm` (N,) and lies at `vertices` (N, 3).
        over: the garments over it.
    """
    result = np.zeros(len(place), dtype=bool)
    for worn in over:
        under = garments.covered(outfit, worn.garment, place, arm)
        distance, _ = cKDTree(worn.vertices).query(vertices[under], distance_upper_bound=HIDING)
        result[under] |= np.isfinite(distance)
    return result


def bare_solid(skin: Refinement, shape: np.ndarray) -> Solid:
    """The refined skin of a base mesh (19158, 3)."""
    vertices = skin.matrix @ shape
    faces = triangles(skin.quads)
    return Solid(vertices, surface.normals(vertices, faces), skin.matrix @ template().vertices)


def _exposed(solid: Solid, shape: np.ndarray) -> Solid:
    """The skin that is not pressed against another limb: where there is room for cloth.

    Args:
        solid: the refined skin of the base mesh `shape`.
    """
    used, faces = bare_body()
    above = solid.vertices + 2 * FREED_GAP * solid.normals
    free = winding_numbers(above, shape[used], faces) == 0
    return Solid(solid.vertices[free], solid.normals[free], solid.place[free])
