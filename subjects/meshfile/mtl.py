"""MTL files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.texture import decode_texture


def read_mtl(library: str, folder: Folder) -> dict[str, Material]:
    """The materials of an MTL file by name: their `Kd` and `map_Kd`."""
    materials: dict[str, Material] = {}
    textures: dict[str, np.ndarray] = {}
    name = ""
    for line in folder.get(library).decode("utf-8", errors="replace").splitlines():
        key, value = (*line.split(maxsplit=1), "", "")[:2]
        value = value.strip()
        try:
            if key.lower() == "newmtl":
                name = " ".join(value.split())
                materials[name] = Material()
            elif key.lower() == "kd":
                red, green, blue = np.broadcast_to(np.array(value.split(), dtype=float), 3)
                if not np.isfinite([red, green, blue]).all():
                    raise ValueError("no colour")
                materials[name] = replace(materials[name], color=(red, green, blue))
            elif key.lower() == "map_kd":
                if value not in textures:
                    textures[value] = decode_texture(folder.get(value), value, folder)
                materials[name] = replace(materials[name], texture=textures[value])
        except (KeyError, ValueError) as error:
            if isinstance(error, MeshError):
                raise
            raise MeshError(
                f"names '{library}', whose line '{line.strip()}' cannot be read; correct it there"
            ) from None
    return materials
