"""Charts of garments: their fronts and backs, around the neck, the trunk and the waist."""

from __future__ import annotations

import numpy as np

from subjects.open.base import surface
from subjects.open.base.chart import Chart
from subjects.open.clothes.garments import neckline_field, waist_height
from subjects.open.clothes.outfit import Bottom, Top
from subjects.open.clothes.worn import Worn

CALM = 12
"""Averaging steps on the normals: a trim stands on the cloth's lie, not on each crease."""
NECK_AXIS = 0.01
"""Depth z of the upright axis through the neck, template metres."""
NECK_RADIUS = 0.09
WAIST_AXIS = 0.005
WAIST_RADIUS = 0.14


def _chart(
    worn: Worn, flat: np.ndarray, shown: np.ndarray, normal: np.ndarray, unit: tuple[float, float]
) -> Chart:
    """The faces whose corners are all `shown` (N,)."""
    faces = worn.cloth.faces
    chosen = shown[faces].all(axis=1)
    return Chart(faces[chosen], flat[faces[chosen]], worn.vertices, normal, np.array(unit))


def calmed(worn: Worn) -> np.ndarray:
    """(N, 3) outward normals without creases."""
    result = worn.normals
    mean = surface.averaging(worn.cloth.faces, len(result))
    for _ in range(CALM):
        result = 0.5 * result + 0.5 * (mean @ result)
    return result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-9)


def sided(worn: Worn, normal: np.ndarray, side: float) -> Chart:
    """x and y of the front (`side` 1) or back (-1) of trunk and hips, template metres."""
    out = surface.normals(worn.place, worn.cloth.faces)
    shown = (worn.arm < 0.5) & (out[:, 2] * side > 0.05)
    return _chart(worn, worn.place[:, :2], shown, normal, (1.0, 1.0))


def around_waist(worn: Worn, normal: np.ndarray) -> Chart:
    """Radians around the waist (0 in front, rising to the left) and how far above the upper edge
    of trousers or skirt, template metres; it has no seam.
    """
    assert isinstance(worn.garment, Bottom)
    level = worn.place[:, 1] - waist_height(worn.garment, worn.place)
    return _wrapped(worn, normal, level, (WAIST_AXIS, WAIST_RADIUS), worn.arm < 0.5)


def around_trunk(worn: Worn, normal: np.ndarray) -> Chart:
    """Radians around the trunk (0 in front, rising to the left) and height y; it has no seam."""
    column = (WAIST_AXIS, WAIST_RADIUS)
    return _wrapped(worn, normal, worn.place[:, 1], column, worn.arm < 0.5)


def around_neck(worn: Worn, normal: np.ndarray) -> Chart:
    """Radians around the neck and how far above the neckline, template metres; it has no seam."""
    assert isinstance(worn.garment, Top)
    field = neckline_field(worn.place, worn.garment.neckline)
    shown = (worn.arm < 0.5) & (worn.place[:, 1] > 0.2)
    return _wrapped(worn, normal, field, (NECK_AXIS, NECK_RADIUS), shown)


def _wrapped(
    worn: Worn,
    normal: np.ndarray,
    level: np.ndarray,
    column: tuple[float, float],
    shown: np.ndarray,
) -> Chart:
    axis, radius = column
    flat = np.stack([np.arctan2(worn.place[:, 0], worn.place[:, 2] - axis), level], axis=1)
    once = _chart(worn, flat, shown, normal, (radius, 1.0))
    flat = once.flat.copy()
    # A triangle across the seam behind goes on beyond half a turn.
    across = np.ptp(flat[..., 0], axis=1) > np.pi
    flat[across, :, 0] = np.where(
        flat[across, :, 0] < 0, flat[across, :, 0] + 2 * np.pi, flat[across, :, 0]
    )
    turns = [flat + np.array([2 * np.pi * k, 0.0]) for k in (-1, 0, 1)]
    wide = [t[..., 0].mean(axis=1) for t in turns]
    kept = [np.abs(w) < 1.5 * np.pi for w in wide]
    return Chart(
        np.concatenate([once.faces[k] for k in kept]),
        np.concatenate([t[k] for t, k in zip(turns, kept, strict=True)]),
        once.vertices,
        once.normals,
        once.unit,
    )
