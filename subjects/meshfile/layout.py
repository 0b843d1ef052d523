"""The layout of a glTF file: what its JSON says of buffers, meshes and nodes."""

from __future__ import annotations

import re
from typing import Any

from subjects.limits import Limits
from subjects.mesh import MeshError

PARTS = 10_000
"""Most primitives that nodes place; a scan has one, a dressed figure a few dozen."""

# What a file may require without its geometry or base colour being misread.
_KNOWN_EXTENSIONS = re.compile(r"KHR_materials_\w+|KHR_lights_punctual|EXT_texture_webp")

_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_FLOAT = 5126
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLE_FAN = 6
_READ = ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0", "indices")


def check_layout(header: dict[str, Any], buffers: list[int], limits: Limits) -> None:
    """Refuse what trimesh would misread, and what takes more memory than the file.

    Args:
        header: the file's JSON.
        buffers: bytes that each of its buffers holds.
        limits: what views and accessors may hold together.

    Raises:
        MeshError: compressed geometry, a moved texture, an index that names nothing, a view or
            an accessor beyond its bytes, nodes that are no tree.
    """
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
    _check_views(header, buffers, limits)
    _check_accessors(header, limits)
    for mesh in header.get("meshes", ()):
        for primitive in mesh["primitives"]:
            _check_primitive(header, primitive)
    _check_nodes(header)


def _named(header: dict[str, Any], key: str, index: Any) -> dict[str, Any]:
    """Entry `index` of the header's list `key`; Python would count a negative one from the end."""
    entries = header.get(key, [])
    if type(index) is not int or not 0 <= index < len(entries):
        raise MeshError(f"names {key}[{index}], but has {len(entries)} {key}; export it again")
    return entries[index]


def _whole(entry: dict[str, Any], key: str, default: int | None = None) -> int:
    """The whole number, not negative, that `entry` has as `key`."""
    value = entry.get(key, default)
    if type(value) is not int or value < 0:
        raise MeshError(f"has {value} for a {key}; export it again")
    return value


def _check_views(header: dict[str, Any], buffers: list[int], limits: Limits) -> None:
    total = 0
    for number, view in enumerate(header.get("bufferViews", ())):
        _named(header, "buffers", view.get("buffer"))
        end = _whole(view, "byteOffset", 0) + _whole(view, "byteLength")
        if end > buffers[view["buffer"]]:
            raise MeshError(
                f"bufferViews[{number}] ends at byte {end} of {buffers[view['buffer']]}; "
                "copy or export it again"
            )
        total += view["byteLength"]
        limits.check_megabytes(total, f"its buffer views up to bufferViews[{number}] hold")
    for image in header.get("images", ()):
        if "bufferView" in image:
            _named(header, "bufferViews", image["bufferView"])


def _check_accessors(header: dict[str, Any], limits: Limits) -> None:
    total = 0
    for number, accessor in enumerate(header.get("accessors", ())):
        kind, components = accessor.get("componentType"), accessor.get("type")
        if kind not in _COMPONENT_BYTES or components not in _COMPONENTS:
            raise MeshError(f"accessors[{number}] is of unknown type; export it again")
        row = _COMPONENT_BYTES[kind] * _COMPONENTS[components]
        count = _whole(accessor, "count")
        total += count * row
        limits.check_megabytes(total, f"its accessors up to accessors[{number}] claim")
        if "bufferView" in accessor:
            view = _named(header, "bufferViews", accessor["bufferView"])
            stride = _whole(view, "byteStride", row)
            end = _whole(accessor, "byteOffset", 0) + max(count - 1, 0) * stride + row
            if count < 1 or stride < 1 or end > view["byteLength"]:
                raise MeshError(
                    f"accessors[{number}] has {count} rows to byte {end} of its view's "
                    f"{view['byteLength']}; copy or export it again"
                )


def _check_primitive(header: dict[str, Any], primitive: dict[str, Any]) -> None:
    if primitive.get("mode") == _TRIANGLE_FAN:
        raise MeshError("draws triangle fans; export it as triangles")
    named = dict(primitive["attributes"])
    if "indices" in primitive:
        named["indices"] = primitive["indices"]
    for name, index in named.items():
        accessor = _named(header, "accessors", index)
        if "sparse" in accessor and name in _READ:
            raise MeshError(f"has a sparse accessor for {name}; export it without")
        if name == "TEXCOORD_0" and accessor["componentType"] != _FLOAT:
            raise MeshError("has texture coordinates that are no floats; export them as floats")
    if "material" in primitive:
        _named(header, "materials", primitive["material"])


def _check_nodes(header: dict[str, Any]) -> None:
    """Nodes as a forest: then walking it ends, and everything is placed once."""
    parts = 0
    seen: set[int] = set()
    for number in [header.get("scene", 0)] if "scenes" in header else []:
        pending = list(_named(header, "scenes", number).get("nodes", ()))
        while pending:
            index = pending.pop()
            node = _named(header, "nodes", index)
            if index in seen:
                raise MeshError(
                    f"has nodes[{index}] twice in its scene or within itself; export it again"
                )
            seen.add(index)
            pending.extend(node.get("children", ()))
            if "mesh" in node:
                parts += len(_named(header, "meshes", node["mesh"])["primitives"])
    if parts > PARTS:
        raise MeshError(f"has {parts} parts, more than {PARTS}; join them on export")
