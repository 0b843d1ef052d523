"""A surface on disk: OBJ, PLY, glTF and STL files read into a `Mesh`."""

from __future__ import annotations

import base64
import io
import json
import re
import struct
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any
from urllib.parse import unquote

import numpy as np
from PIL import Image
from trimesh.exchange.gltf import load_glb, load_gltf
from trimesh.exchange.obj import load_obj
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl, load_stl_binary
from trimesh.geometry import triangulate_quads
from trimesh.scene.transforms import SceneGraph
from trimesh.visual.material import PBRMaterial

from subjects.mesh import Material, Mesh, MeshError

TEXTURE_PIXELS = 16384 * 16384
"""The largest texture that is decoded; a small file can claim any size."""

NORMAL_TOLERANCE = 1e-3
"""Unit normals nearer than this are one normal: text files round theirs."""

DISAGREEING_EDGES = 0.01
"""Share of two-faced edges whose faces may run in opposite senses; scans have some flaws."""

OPEN_EDGES = 0.01
"""A mesh with a smaller share of one-faced edges is closed enough for its volume to have a sign."""

# What a file may require without its geometry or base colour being misread.
_GLTF_EXTENSIONS = re.compile(r"KHR_materials_\w+|KHR_lights_punctual|EXT_texture_webp")


def read_mesh(path: Path) -> Mesh:
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

    Raises:
        MeshError: the file or one that it names is missing, outside the folder, unreadable or
            truncated, or the mesh is not a surface; one line that names the file and the cure.
    """
    return read_mesh_and_files(path)[0]


def read_mesh_and_files(path: Path) -> tuple[Mesh, tuple[Path, ...]]:
    """`read_mesh`, and the further files it was read from, relative to the mesh's folder."""
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in EXTENSIONS:
        raise MeshError(
            f"{path}: '{path.suffix}' is no known mesh format; "
            f"convert it to one of {', '.join(EXTENSIONS)}"
        )
    folder = _Folder(path.parent)
    try:
        mesh = _mesh(path.read_bytes(), kind, folder)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except OSError as error:
        raise MeshError(
            f"{path}: cannot be opened ({error.strerror or error}); check the path and its rights"
        ) from None
    except Exception as error:  # a parser meets damage in too many ways to list
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise MeshError(
            f"{path}: is damaged, truncated or no {kind[1:].upper()} file ({reason}); "
            "copy or export it again"
        ) from error
    return mesh, tuple(sorted(folder.opened))


def check_winding(mesh: Mesh, *, flip_faces: bool = False) -> None:
    """Refuse a surface whose faces do not all look outwards.

    Args:
        mesh: the surface as its file has it.
        flip_faces: check the surface as it is once its faces are flipped.

    Raises:
        MeshError: more than `DISAGREEING_EDGES` of the edges have faces of opposite senses, or
            the mesh is closed enough to have a volume and the volume is negative.
    """
    lowest, highest = mesh.bounds
    vertices = mesh.vertices - (lowest + highest) / 2
    faces = _first_alike(vertices)[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]

    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    order = np.argsort(key)
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    uses = np.diff(first, append=len(key))
    sense = np.add.reduceat(np.where(start < end, 1, -1)[order], first)

    shared = uses == 2
    disagree = np.count_nonzero(sense[shared]) / max(np.count_nonzero(shared), 1)
    if disagree > DISAGREEING_EDGES:
        raise MeshError(
            f"at {disagree:.1%} of its edges the two faces wind in opposite senses; "
            "make its normals consistent and export it again"
        )
    corners = vertices[faces]
    volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    if flip_faces:
        volume = -volume
    if np.mean(uses == 1) < OPEN_EDGES and volume < 0:
        raise MeshError(
            f"inside out (its signed volume is {volume:.3g}); "
            f"set subjects flip_faces: {str(not flip_faces).lower()}"
        )


