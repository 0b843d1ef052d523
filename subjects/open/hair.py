"""Hair: the scalp raised where it grows, and what hangs or is tied from it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.spatial import cKDTree

from subjects.open import surface
from subjects.open.atlas import strip
from subjects.open.garments import Solid, ramp
from subjects.open.surface import Piece
from subjects.open.template import data_folder

STYLES = ("bald", "cropped", "short", "bob", "long", "ponytail", "bun")
RISE = {
    "bald": 0.0,
    "cropped": 0.004,
    "short": 0.017,
    "bob": 0.016,
    "long": 0.015,
    "ponytail": 0.009,
    "bun": 0.009,
}
"""Metres the scalp is raised by."""
# Height of the hairline over depth (template metres): nape, behind the ear, temple, forehead.
LINE_Z = np.array([-0.06, -0.01, 0.025, 0.055, 0.085, 0.105, 0.14])
LINE_Y = np.array([0.668, 0.690, 0.715, 0.722, 0.765, 0.790, 0.806])


@lru_cache(maxsize=8)
def mask(name: str) -> np.ndarray:
    """A black-and-white picture over the body's charts, (2048, 2048) float in [0, 1]."""
    from PIL import Image

    with Image.open(data_folder() / "textures" / f"mpfb_{name}.jpg") as image:
        return np.asarray(image.convert("L"), dtype=np.float32) / 255.0


def masked(name: str, uv: np.ndarray) -> np.ndarray:
    """The mask's value at chart coordinates (N, 2)."""
    picture = mask(name)
    h, w = picture.shape
    at = [(1.0 - uv[:, 1]) * h - 0.5, uv[:, 0] * w - 0.5]
    return map_coordinates(picture, at, order=1, mode="nearest")


def growth(place: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N,) metres above the hairline, template coordinates; negative on skin and ears."""
    above = place[:, 1] - np.interp(place[:, 2], LINE_Z, LINE_Y)
    # Sideburns come down in front of the ear.
    return above - 0.2 * masked("ears", uv)


def raised(
    vertices: np.ndarray, normals: np.ndarray, grown: np.ndarray, style: str, rough: np.ndarray
) -> np.ndarray:
    """Body vertices with the scalp moved out where hair grows.

    Args:
        grown: (N,) from `growth`.
        rough: (N,) in [-1, 1], unevenness of the hair.
    """
    height = RISE[style] * ramp(grown, 0.0, 0.035) * (1.0 + 0.25 * rough)
    return vertices + height[:, None] * normals


def extras(
    style: str,
    scalp: Solid,
    around: Solid,
    generator: np.random.Generator,
) -> list[Piece]:
    """What hangs from the head: curtain, ponytail or bun.

    Args:
        scalp: the head with its hair raised, posed.
        around: everything the hair lies on: skin and clothes.
    """
    if style in ("bob", "long"):
        length = generator.uniform(0.10, 0.15) if style == "bob" else generator.uniform(0.24, 0.40)
        return [_curtain(length, scalp, around, generator)]
    if style == "ponytail":
        return [_tail(generator.uniform(0.18, 0.32), scalp, around)]
    if style == "bun":
        return [_bun(generator.uniform(0.030, 0.042), scalp)]
    return []


def _on_scalp(scalp: Solid, side: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """Indices of the scalp vertices seen from the head's middle; side 0 is the back, radians."""
    middle = np.array([0.0, 0.745, 0.05])
    direction = np.stack(
        [np.sin(side) * np.cos(rise), np.sin(rise), -np.cos(side) * np.cos(rise)], axis=-1
    )
    return cKDTree(scalp.place).query(middle + 0.12 * direction)[1]


def _curtain(length: float, scalp: Solid, around: Solid, generator: np.random.Generator) -> Piece:
    columns, over, rows = 72, 10, 26
    side = np.radians(np.linspace(-112, 112, columns))
    grid = np.empty((over + rows, columns, 3))
    for k, rise in enumerate(np.radians(np.linspace(78, -4, over))):
        near = _on_scalp(scalp, side, np.full(columns, rise))
        # The first rows start inside the raised hair and come out of it.
        out = -0.006 + 0.013 * k / (over - 1) * ramp(np.abs(side), np.radians(112), np.radians(80))
        grid[k] = scalp.vertices[near] + out[:, None] * scalp.normals[near]
    grid[:over] = gaussian_filter1d(gaussian_filter1d(grid[:over], 2.0, axis=1), 0.7, axis=0)
    ends = length * (1.0 + 0.05 * generator.normal(0, 1, columns))
    ends = gaussian_filter1d(ends, 3.0) * np.where(np.abs(side) > np.radians(80), 0.92, 1.0)
    zero = np.zeros((columns, 3))
    centre = grid[over - 1].mean(axis=0)
    for k in range(over, over + rows):
        step = (ends / rows)[:, None]
        inward = (centre - grid[k - 1]) * [1.0, 0.0, 1.0]
        grid[k] = grid[k - 1] + step * [0.0, -1.0, 0.0] + 0.10 * step * inward
        grid[k] = surface.pushed_out(
            grid[k],
            zero,
            np.full(columns, 0.012),
            around.vertices,
            around.normals,
            np.zeros_like(around.place),
        )
        # Strands keep their neighbours' company and do not jump.
        grid[k] = gaussian_filter1d(grid[k], 1.2, axis=0)
    grid = gaussian_filter1d(grid, 1.0, axis=0)
    waves = 0.0025 * np.sin(np.linspace(0, 34, columns) + generator.uniform(0, 6))
    outward = grid - centre
    outward[..., 1] = 0.0
    outward /= np.maximum(np.linalg.norm(outward, axis=2, keepdims=True), 1e-6)
    grid = grid + outward * waves[None, :, None] * ramp(np.arange(len(grid)), 4, 14)[:, None, None]
    return _shell(grid, 0.010)


