"""PLY files."""

from __future__ import annotations

import io
import re
from typing import Any

from trimesh.exchange.ply import load_ply

from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.texture import decode_texture


def read_ply(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometry of a PLY file as trimesh gives it, with its texture as "material"."""
    header = data[: data.find(b"end_header")].decode("utf-8", errors="replace")
    names = re.findall(r"^comment\s+texturefile\s+(.*\S)", header, re.MULTILINE | re.IGNORECASE)
    if len(names) > 1:
        raise MeshError(f"has {len(names)} textures, a PLY file at most one; export it as GLB")
    try:
        loaded = load_ply(io.BytesIO(data), skip_materials=True)
    except ValueError as error:
        if "unexpected length" not in str(error):
            raise
        # trimesh takes the first row's length of a binary list for every row's
        raise MeshError(
            "is not as long as its header and its first face say: it is truncated, or it mixes "
            "triangles with other polygons; copy it again, or triangulate it on export"
        ) from None
    # trimesh notices a binary file that is cut short, but not one in ASCII
    for element, content in loaded["metadata"]["_ply_raw"].items():
        rows = content.get("data", ())
        found = len(next(iter(rows.values()), ()) if isinstance(rows, dict) else rows)
        if found != content["length"]:
            raise MeshError(
                f"is truncated: {found} of {content['length']} {element} rows; copy it again"
            )
    if names:
        loaded["material"] = Material(texture=decode_texture(folder.get(names[0]), names[0]))
    return loaded