class _Folder:
    """The files a mesh may name, as trimesh asks for them: those in its folder or below.

    trimesh's own resolver resolves links before it compares paths, so it refuses the linked
    textures of a linked mesh.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.opened: set[Path] = set()

    def get(self, name: str) -> bytes:
        name = name.strip().strip('"')
        below = PurePosixPath(name.replace("\\", "/"))
        if below.is_absolute() or PureWindowsPath(name).drive or ".." in below.parts:
            raise MeshError(
                f"names '{name}', which is outside its folder; "
                "put that file beside the mesh and name it by a relative path"
            )
        try:
            data = (self.path / below).read_bytes()
        except OSError as error:
            raise MeshError(
                f"names '{name}', which cannot be opened ({error.strerror}); "
                "put that file there, or correct the name where it is referred to"
            ) from None
        self.opened.add(Path(below))
        return data

    __getitem__ = get


@dataclass(eq=False)
class _Part:
    """One geometry of a file, in the file's coordinates."""

    vertices: np.ndarray  # (N, 3)
    faces: np.ndarray  # (F, 3)
    normals: np.ndarray  # (N, 3), zero where the file gives none
    uv: np.ndarray | None  # (N, 2)
    colors: np.ndarray | None  # (N, 3) uint8 sRGB
    material: Material


def _mesh(data: bytes, kind: str, folder: _Folder) -> Mesh:
    with _images_bounded(), warnings.catch_warnings():
        # numpy only warns when it stops in the middle of a text that is no number
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        loaded = _LOADERS[kind](data, folder)
        parts = list(_parts(loaded, linear=kind in (".glb", ".gltf")))
    if not parts:
        raise MeshError("holds no surface, only points or nothing; export its triangles")
    return _joined(parts)


def _load_obj(data: bytes, folder: _Folder) -> dict[str, Any]:
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
    materials = {} if not libraries else _read_mtl(min(libraries), folder)
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


def _read_mtl(library: str, folder: _Folder) -> dict[str, Material]:
    """The materials of an MTL file by name: their `Kd` and `map_Kd`."""
    materials: dict[str, Material] = {}
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
                materials[name] = replace(materials[name], color=(red, green, blue))
            elif key.lower() == "map_kd":
                texture = _texture(folder.get(value), value)
                materials[name] = replace(materials[name], texture=texture)
        except (KeyError, ValueError) as error:
            if isinstance(error, MeshError):
                raise
            raise MeshError(
                f"names '{library}', whose line '{line.strip()}' cannot be read; correct it there"
            ) from None
    return materials


def _load_ply(data: bytes, folder: _Folder) -> dict[str, Any]:
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
        loaded["material"] = Material(texture=_texture(folder.get(names[0]), names[0]))
    return loaded


def _load_gltf(data: bytes, folder: _Folder) -> dict[str, Any]:
    _check_gltf(json.loads(data), b"", folder)
    return _with_gltf_materials(load_gltf(io.BytesIO(data), folder))


def _load_glb(data: bytes, folder: _Folder) -> dict[str, Any]:
    (length,) = struct.unpack_from("<I", data, 12)
    _check_gltf(json.loads(data[20 : 20 + length]), data[28 + length :], folder)
    return _with_gltf_materials(load_glb(io.BytesIO(data), folder))


def _load_stl(data: bytes, folder: _Folder) -> dict[str, Any]:
    is_text = data.lstrip()[:5].lower() == b"solid"
    return (load_stl if is_text else load_stl_binary)(io.BytesIO(data))


_LOADERS: dict[str, Callable[[bytes, _Folder], dict[str, Any]]] = {
    ".obj": _load_obj,
    ".ply": _load_ply,
    ".glb": _load_glb,
    ".gltf": _load_gltf,
    ".stl": _load_stl,
}

EXTENSIONS = tuple(_LOADERS)
"""What `read_mesh` reads."""


def _check_gltf(header: dict[str, Any], binary: bytes, folder: _Folder) -> None:
    """Errors for compressed geometry and broken images, which trimesh leaves empty."""
    for extension in header.get("extensionsRequired", ()):
        if not _GLTF_EXTENSIONS.fullmatch(extension):
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
            content = _gltf_bytes(image["uri"], folder)
        else:
            view = header["bufferViews"][image["bufferView"]]
            buffer = header["buffers"][view["buffer"]]
            source = _gltf_bytes(buffer["uri"], folder) if "uri" in buffer else binary
            start = view.get("byteOffset", 0)
            content = source[start : start + view["byteLength"]]
        _open_image(content, image.get("name") or f"image {number}")


def _with_gltf_materials(loaded: dict[str, Any]) -> dict[str, Any]:
    """`loaded` with our `Material` as each geometry's "material", decoded once."""
    materials: dict[int, Material] = {}
    for geometry in loaded["geometry"].values():
        if geometry.get("visual") is not None:
            material = geometry["visual"].material
            if id(material) not in materials:
                materials[id(material)] = _gltf_material(material)
            geometry["material"] = materials[id(material)]
            geometry["factor"] = material.baseColorFactor
    return loaded


