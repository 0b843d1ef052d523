"""glTF files, as JSON with buffers beside it and as GLB."""

from __future__ import annotations

import base64
import io
import json
import struct
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from PIL.Image import Image

from subjects.color import linear_to_srgb, srgb_to_linear
from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.layout import check_layout
from subjects.meshfile.texture import open_image, pixels

if TYPE_CHECKING:
    from trimesh.visual.material import PBRMaterial

JSON_VALUES = 1_000_000
"""Most values in the JSON: each takes up to a hundred times its bytes, a scene a few hundred."""


class _Files:
    """The folder's files by URI, as glTF names them."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder

    def __getitem__(self, uri: str) -> bytes:
        return self.folder.get(unquote(uri))

    get = __getitem__

    def content(self, uri: str) -> bytes:
        """What the URI names or, as base64, holds."""
        _, found, data = uri.partition("base64,")
        return base64.b64decode(data) if found else self[uri]


def read_gltf(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of a .gltf file as trimesh gives them, each with its "material"."""
    from trimesh.exchange.gltf import load_gltf

    _check(_header(data), b"", folder)
    return _with_materials(load_gltf(io.BytesIO(data), _Files(folder)), folder)


def read_glb(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of a .glb file as trimesh gives them, each with its "material"."""
    from trimesh.exchange.gltf import load_glb

    if data[:4] != b"glTF":
        raise MeshError("is no GLB file: it does not begin with 'glTF'; export it again")
    whole, length = struct.unpack_from("<II", data, 8)
    if len(data) < whole:
        raise MeshError(f"is truncated ({len(data)} of {whole} bytes); copy it again")
    if length > len(data) - 20:
        raise MeshError(
            f"its JSON should have {length} bytes, {len(data) - 20} are left; copy it again"
        )
    binary = b""
    if len(data) >= 28 + length:
        size, kind = struct.unpack_from("<I4s", data, 20 + length)
        if kind == b"BIN\0":
            binary = data[28 + length : 28 + length + size]
    _check(_header(data[20 : 20 + length]), binary, folder)
    return _with_materials(load_glb(io.BytesIO(data), _Files(folder)), folder)


def _header(data: bytes) -> dict[str, Any]:
    values = sum(data.count(mark) for mark in (b",", b"[", b"{"))
    if values > JSON_VALUES:
        raise MeshError(f"its JSON has {values} values, more than {JSON_VALUES}; simplify it")
    header = json.loads(data)
    if not isinstance(header, dict):
        raise MeshError("its JSON is no glTF; export it again")
    return header


def _check(header: dict[str, Any], binary: bytes, folder: Folder) -> None:
    """Errors for a broken layout and for broken images, which trimesh leaves empty."""
    files = _Files(folder)
    buffers = [
        files.content(buffer["uri"]) if "uri" in buffer else binary
        for buffer in header.get("buffers", ())
    ]
    check_layout(header, [len(buffer) for buffer in buffers], folder.limits)
    opened: dict[Any, Image] = {}
    for number, image in enumerate(header.get("images", ())):
        source = image.get("uri", image.get("bufferView"))
        if source in opened:
            continue
        if "uri" in image:
            content = files.content(image["uri"])
        else:
            view = header["bufferViews"][image["bufferView"]]
            start = view.get("byteOffset", 0)
            content = buffers[view["buffer"]][start : start + view["byteLength"]]
        name = image.get("name") or f"image {number}"
        opened[source] = open_image(content, name, folder.limits)
    for material in header.get("materials", ()):
        # trimesh decodes what these materials name as it makes others of them
        glossy = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
        for value in glossy.values():
            if isinstance(value, dict) and opened:
                largest = max(image.width * image.height for image in opened.values())
                folder.count_pixels(largest, material.get("name") or "texture")


def _with_materials(loaded: dict[str, Any], folder: Folder) -> dict[str, Any]:
    """`loaded` with our `Material` as each geometry's "material", decoded once.

    Vertex colours are linear by glTF's specification and multiplied by the material's factor:
    each geometry's "linear_factor", (3,) in [0, 1], says both.
    """
    materials: dict[int, Material] = {}
    textures: dict[tuple, np.ndarray] = {}
    for geometry in loaded["geometry"].values():
        geometry["linear_factor"] = np.ones(3)
        if geometry.get("visual") is not None:
            material = geometry["visual"].material
            if id(material) not in materials:
                materials[id(material)] = _material(material, textures, folder)
            geometry["material"] = materials[id(material)]
            geometry["linear_factor"] = _factor(material)
    return loaded


def _material(material: PBRMaterial, textures: dict[tuple, np.ndarray], folder: Folder) -> Material:
    """Our `Material`; `textures` holds those made so far, by image and factor."""
    color = _factor(material)
    image = material.baseColorTexture
    if image is None:
        red, green, blue = linear_to_srgb(color)
        return Material((red, green, blue))
    key = (id(image), *color)
    if key not in textures:
        texture = pixels(image, material.name or "texture", folder)
        if (color < 1).any():
            curve = linear_to_srgb(srgb_to_linear(np.arange(256) / 255)[:, None] * color)
            curve = np.round(curve * 255).astype(np.uint8)
            texture = np.stack([curve[texture[..., i], i] for i in range(3)], axis=-1)
        textures[key] = texture
    return Material(texture=textures[key])


def _factor(material: PBRMaterial) -> np.ndarray:
    factor = material.baseColorFactor
    return np.ones(3) if factor is None else factor[:3] / 255
