"""glTF files, as JSON with buffers beside it and as GLB."""

from __future__ import annotations

import base64
import io
import json
import re
import struct
from typing import Any
from urllib.parse import unquote

import numpy as np
from trimesh.exchange.gltf import load_glb, load_gltf
from trimesh.visual.material import PBRMaterial

from subjects.color import linear_to_srgb, srgb_to_linear
from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.texture import open_image, pixels

# What a file may require without its geometry or base colour being misread.
_KNOWN_EXTENSIONS = re.compile(r"KHR_materials_\w+|KHR_lights_punctual|EXT_texture_webp")


def read_gltf(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of a .gltf file as trimesh gives them, each with its "material"."""
    _check(json.loads(data), b"", folder)
    return _with_materials(load_gltf(io.BytesIO(data), folder))


def read_glb(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of a .glb file as trimesh gives them, each with its "material"."""
    (whole,) = struct.unpack_from("<I", data, 8)
    if len(data) < whole:
        raise MeshError(f"is truncated ({len(data)} of {whole} bytes); copy it again")
    (length,) = struct.unpack_from("<I", data, 12)
    _check(json.loads(data[20 : 20 + length]), data[28 + length :], folder)
    return _with_materials(load_glb(io.BytesIO(data), folder))


def _check(header: dict[str, Any], binary: bytes, folder: Folder) -> None:
    """Errors for compressed geometry and broken images, which trimesh leaves empty."""
    for extension in header.get("extensionsRequired", ()):
        if not _KNOWN_EXTENSIONS.fullmatch(extension):
            raise MeshError(f"needs the glTF extension {extension}; export it without")
    for material in header.get("materials", ()):
        texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
        if texture.get("texCoord") or "KHR_texture_transform" in texture.get("extensions", ()):
            raise MeshError(
                f"moves the texture of material '{material.get('name', '')}' or has a second set "
                "of coordinates for it; bake them into the first set"
            )
    for number, image in enumerate(header.get("images", ())):
        if "uri" in image:
            content = _content(image["uri"], folder)
        else:
            view = header["bufferViews"][image["bufferView"]]
            buffer = header["buffers"][view["buffer"]]
            source = _content(buffer["uri"], folder) if "uri" in buffer else binary
            start = view.get("byteOffset", 0)
            content = source[start : start + view["byteLength"]]
        open_image(content, image.get("name") or f"image {number}")


def _with_materials(loaded: dict[str, Any]) -> dict[str, Any]:
    """`loaded` with our `Material` as each geometry's "material", decoded once.

    Vertex colours are linear by glTF's specification and multiplied by the material's factor:
    each geometry's "linear_factor", (3,) in [0, 1], says both.
    """
    materials: dict[int, Material] = {}
    for geometry in loaded["geometry"].values():
        geometry["linear_factor"] = np.ones(3)
        if geometry.get("visual") is not None:
            material = geometry["visual"].material
            if id(material) not in materials:
                materials[id(material)] = _material(material)
            geometry["material"] = materials[id(material)]
            geometry["linear_factor"] = _factor(material)
    return loaded


def _material(material: PBRMaterial) -> Material:
    color = _factor(material)
    if material.baseColorTexture is None:
        red, green, blue = linear_to_srgb(color)
        return Material((red, green, blue))
    texture = pixels(material.baseColorTexture, material.name or "texture")
    if (color < 1).any():
        curve = linear_to_srgb(srgb_to_linear(np.arange(256) / 255)[:, None] * color)
        curve = np.round(curve * 255).astype(np.uint8)
        texture = np.stack([curve[texture[..., i], i] for i in range(3)], axis=-1)
    return Material(texture=texture)


def _factor(material: PBRMaterial) -> np.ndarray:
    factor = material.baseColorFactor
    return np.ones(3) if factor is None else factor[:3] / 255


def _content(uri: str, folder: Folder) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return folder.get(unquote(uri))