def _gltf_material(material: PBRMaterial) -> Material:
    factor = material.baseColorFactor
    color = np.ones(3) if factor is None else factor[:3] / 255
    if material.baseColorTexture is None:
        red, green, blue = _srgb(color)
        return Material((red, green, blue))
    texture = _pixels(material.baseColorTexture, material.name or "texture")
    if (color < 1).any():
        curve = _srgb(_linear(np.arange(256) / 255)[:, None] * color)
        curve = np.round(curve * 255).astype(np.uint8)
        texture = np.stack([curve[texture[..., i], i] for i in range(3)], axis=-1)
    return Material(texture=texture)


def _gltf_bytes(uri: str, folder: _Folder) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return folder.get(unquote(uri))


@contextmanager
def _images_bounded() -> Iterator[None]:
    """Within, Pillow refuses images of more than `TEXTURE_PIXELS`."""
    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = TEXTURE_PIXELS
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def _texture(content: bytes, name: str) -> np.ndarray:
    """(h, w, 3) uint8 of an image file's content."""
    return _pixels(_open_image(content, name), name)


def _open_image(content: bytes, name: str) -> Image.Image:
    """The image, not decoded yet, after a check that it can become a texture."""
    try:
        image = Image.open(io.BytesIO(content))
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise MeshError(
            f"its texture '{name}' has more than {TEXTURE_PIXELS} pixels; scale it down"
        ) from None
    except Exception:
        raise MeshError(
            f"its texture '{name}' is no readable image; export it again as PNG or JPEG"
        ) from None
    if image.mode.startswith(("I", "F")):
        raise MeshError(f"its texture '{name}' has {image.mode} pixels; save it as 8-bit RGB")
    return image


def _pixels(image: Image.Image, name: str) -> np.ndarray:
    """(h, w, 3) uint8, alpha left out."""
    try:
        return np.asarray(image.convert("RGB"))
    except Exception as error:
        raise MeshError(
            f"its texture '{name}' cannot be decoded ({error}); copy or export it again"
        ) from None


def _parts(loaded: dict[str, Any], linear: bool) -> Iterator[_Part]:
    """The triangle geometries of a file, where its scene graph puts them."""
    geometries = loaded.get("geometry", {"": loaded})
    if "graph" in loaded:
        graph = SceneGraph()
        for edge in loaded["graph"]:
            graph.update(**edge)
        placed = [graph[node] for node in graph.nodes_geometry]
    else:
        placed = [(np.eye(4), name) for name in geometries]
    for matrix, name in placed:
        if geometries[name].get("faces") is not None:
            yield _part(geometries[name], matrix, linear)


def _part(geometry: dict[str, Any], matrix: np.ndarray, linear: bool) -> _Part:
    vertices = np.asarray(geometry["vertices"], dtype=np.float64)
    faces = triangulate_quads(geometry["faces"]).reshape(-1, 3)
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise MeshError(f"a face names a vertex that is none of its {len(vertices)}; export again")

    material = geometry.get("material", Material())
    visual = geometry.get("visual")
    uv = None if visual is None else visual.uv
    colors = geometry.get("vertex_colors")
    if colors is None and visual is not None:
        colors = visual.vertex_attributes.get("color")
    if material.texture is not None:
        colors = None
        if uv is None:
            raise MeshError("has a texture but no texture coordinates for it; unwrap it again")
    elif colors is None and geometry.get("face_colors") is not None:
        colors = _face_colors_at_vertices(geometry["face_colors"], faces, len(vertices))
    if colors is not None:
        colors = _vertex_colors(colors, geometry.get("factor"), linear)

    normals = geometry.get("vertex_normals")
    if normals is None or np.shape(normals) != vertices.shape:
        normals = np.zeros_like(vertices)
    linear_map = matrix[:3, :3]
    normals = np.nan_to_num(normals) @ np.linalg.inv(linear_map)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(length > 0, length, 1)
    if np.linalg.det(linear_map) < 0:  # a mirror turns faces inside out
        faces = faces[:, ::-1]
    vertices = vertices @ linear_map.T + matrix[:3, 3]
    return _Part(vertices, faces, normals, uv, colors, material)


