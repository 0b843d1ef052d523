"""How garments are cut from the clothing helpers, and where they lie before cloth falls.

A garment is where a field over the template is negative; the field's zero line is the hem. The
same field says which skin lies under the garment. Lengths along a limb count joints: 1 is the
elbow, 2 the wrist.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from subjects.open.base import surface
from subjects.open.base.atlas import OUTER, chart
from subjects.open.base.ramp import ramp
from subjects.open.base.subdivision import Refinement, refine, triangles
from subjects.open.base.surface import Pattern
from subjects.open.base.template import TIGHTS, template, weight_of
from subjects.open.clothes.outfit import Bottom, Outfit, Top

ARM = ("upperarm", "lowerarm", "wrist", "finger", "metacarpal")
COVER_MARGIN = 0.06
"""Metres on the template: skin this far under a hem may be taken away."""
COLLAR_WIDTH = 0.022
DRESS_SEAM = 0.12
"""Height on the template where a dress's bodice is sewn to its skirt."""


def arm_share(matrix: Any) -> np.ndarray:
    """How much each refined vertex follows an arm."""
    return matrix @ weight_of(ARM)


def arm_length(place: np.ndarray) -> np.ndarray:
    """Joints from the shoulder along either arm: 1 at the elbow, 2 at the wrist."""
    joints = template().joints
    mirrored = np.abs(place[:, 0])[:, None] * [1.0, 0.0, 0.0] + place * [0.0, 1.0, 1.0]
    shoulder, elbow, wrist = (joints[f"l-{j}"] for j in ("shoulder", "elbow", "hand"))
    upper, fore = elbow - shoulder, wrist - elbow
    first = ((mirrored - shoulder) @ upper) / (upper @ upper)
    second = ((mirrored - elbow) @ fore) / (fore @ fore)
    return np.minimum(first, 1.0) + np.maximum(second, 0.0)


def neckline_field(place: np.ndarray, kind: str) -> np.ndarray:
    """Positive above the neckline, metres on the template."""
    x, y, z = place.T

    def ring(height: float, slope: float, radius: float) -> np.ndarray:
        """Above a plane that falls to the front, and within a column around the neck."""
        above = y - (height - slope * (z + 0.02))
        within = radius - np.hypot(x, (z - 0.01) / 1.15)
        # A soft minimum rounds the corner between the two; the head is above every neckline.
        soft = -0.015 * np.logaddexp(-above / 0.015, -within / 0.015)
        return np.maximum(soft, y - 0.61)

    if kind == "shirt":
        return ring(0.590, 0.52, 0.085)
    crew = ring(0.580, 0.55, 0.092)
    if kind == "crew":
        return crew
    front = ramp(z, 0.0, 0.03)
    if kind == "vee":
        wedge = 0.8 * (y - 0.470 - 1.45 * np.abs(x))
        return np.maximum(crew, wedge - 0.3 * (1.0 - front))
    bowl = 0.105 - np.hypot(x, y - 0.575)
    return np.maximum(crew, bowl - 0.3 * (1.0 - front))


def hem_height(outfit: Outfit, place: np.ndarray, top: Top | None = None) -> np.ndarray:
    """Height of a top's lower edge, a little lower behind; tucked in, it ends under the waist.

    Args:
        top: the outfit's top if left out. Of a dress it is the bodice's edge.
    """
    top = top or outfit.top
    if top.kind == "dress":
        return np.full(len(place), DRESS_SEAM)
    if top.tucked and outfit.bottom is not None:
        return waist_height(outfit.bottom, place) - 0.035
    return top.hem + 0.05 * place[:, 2]


def waist_height(bottom: Bottom, place: np.ndarray) -> np.ndarray:
    """Height of the upper edge of trousers or skirt, a little higher behind."""
    return bottom.waist + 0.08 * (0.02 - place[:, 2])


def top_field(outfit: Outfit, top: Top, place: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Negative where the top (or, of a dress, its bodice) is."""
    on_arm = arm > 0.5
    sleeve = np.where(on_arm, 0.22 * (arm_length(place) - top.sleeve), -0.2)
    trunk = np.maximum(
        hem_height(outfit, place, top) - place[:, 1], neckline_field(place, top.neckline)
    )
    if top.opening > 0:
        trunk = np.maximum(trunk, opening_field(top, place))
    return np.where(on_arm, sleeve, trunk)


def opening_field(top: Top, place: np.ndarray) -> np.ndarray:
    """Positive in the open front of a jacket, which widens downwards."""
    x, y, z = place.T
    half = top.opening * (0.55 + 0.45 * ramp(y, 0.52, 0.05))
    return half - np.abs(x) - 0.4 * (1.0 - ramp(z, -0.01, 0.03))


def bottom_field(bottom: Bottom, place: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Negative where trousers or skirt are."""
    waist = place[:, 1] - waist_height(bottom, place)
    return np.where(arm > 0.5, 0.2, np.maximum(waist, bottom.cuff - place[:, 1]))


def dress_skirt_field(top: Top, place: np.ndarray) -> np.ndarray:
    """Negative where a dress's skirt is; its upper edge leaves room for the seam."""
    return np.maximum(place[:, 1] - (DRESS_SEAM - 0.012), top.hem - place[:, 1])


def covered(
    outfit: Outfit, garment: Top | Bottom, place: np.ndarray, arm: np.ndarray
) -> np.ndarray:
    """(N,) bool: what lies well inside a garment, as it is cut."""
    if isinstance(garment, Bottom):
        field = bottom_field(garment, place, arm)
    elif garment.kind == "dress":
        skirt = np.where(arm > 0.5, 0.2, np.maximum(place[:, 1] - 0.3, garment.hem - place[:, 1]))
        field = np.minimum(top_field(outfit, garment, place, arm), skirt)
    else:
        field = top_field(outfit, garment, place, arm)
    return field < -COVER_MARGIN


def lapped(outfit: Outfit, place: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(N,) bool: where top and bottom overlap, and neither hem is near the outside."""
    lower = outfit.bottom
    if lower is None:
        return np.zeros(len(place), dtype=bool)
    lap = np.minimum(waist_height(lower, place), lower.waist) + 0.02
    between = (place[:, 1] < lap) & (place[:, 1] > hem_height(outfit, place) - 0.02)
    return between & (arm < 0.5)


@lru_cache(maxsize=4)
def refined(group: str) -> tuple[Refinement, np.ndarray, np.ndarray]:
    """A chart's group refined once, its template coordinates and its share of the arms."""
    mesh = template().groups[TIGHTS if group == OUTER else group]
    fine = refine(mesh.quads, chart(group), len(template().vertices), 1)
    return fine, fine.matrix @ template().vertices, arm_share(fine.matrix)


def pattern(group: str, field: np.ndarray) -> Pattern:
    """The part of a chart's group where `field` is negative."""
    fine, _, _ = refined(group)
    return surface.cut(fine.matrix, triangles(fine.quads), triangles(fine.corners), field)