def _shell(grid: np.ndarray, thickness: float) -> Piece:
    """A grid (R, C, 3), rows running down and columns to the left seen from outside, as a shell."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows))
    flat = strip(u, v).reshape(-1, 2)
    outer = grid.reshape(-1, 3)
    inner = outer - thickness * surface.normals(outer, faces)
    n = len(outer)
    rim = np.concatenate([index[:, 0], index[-1, 1:], index[-2::-1, -1], index[0, -2:0:-1]])
    p, q = rim, np.roll(rim, -1)
    band = np.concatenate([np.stack([q, p, p + n], axis=1), np.stack([q, p + n, q + n], axis=1)])
    faces = np.concatenate([faces, faces[:, ::-1] + n, band])
    return Piece(np.concatenate([outer, inner]), faces, np.concatenate([flat, flat])[faces])


def _tube(path: np.ndarray, radius: np.ndarray) -> Piece:
    """A closed tube around `path` (K, 3) with `radius` (K,), rounded to points at both ends."""
    around = 20
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    left = np.cross(along, [0.31, 0.17, 0.93])
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    front = np.cross(along, left)
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    ring = np.cos(angle)[:, None] * left[:, None] + np.sin(angle)[:, None] * front[:, None]
    vertices = (path[:, None] + radius[:, None, None] * ring).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(len(path), around)
    a, b = index[:-1], np.roll(index[:-1], -1, axis=1)
    c, d = np.roll(index[1:], -1, axis=1), index[1:]
    u = np.linspace(0, 1, around + 1)
    v = np.linspace(1, 0, len(path))
    ua, ub = np.meshgrid(u[:-1], v[:-1])[0], np.meshgrid(u[1:], v[:-1])[0]
    va, vd = np.meshgrid(u[:-1], v[:-1])[1], np.meshgrid(u[:-1], v[1:])[1]
    ta, tb, tc, td = strip(ua, va), strip(ub, va), strip(ub, vd), strip(ua, vd)
    faces = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    uv = np.concatenate(
        [
            np.stack([ta, tb, tc], axis=-2).reshape(-1, 3, 2),
            np.stack([ta, tc, td], axis=-2).reshape(-1, 3, 2),
        ]
    )
    n = len(vertices)
    start, end = index[0], index[-1]
    caps = np.concatenate(
        [
            np.stack([np.roll(start, -1), start, np.full(around, n)], axis=1),
            np.stack([end, np.roll(end, -1), np.full(around, n + 1)], axis=1),
        ]
    )
    flat = np.broadcast_to(strip(np.array(0.5), np.array(0.5)), (len(caps), 3, 2))
    return Piece(
        np.concatenate([vertices, path[[0, -1]]]),
        np.concatenate([faces, caps]),
        np.concatenate([uv, flat]),
    )


def _tail(length: float, scalp: Solid, around: Solid) -> Piece:
    knot = _on_scalp(scalp, np.zeros(1), np.radians([18.0]))[0]
    steps = 26
    path = np.empty((steps, 3))
    path[0] = scalp.vertices[knot] - 0.008 * scalp.normals[knot]
    speed = scalp.normals[knot] * 1.4 + [0.0, 0.5, 0.0]
    still = np.zeros((1, 3))
    for k in range(1, steps):
        speed = 0.80 * speed + [0.0, -0.24, 0.0]
        forward = path[k - 1] + speed / np.linalg.norm(speed) * length / steps
        path[k] = surface.pushed_out(
            forward[None],
            still,
            np.full(1, 0.026 if k > 4 else -0.02),
            around.vertices,
            around.normals,
            np.zeros_like(around.place),
        )[0]
    path = gaussian_filter1d(path, 1.5, axis=0, mode="nearest")
    t = np.linspace(0, 1, steps)
    return _tube(path, 0.004 + 0.024 * np.sqrt(np.sin(np.pi * np.clip(t * 0.97, 0, 1)) ** 0.9))


def _bun(radius: float, scalp: Solid) -> Piece:
    knot = _on_scalp(scalp, np.zeros(1), np.radians([32.0]))[0]
    out = scalp.normals[knot]
    t = np.linspace(0.02, np.pi - 0.02, 18)
    middle = scalp.vertices[knot] + 0.62 * radius * out
    path = middle - np.cos(t)[:, None] * out * radius * 0.85
    return _tube(path, radius * np.sin(t))
