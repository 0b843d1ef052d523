"""One geometry of a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from subjects.color import linear_to_srgb
from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder

CORNERS = 1000
"""Most corners of a face: it becomes a fan of triangles, which is right of convex ones alone."""


@dataclass(eq=False)
class Part:
    """One geometry of a file, in the file's coordinates."""

    vertices: np.ndarray  # (N, 3)
    faces: np.ndarray  # (F, 3)
    normals: np.ndarray  # (N, 3), zero where the file gives none
    uv: np.ndarray | None  # (F, 3, 2) float32, of each corner
    colors: np.ndarray | None  # (N, 3) uint8 sRGB
    material: Material


def check_corners(counts: np.ndarray | tuple[int, ...]) -> None:
    """MeshError where one of these numbers of a face's corners cannot be right."""
    for count in (np.min(counts, initial=3), np.max(counts, initial=3)):
        if not 3 <= count <= CORNERS:
            raise MeshError(
                f"has a face of {count} corners, where 3 to {CORNERS} are due; "
                "copy it again, or triangulate it on export"
            )


def placed_parts(loaded: dict[str, Any], folder: Folder) -> Iterator[Part]:
    """The triangle geometries that a reader gives, where the file's scene graph puts them."""
    geometries = loaded.get("geometry", {"": loaded})
    placed = _placed(loaded["graph"]) if "graph" in loaded else ((np.eye(4), n) for n in geometries)
    triangles = 0
    for matrix, name in placed:
        if geometries[name].get("faces") is not None:
            part = _part(geometries[name], matrix, folder.material)
            triangles += len(part.faces)
            folder.limits.check_count(triangles=triangles)
            yield part


def _placed(graph: Iterable[dict[str, Any]]) -> Iterator[tuple[np.ndarray, str]]:
    """Where each geometry is, and its name; trimesh gives parents before their children.

    trimesh's own `SceneGraph` goes back to the root for every node: hours in a deep file.
    """
    from trimesh.scene.transforms import DEFAULT_BASE_FRAME

    frames = {DEFAULT_BASE_FRAME: np.eye(4)}
    for edge in graph:
        parent = frames[edge.get("frame_from", DEFAULT_BASE_FRAME)]
        frames[edge["frame_to"]] = matrix = parent @ edge.get("matrix", np.eye(4))
        if "geometry" in edge:
            yield matrix, edge["geometry"]


def _part(geometry: dict[str, Any], matrix: np.ndarray, cover: Material | None) -> Part:
    vertices = np.asarray(geometry["vertices"], dtype=np.float64)
    faces = geometry["faces"]
    check_corners(np.shape(faces)[1:] if np.ndim(faces) > 1 else np.array([len(f) for f in faces]))
    if np.ndim(faces) != 2 or np.shape(faces)[1] != 3:
        from trimesh.geometry import triangulate_quads

        faces = triangulate_quads(faces).reshape(-1, 3)
    faces = np.asarray(faces).astype(np.int64, copy=False)  # a PLY file may have them as floats
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise MeshError(f"a face names a vertex that is none of its {len(vertices)}; export again")

    if np.linalg.det(matrix[:3, :3]) == 0:
        raise MeshError("a node of its scene has no size along an axis; correct its scale")

    material = cover or geometry.get("material", Material())
    visual = geometry.get("visual")
    uv = geometry.get("corner_uv")
    if uv is None and visual is not None and visual.uv is not None:
        if np.shape(visual.uv) != (len(vertices), 2):
            raise MeshError(
                f"has texture coordinates of shape {np.shape(visual.uv)} for {len(vertices)} "
                "vertices; export it again"
            )
        uv = np.asarray(visual.uv).astype(np.float32)[faces]
    colors = geometry.get("vertex_colors")
    if colors is None and visual is not None:
        colors = visual.vertex_attributes.get("color")
    if material.texture is not None:
        colors = None
        if uv is None:
            raise MeshError("has a texture but no texture coordinates for it; unwrap it again")
    elif colors is None and geometry.get("face_colors") is not None:
        colors = _face_colors_at_vertices(geometry["face_colors"], faces, len(vertices))
    if colors is not None:
        colors = _vertex_colors(colors, geometry.get("linear_factor"))

    normals = geometry.get("vertex_normals")
    if normals is None or np.shape(normals) != vertices.shape:
        normals = np.zeros_like(vertices)
    linear_map = matrix[:3, :3]
    normals = np.nan_to_num(normals) @ np.linalg.inv(linear_map)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.nan_to_num(normals / np.where(length > 0, length, 1), posinf=0, neginf=0)
    if np.linalg.det(linear_map) < 0:  # a mirror turns faces inside out
        faces, uv = faces[:, ::-1], None if uv is None else uv[:, ::-1]
    vertices = vertices @ linear_map.T + matrix[:3, 3]
    if len(vertices) > faces.size:  # parts that share one list of vertices would each keep all
        used, faces = np.unique(faces, return_inverse=True)
        faces = faces.reshape(-1, 3)
        vertices, normals = vertices[used], normals[used]
        colors = None if colors is None else colors[used]
    return Part(vertices, faces, normals, uv, colors, material)


def _vertex_colors(colors: np.ndarray, linear_factor: np.ndarray | None) -> np.ndarray:
    """(N, 3) uint8 sRGB from (N, 3 or 4) of any type.

    Args:
        colors: linear light where there is a `linear_factor`, else sRGB.
        linear_factor: (3,) multiplies linear light.
    """
    values = np.asarray(colors)[:, :3]
    full = 65535 if values.dtype == np.uint16 else 255
    if values.dtype.kind == "f" and values.max(initial=0) <= 1:
        full = 1
    values = np.clip(np.nan_to_num(values / full), 0, 1)
    if linear_factor is not None:
        values = linear_to_srgb(values * linear_factor)
    return np.round(values * 255).astype(np.uint8)


def _face_colors_at_vertices(colors: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """(count, 3): at each vertex the mean colour of its faces."""
    if len(colors) != len(faces):
        raise MeshError("gives colours to polygons; triangulate it and export it again")
    uses = np.maximum(np.bincount(faces.ravel(), minlength=count), 1)
    channels = np.repeat(np.asarray(colors, dtype=np.float64)[:, :3], 3, axis=0).T
    sums = [np.bincount(faces.ravel(), weights=channel, minlength=count) for channel in channels]
    return np.round(np.stack(sums, axis=1) / uses[:, None]).astype(np.uint8)
