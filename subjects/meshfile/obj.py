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
    """The geometries of an OBJ file as trimesh gives them, each with its "material".

    Faces that name no material take the MTL's one where it has no other: many scanners write no
    usemtl. trimesh's own materials are not used: it drops all of a file's silently when a texture
    is missing or `Kd` is one number, as in THuman2.0. It is told their names only.
    """
    text = data.decode("utf-8", errors="replace")
    start = f"\n{text}"  # with a literal beginning the two searches take no time
    libraries = set(re.findall(r"\nmtllib[ \t]+(.*\S)", start))
    used = set(re.findall(r"\nusemtl[ \t]+(.*\S)", start))
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
    loaded = load_obj(io.StringIO(text), defaultdict(lambda: names), skip_materials=not materials)
    default = next(iter(materials.values())) if len(materials) == 1 else Material()
    for geometry in loaded.get("geometry", {}).values():
        visual = geometry["visual"]
        named = None if visual is None else materials.get(visual.material.name)
        geometry["material"] = named or default
    return loaded
