"""The geometry of a mesh file, read without any of the code that the renderer's surface comes by.

An OBJ file is parsed by `shards.wavefront`. For PLY, glTF and STL files the parser is trimesh's, as
it is for the surfaces that are rendered.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from shards.wavefront import read_obj
from storage.files import open_file


def read_geometry(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (N, 3), triangles (F, 3) and the file's own normals (N, 3), 0 where it has none.

    Vertices that no face names are left out. The normals tell which vertices are one; their frame
    is their part's.

    Args:
        path: an OBJ file, or any other that trimesh reads.

    Raises:
        ValueError: if the file cannot be parsed or holds no triangles; one line that names it.
        OSError: if it cannot be opened, or is no regular file.
    """
    open_file(path).close()
    try:
        vertices, faces, normals = (read_obj if path.suffix.lower() == ".obj" else _read_any)(path)
    except Exception as error:  # a parser meets damage, and missing buffers, in too many ways
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ValueError(f"{path} is damaged or no surface ({reason})") from error
    if len(faces) == 0:
        raise ValueError(f"{path} holds no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"{path} is damaged: a face names a vertex that it does not have")
    used, faces = np.unique(faces, return_inverse=True)
    normals = np.where(np.isfinite(normals), normals, 0)
    return vertices[used], faces.reshape(-1, 3), normals[used]


def _read_any(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same by trimesh's parser, every part where the file's scene graph puts it."""
    import trimesh  # slow to start; an OBJ file does without
    from trimesh.resolvers import FilePathResolver

    # Of a file trimesh would allocate what a length in it claims, of bytes what is there.
    scene = trimesh.load_scene(
        io.BytesIO(path.read_bytes()),
        file_type=path.suffix[1:].lower(),
        resolver=FilePathResolver(path),
        process=False,
        skip_materials=True,
    )
    vertices, faces, normals = [np.empty((0, 3))], [np.empty((0, 3), int)], [np.empty((0, 3))]
    count = 0
    for node in scene.graph.nodes_geometry:
        placed, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh) or len(part.faces) == 0:
            continue
        # trimesh makes up the normals that a file lacks; only its cache tells which are given.
        given = "vertex_normals" in part._cache
        vertices.append(np.asarray(part.vertices) @ placed[:3, :3].T + placed[:3, 3])
        normals.append(np.array(part.vertex_normals) if given else np.zeros_like(vertices[-1]))
        faces.append(np.asarray(part.faces) + count)
        count += len(vertices[-1])
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals)
