"""Putting the clothes on: inner before outer, laid over the posed body or draped by the solver."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from subjects.open import garments, surface
from subjects.open.drape import DrapeError, Layer, drape, draw_material
from subjects.open.garments import Outfit, Sheet, Solid
from subjects.open.subdivision import Refinement, triangles
from subjects.open.surface import Piece
from subjects.open.template import BODY, template

START_GAP = 0.004
"""Metres by which cloth begins further out than it may end, clear of the solver's collisions."""
LAYER_GAP = 0.004
"""Metres that draped cloth keeps from what is under it, at the end."""
FLANGE = 0.012
"""Metres that a hem's lining goes on inwards: draped hems stand too far off to be closed."""
THROUGH = 0.001
"""Metres under the body's skin from which solved cloth counts as gone through it."""
SPIKE = 0.0025
"""Metres that a vertex may stand off its neighbours' mean."""
LARGEST_THROUGH = 0.03
"""Share of a garment's vertices that the solver may leave under the skin, to be pushed out."""


def dress(
    outfit: Outfit,
    shapes: np.ndarray,
    skin: Refinement,
    generator: np.random.Generator,
) -> tuple[list[Piece], list[dict[str, Any]]]:
    """The outfit's garments on a body.

    Args:
        shapes: (K, 19158, 3) base mesh from the reference pose to the body's own, for the solver
            to drape cloth on the way; of one shape alone, the garments are laid over it with
            painted folds.
        skin: the body's refinement, which the garments must stay outside of.

    Returns:
        the garments, and what became of each: JSON-ready.

    Raises:
        DrapeError: the cloth tore, exploded, did not settle or went through the body.
    """
    bottom = garments.skirt if outfit.bottom == "skirt" else garments.trousers
    makers = (garments.top, bottom) if outfit.tucked else (bottom, garments.top)
    sheets = [make(outfit, generator) for make in makers]
    if len(shapes) == 1:
        pieces, solid = [], _solid(skin, shapes[-1])
        for sheet in sheets:
            piece, outside = sheet.finished(sheet.laid(shapes[-1], solid))
            pieces.append(piece)
            solid = garments.both(solid, outside)
        return pieces, []
    return _draped(sheets, shapes, skin, generator)


def _draped(
    sheets: list[Sheet], shapes: np.ndarray, skin: Refinement, generator: np.random.Generator
) -> tuple[list[Piece], list[dict[str, Any]]]:
    layers, solid = [], _solid(skin, shapes[0])
    for sheet in sheets:
        material = draw_material(generator)
        start = sheet.started(shapes[0], solid, START_GAP)
        # Held cloth moves as the skin below it does.
        carried = np.stack([_carried(sheet, shape) for shape in shapes])
        goal = carried + (start - carried[0])
        layers.append(Layer(start, goal, sheet.cloth.faces, sheet.pin, material))
        solid = garments.both(solid, sheet.outside(start))

    quads = template().groups[BODY].quads
    used, faces = np.unique(triangles(quads), return_inverse=True)
    solved = drape(layers, shapes[:, used], faces.reshape(-1, 3))

    pieces, reports, solid = [], [], _solid(skin, shapes[-1])
    for sheet, layer, shape in zip(sheets, layers, solved, strict=True):
        mean = surface.averaging(sheet.cloth.faces, len(shape))
        for _ in range(2):  # the solver leaves a grain of single vertices
            shape = 0.5 * shape + 0.5 * (mean @ shape)
        through = surface.sunk(shape, sheet.place, solid.vertices, solid.normals, solid.place)
        share = float((through > THROUGH).mean())
        if share > LARGEST_THROUGH:
            raise DrapeError(f"{share:.1%} of the cloth went through what is under it")
        for gap in (LAYER_GAP, LAYER_GAP, LAYER_GAP / 2):
            shape = surface.pushed_out(
                _ironed(shape, mean),
                *(sheet.place, np.full(len(shape), gap)),
                *(solid.vertices, solid.normals, solid.place),
            )
        piece, outside = sheet.finished(shape, flange=FLANGE)
        pieces.append(piece)
        solid = garments.both(solid, outside)
        reports.append(
            {
                "material": asdict(layer.material),
                "through_share": round(share, 5),
            }
        )
    return pieces, reports


def _ironed(shape: np.ndarray, mean: csr_matrix) -> np.ndarray:
    """Without the spikes that hard creases leave, and nothing else changed."""
    for _ in range(8):
        change = mean @ shape - shape
        spike = np.clip(np.linalg.norm(change, axis=1) / SPIKE - 1, 0, 1)
        for _ in range(2):  # its neighbourhood follows
            spike = np.maximum(spike, mean @ spike)
        shape = shape + 0.7 * spike[:, None] * change
    return shape


def _solid(skin: Refinement, shape: np.ndarray) -> Solid:
    vertices = skin.matrix @ shape
    faces = triangles(skin.quads)
    return Solid(vertices, surface.normals(vertices, faces), skin.matrix @ template().vertices)


def _carried(sheet: Sheet, shape: np.ndarray) -> np.ndarray:
    vertices: np.ndarray = sheet.cloth.matrix @ shape
    return vertices + sheet.gap[:, None] * surface.normals(vertices, sheet.cloth.faces)
