"""OBJ files."""

from __future__ import annotations

import re
from collections import defaultdict
from types import SimpleNamespace
from typing import Any

import numpy as np
from trimesh.exchange.obj import load_obj

from subjects.limits import Limits
from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.mtl import read_mtl
from subjects.meshfile.part import check_corners

_BLOCK = 10_000  # faces whose corners are looked at together


def read_obj(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of an OBJ file as trimesh gives them, each with its "material".

    Faces that name no material take the MTL's one where it has no other: many scanners write no
    usemtl. trimesh's own materials are not used: it drops all of a file's silently when a texture
    is missing or `Kd` is one number, as in THuman2.0. It is told their names only.
    """
    text = data.decode("utf-8", errors="replace")
    # with a literal beginning the searches for lines take no time
    text = f"\n{text}\n".replace("\r\n", "\n").replace("\\\n", "")
    _check_faces(text, folder.limits)
    libraries = {name.strip() for name in re.findall(r"\nmtllib[ \t]+(\S.*)", text)}
    if folder.material is not None:
        libraries = set()
    used = {name.strip() for name in re.findall(r"\nusemtl[ \t]+(\S.*)", text)}
    if len(libraries) > 1:
        raise MeshError(f"names {len(libraries)} material files; join them into one")
    materials = {} if not libraries else read_mtl(min(libraries), folder)
    if len(materials) > 1 and not used:
        raise MeshError(
            f"uses none of the {len(materials)} materials of '{min(libraries)}'; "
            "add usemtl lines, or leave one material there"
        )
    if libraries and used - set(materials):
        raise MeshError(
            f"uses material '{min(used - set(materials))}', which '{min(libraries)}' does not "
            "define; define it there or export both files again"
        )
    names = "\n".join(f"newmtl {name}" for name in materials)
    stream = SimpleNamespace(read=lambda: text)  # StringIO takes four bytes a letter
    loaded = load_obj(stream, defaultdict(lambda: names), skip_materials=not materials)
    default = next(iter(materials.values())) if len(materials) == 1 else Material()
    for geometry in loaded.get("geometry", {}).values():
        visual = geometry["visual"]
        named = None if visual is None else materials.get(visual.material.name)
        geometry["material"] = named or default
    return loaded


def _check_faces(text: str, limits: Limits) -> None:
    """MeshError where faces name what the file does not hold.

    trimesh takes index 0 for 1, counts from the file's end where an index is negative, and goes
    without texture coordinates and normals where one of them is missing.
    """
    held = {key: text.count(f"\n{key} ") for key in ("v", "vt", "vn")}
    limits.check_count(vertices=max(held.values()), triangles=text.count("\nf "))
    lines = re.findall(r"\nf([^\n]*)", text)
    triangles, negative = 0, False
    only_vt = only_vn = False
    for start in range(0, len(lines), _BLOCK):
        block = lines[start : start + _BLOCK]
        indices, given, corners = _indices("\n".join(["", *block]))
        check_corners(corners)
        triangles += indices.shape[1] - 2 * len(block)
        negative = negative or bool((indices < 0).any())
        for (key, count), named, has in zip(held.items(), indices, given, strict=True):
            bad = has & ((named == 0) | (named > count) | (named < -count))
            if bad.any():
                raise MeshError(
                    f"a face names {key} {named[bad][0]}, but there are {count}, "
                    "counted from 1; export it again"
                )
        _, has_vt, has_vn = given
        only_vt = only_vt or bool((has_vt & ~has_vn).any())
        only_vn = only_vn or bool((has_vn & ~has_vt).any())
    limits.check_count(triangles=triangles)
    if only_vt and only_vn:  # trimesh takes both for what the first is
        raise MeshError("mixes faces of v/vt with faces of v//vn; export it again with both")
    if negative and text.rfind("\nv") > text.find("\nf"):
        raise MeshError(
            "has negative indices and vertices after its first face; "
            "export it again with indices from 1"
        )


def _indices(corners: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(3, n) int, v, vt and vn of each corner, and (3, n) bool, where it has them; corners a face.

    Args:
        corners: as in an OBJ file, "v", "v/vt", "v//vn" or "v/vt/vn", with blanks before each and
            a line feed before each face.
    """
    letters = np.frombuffer(corners.encode(), dtype=np.uint8)
    slash, blank = letters == ord("/"), letters <= ord(" ")
    gap = slash | blank
    number = np.flatnonzero(~gap & np.roll(gap, 1))
    starts = ~blank & np.roll(blank, 1)
    corner = np.cumsum(starts, dtype=np.int32)[number] - 1
    line = np.cumsum(letters == ord("\n"), dtype=np.int32)
    faces = np.bincount(line[starts] - 1, minlength=line[-1])
    slashes = np.cumsum(slash, dtype=np.int32)[number]
    first = np.flatnonzero(np.diff(corner, prepend=-1))
    place = slashes - slashes[first][corner]
    found = np.fromstring(corners.replace("/", " "), sep=" ", dtype=np.int64)
    indices = np.zeros((3, len(first)), dtype=np.int64)
    given = np.zeros(indices.shape, dtype=bool)
    indices[place, corner] = found
    given[place, corner] = True
    return indices, given, faces
