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
    header = data[: data.find(b"end_header")].decode("utf-8", errors="replace")
    names = re.findall(r"^comment\s+texturefile\s+(.*\S)", header, re.MULTILINE | re.IGNORECASE)
    if len(names) > 1:
        raise MeshError(f"has {len(names)} textures, a PLY file at most one; export it as GLB")
    loaded = load_ply(io.BytesIO(data), skip_materials=True)
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