def _vertex_colors(colors: np.ndarray, factor: np.ndarray | None, linear: bool) -> np.ndarray:
    """(N, 3) uint8 sRGB from (N, 3 or 4) of any type; `factor` (4,) uint8 applies to linear."""
    values = np.asarray(colors)[:, :3]
    full = 65535 if values.dtype == np.uint16 else 255
    if values.dtype.kind == "f" and values.max(initial=0) <= 1:
        full = 1
    values = np.clip(np.nan_to_num(values / full), 0, 1)
    if linear:
        values = _srgb(values if factor is None else values * (factor[:3] / 255))
    return np.round(values * 255).astype(np.uint8)


def _face_colors_at_vertices(colors: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """(count, 3): at each vertex the mean colour of its faces."""
    if len(colors) != len(faces):
        raise MeshError("gives colours to polygons; triangulate it and export it again")
    uses = np.maximum(np.bincount(faces.ravel(), minlength=count), 1)
    channels = np.repeat(np.asarray(colors, dtype=np.float64)[:, :3], 3, axis=0).T
    sums = [np.bincount(faces.ravel(), weights=channel, minlength=count) for channel in channels]
    return np.round(np.stack(sums, axis=1) / uses[:, None]).astype(np.uint8)


def _srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light in [0, 1] encoded as sRGB (IEC 61966-2-1)."""
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )


def _linear(srgb: np.ndarray) -> np.ndarray:
    """The inverse of `_srgb`."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _joined(parts: list[_Part]) -> Mesh:
    """One mesh of all parts, with vertices at one place and of one normal made one."""
    vertices = np.concatenate([part.vertices for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    corners = np.concatenate(
        [part.faces + start for part, start in zip(parts, starts, strict=True)]
    )

    faces = _first_alike(vertices, normals)[corners]
    real = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not real.any():
        raise MeshError("has no faces with an area; export a surface, not a point cloud")
    faces, corners = faces[real], corners[real]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    faces = (np.cumsum(used) - 1)[faces]

    uv = None
    if any(part.uv is not None for part in parts):
        each = [np.zeros((len(part.vertices), 2)) if part.uv is None else part.uv for part in parts]
        uv = np.concatenate(each).astype(np.float32)[corners]
    materials = list({id(part.material): part.material for part in parts}.values())
    index = {id(material): i for i, material in enumerate(materials)}
    face_material = np.repeat(
        [index[id(part.material)] for part in parts], [len(part.faces) for part in parts]
    )[real]
    colors = _joined_colors(parts)
    return Mesh(
        vertices=vertices[used],
        faces=faces,
        uv=uv,
        materials=tuple(materials),
        face_material=face_material.astype(np.int32),
        vertex_colors=None if colors is None else colors[used],
    )


def _joined_colors(parts: list[_Part]) -> np.ndarray | None:
    """(N, 3) uint8 where any part has vertex colours; plain parts take their material's."""
    if all(part.colors is None for part in parts):
        return None
    if any(part.material.texture is not None for part in parts):
        raise MeshError("has textures and vertex colours in turn; bake them into one texture")
    plain = [np.round(np.asarray(part.material.color) * 255).astype(np.uint8) for part in parts]
    return np.concatenate(
        [
            np.broadcast_to(color, part.vertices.shape) if part.colors is None else part.colors
            for part, color in zip(parts, plain, strict=True)
        ]
    )


def _first_alike(places: np.ndarray, normals: np.ndarray | None = None) -> np.ndarray:
    """(N,) for each vertex the first at the same place, and of the same normal where given.

    Args:
        places: (N, 3) compared exactly.
        normals: (N, 3) unit or zero, compared to `NORMAL_TOLERANCE`.
    """
    pending = np.lexsort(places.T)
    ordered = places[pending]
    place = np.cumsum((ordered != np.roll(ordered, 1, axis=0)).any(axis=1))
    first = np.empty(len(places), dtype=np.int64)
    while len(pending):
        heads = np.diff(place, prepend=-1) != 0
        head = pending[heads][np.cumsum(heads) - 1]
        if normals is None:
            alike = np.ones(len(pending), dtype=bool)
        else:
            apart = normals[pending] - normals[head]
            alike = np.einsum("ni,ni->n", apart, apart) <= NORMAL_TOLERANCE**2
        first[pending[alike]] = head[alike]
        pending, place = pending[~alike], place[~alike]
    return first
