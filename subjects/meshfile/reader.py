"""Any mesh file read into a `Mesh`."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from subjects.limits import Limits
from subjects.mesh import Material, Mesh, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.gltf import read_glb, read_gltf
from subjects.meshfile.joining import joined
from subjects.meshfile.obj import read_obj
from subjects.meshfile.part import placed_parts
from subjects.meshfile.ply import read_ply
from subjects.meshfile.stl import read_stl
from subjects.meshfile.texture import images_bounded

# What reads all but OBJ, trimesh, is imported where it is called: it takes as long to start as all
# the rest.
_READERS: dict[str, Callable[[bytes, Folder], dict[str, Any]]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".glb": read_glb,
    ".gltf": read_gltf,
    ".stl": read_stl,
}

EXTENSIONS = tuple(_READERS)
"""What `read_mesh` reads."""

DEFAULT = Limits()


def read_mesh(path: Path, limits: Limits = DEFAULT, material: Material | None = None) -> Mesh:
    """The surface in `path`, in the file's own coordinates and unit.

    All geometries of the file become one mesh, their scene transforms applied. Polygons are
    triangulated, faces that name a vertex twice dropped, unused vertices removed. Vertices at
    exactly one place are one vertex, unless the file gives them different normals: so a texture
    seam leaves shading smooth and an authored hard edge stays hard. Where such vertices have
    different colours, the first one's counts.

    Textures come before vertex colours, these before a material's colour. glTF colour factors
    and vertex colours are linear by its specification and are encoded to sRGB; an MTL's `Kd`
    is taken as sRGB. Alpha is ignored.

    Args:
        path: an .obj, .ply, .glb, .gltf or .stl file; materials and textures lie in its folder
            or below.
        limits: how large it may be.
        material: covers the whole surface in place of the file's own materials, which need not
            be there then.

    Raises:
        MeshError: the file or one that it names is missing, outside the folder, unreadable,
            truncated or above the limits, or the mesh is not a surface; one line that names the
            file and the cure.
    """
    return read_mesh_and_files(path, limits, material)[0]


def read_mesh_and_files(
    path: Path, limits: Limits = DEFAULT, material: Material | None = None
) -> tuple[Mesh, tuple[Path, ...]]:
    """`read_mesh`, and the further files it was read from, relative to the mesh's folder."""
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in EXTENSIONS:
        raise MeshError(
            f"{path}: '{path.suffix}' is no known mesh format; "
            f"convert it to one of {', '.join(EXTENSIONS)}"
        )
    folder = Folder(path.parent, limits, material)
    try:
        mesh = _mesh(folder.read(path), kind, folder)
    except MeshError as error:
        raise MeshError(f"{path}: {_one_line(error)}") from None
    except OSError as error:
        raise MeshError(
            f"{path}: cannot be opened ({error.strerror or error}); check the path and its rights"
        ) from None
    except Exception as error:  # a parser meets damage in too many ways to list
        reason = _one_line(error)[:120] or type(error).__name__
        raise MeshError(
            f"{path}: is damaged, truncated or no {kind[1:].upper()} file ({reason}); "
            "copy or export it again"
        ) from error
    return mesh, folder.opened


def _mesh(data: bytes, kind: str, folder: Folder) -> Mesh:
    with images_bounded(folder.limits), warnings.catch_warnings(), np.errstate(all="ignore"):
        # numpy only warns when it stops in the middle of a text that is no number
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        parts = list(placed_parts(_READERS[kind](data, folder), folder))
    if not parts:
        raise MeshError("holds no surface, only points or nothing; export its triangles")
    return joined(parts)


def _one_line(error: Exception) -> str:
    """What the error says, whatever a file's names bring into it."""
    line = "".join(letter if letter.isprintable() else " " for letter in str(error))
    return line if len(line) <= 600 else f"{line[:400]} ... {line[-200:]}"
