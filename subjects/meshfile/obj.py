"""OBJ files."""

from __future__ import annotations

import io
import re
from collections import defaultdict
from typing import Any

from trimesh.exchange.obj import load_obj

from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.mtl import read_mtl


def read_obj(data: bytes, folder: Folder) -> dict[str, Any]:
    """trimesh's reading of the OBJ, with our `Material` as each geometry's "material".

    trimesh's own materials are not used: it drops all of a file's silently when a texture is
    missing or `Kd` is one number, as in THuman2.0. It is told their names only.
    """
    text = data.decode("utf-8", errors="replace")
    start = f"\n{text}"  # with a literal beginning the two searches take no time
    libraries = set(re.findall(r"\nmtllib[ \t]+(.*\S)", start))
    used = set(re.findall(r"\nusemtl[ \t]+(.*\S)", start))
    if len(libraries) > 1:
        raise MeshError(f"names {len(libraries)} material files; join them into one")
    materials = {} if not libraries else read_mtl(min(libraries), folder)
    if materials and not used:
        raise MeshError(f"uses no material of '{min(libraries)}'; add a usemtl line to it")
    if libraries and used - set(materials):
        raise MeshError(
            f"uses material '{min(used - set(materials))}', which '{min(libraries)}' does not "
            "define; define it there or export both files again"
        )
    names = "\n".join(f"newmtl {name}" for name in materials)
    loaded = load_obj(io.StringIO(text), defaultdict(lambda: names), skip_materials=not materials)
    for geometry in loaded.get("geometry", {}).values():
        if geometry["visual"] is not None:
            name = geometry["visual"].material.name
            geometry["material"] = materials.get(name, Material())
    return loaded
