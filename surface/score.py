"""How far a surface is from the truth: the paper's metrics, and ICON's.

Section 4.2 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images" has CD,
P2S and L2; Xiu et al., "ICON", CVPR 2022, has the field's Chamfer, P2S and normal error.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from surface.alignment import align
from surface.distances import nearest, sample
from surface.mesh import SurfaceError, TriangleMesh
from surface.normal_maps import SIZE, castable, encoded, normal_map
from surface.truth import SAMPLES, Truth

Convention = Literal["paper", "icon", "metric"]

ANGLES_DEG = (0, 90, 180, 270)
"""From which normal maps are seen: the front, a side, the back, the other side."""

ICON_HEIGHT = 2 * 180 / (0.4 * 512)
"""Of a truth in ICON's window from -1 to 1: its scans are scaled to 180 units, its camera has 0.4
units a pixel and 512 pixels."""

PERCENT = 100.0
"""Distances are told in hundredths, as both papers do."""


@dataclass(frozen=True)
class Score:
    """One surface against the truth; smaller is better.

    Attributes:
        truth_to_mesh: mean distance of the truth's points from the mesh, times 100.
        mesh_to_truth: the same the other way.
        l2_0, l2_90, l2_180, l2_270: squared difference of the normal maps, summed over the three
            channels (0 to 1), mean over all pixels.
    """

    truth_to_mesh: float
    mesh_to_truth: float
    l2_0: float
    l2_90: float
    l2_180: float
    l2_270: float

    @property
    def both_ways(self) -> float:
        """Mean of both directions' distances."""
        return (self.truth_to_mesh + self.mesh_to_truth) / 2

    @property
    def l2(self) -> float:
        """Mean over the four angles."""
        return (self.l2_0 + self.l2_90 + self.l2_180 + self.l2_270) / 4

    def figures(self, convention: Convention) -> dict[str, float]:
        """All of them by name: first those that a convention has, under its own names."""
        named = {
            # The paper's CD goes one way, its P2S both.
            "paper": {
                "CD": self.truth_to_mesh,
                "P2S": self.both_ways,
                "L2": self.l2,
                "L2 front": self.l2_0,
                "L2 back": self.l2_180,
                "L2 front, back": (self.l2_0 + self.l2_180) / 2,
            },
            "icon": {
                "Chamfer": self.both_ways,
                "P2S": self.truth_to_mesh,
                "Normals": 4 * self.l2,
            },
            "metric": {
                "Chamfer": self.both_ways,
                "L2": self.l2,
                "L2 front": self.l2_0,
                "L2 back": self.l2_180,
            },
        }
        return {**named[convention], **asdict(self)}


def score(
    mesh: TriangleMesh,
    truth: Truth,
    rng: np.random.Generator,
    convention: Convention = "paper",
    aligned: bool = False,
    samples: int = SAMPLES,
    size: int = SIZE,
) -> Score:
    """Measure a mesh.

    Args:
        mesh: to be measured, y up, facing +z as the truth does.
        truth: in metres.
        rng: of the mesh's points that are measured.
        convention: "paper" moves and scales both so that each fits its own box of side 1, whatever
            their units; "icon" scales the truth to ICON's height, and the mesh, which has to be in
            the truth's frame, alike; "metric" leaves metres, so that distances are centimetres.
        aligned: first lay the mesh onto the truth by the best similarity, its box onto the truth's
            to begin with.
        samples: points of the mesh.
        size: pixels of the normal maps' sides.

    Raises:
        SurfaceError: one of them has no extent or no area.
    """
    own_box, true_box = unit_box(mesh), unit_box(truth.mesh)
    placed, half = _placement(truth.mesh, true_box, convention)
    if aligned:
        begin = np.linalg.inv(true_box) @ own_box
        moved = placed @ align(mesh.transformed(begin), truth, rng) @ begin
    else:
        moved = own_box if convention == "paper" else placed
    mesh, truth = mesh.transformed(moved), truth.transformed(placed)
    there, _ = nearest(truth.points, mesh)
    back, _ = nearest(sample(mesh, samples, rng), truth.mesh)
    surfaces = [castable(surface) for surface in (mesh, truth.mesh)]
    off = {}
    for angle in ANGLES_DEG:
        maps = [encoded(*normal_map(surface, angle, half, size)) for surface in surfaces]
        off[f"l2_{angle}"] = float(((maps[0] - maps[1]) ** 2).sum(axis=2).mean())
    return Score(PERCENT * float(there.mean()), PERCENT * float(back.mean()), **off)


def unit_box(mesh: TriangleMesh) -> np.ndarray:
    """(4, 4) similarity to the box of side 1 round the origin, which the longest side fills.

    Raises:
        SurfaceError: the mesh has no extent.
    """
    low, high = mesh.bounds
    longest = float((high - low).max())
    if not 0 < longest < np.inf:
        raise SurfaceError("the surface has no extent; all its vertices are at one place")
    result = np.eye(4) / longest
    result[:3, 3] = -(low + high) / 2 / longest
    result[3, 3] = 1
    return result


def _placement(
    truth: TriangleMesh, to_box: np.ndarray, convention: Convention
) -> tuple[np.ndarray, float]:
    """(4, 4) of the truth, and half the side of the normal maps' window."""
    if convention == "paper":
        return to_box, 0.5
    low, high = truth.bounds
    placed = np.eye(4)
    placed[:3, 3] = -(low + high) / 2
    if convention == "metric":
        return placed, float((high - low).max()) / 2 * 1.05
    height = float(high[1] - low[1])
    if not height > 0:
        raise SurfaceError("the truth has no height")
    scale = np.diag([ICON_HEIGHT / height] * 3 + [1.0])
    return scale @ placed, 1.0
