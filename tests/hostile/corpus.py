"""Broken and hostile subjects, made anew by every run of the tests.

Each case is one subject that a build has to set aside, and a word of the reason that it gives.
`meshes` are what a folder of scans may hold, `fits` what may lie beside sound scans as fits.
"""

from __future__ import annotations

import bz2
import gzip
import io
import json
import os
import pickle  # noqa: TID251
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

Files = dict[str, bytes | str]

CANARY = "canary"
"""The file that payloads would make, in the folder that holds the scans' folder."""

SECRETS = ("secret.mtl", "secret.png", "secret.bin")
"""Files there that path escapes lead to; each would do if it were read."""

SOUND = "sound"
"""The id of the sound subject among the hostile ones."""

TERABYTE = 10**12


@dataclass(frozen=True)
class Case:
    """One hostile subject.

    Attributes:
        id: that the build gives it.
        word: of the reason, what is wrong.
        write: puts its files into the scans' folder.
    """

    id: str
    word: str
    write: Callable[[Path], None]


def in_folder(name: str, word: str, files: Files) -> Case:
    """A case of files in a folder called `name`, in which the mesh has that name too."""

    def write(root: Path) -> None:
        for file, content in files.items():
            path = root / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content.encode() if isinstance(content, str) else content)

    return Case(name, word, write)


def with_file(
    name: str, word: str, files: Files, special: str, make: Callable[[Path], None]
) -> Case:
    """As `in_folder`, with one further file that `make` makes: a link, a pipe."""
    plain = in_folder(name, word, files)

    def write(root: Path) -> None:
        (root / name).mkdir()
        plain.write(root)
        make(root / name / special)

    return Case(name, word, write)


def ball() -> trimesh.Trimesh:
    """A person's rough outline, z up, in centimetres."""
    sphere = trimesh.creation.icosphere(subdivisions=2)
    return trimesh.Trimesh(sphere.vertices * [25, 18, 85], sphere.faces, process=False)


def image(kind: str, size: int = 8) -> bytes:
    """A small picture, encoded."""
    texels = (np.arange(size * size * 3) % 256).astype(np.uint8).reshape(size, size, 3)
    file = io.BytesIO()
    Image.fromarray(texels).save(file, kind)
    return file.getvalue()


def obj(
    materials: str | None = None, vertices: list[str] | None = None, faces: list[str] | None = None
) -> str:
    """The ball as OBJ text with one texture coordinate, or parts of it exchanged."""
    solid = ball()
    lines = [] if materials is None else [f"mtllib {materials}"]
    lines += vertices or ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in solid.vertices]
    lines += ["vt 0.5 0.5", *([] if materials is None else ["usemtl m"])]
    lines += faces or ["f {}/1 {}/1 {}/1".format(*(f + 1)) for f in solid.faces]
    return "\n".join(lines) + "\n"


def spoiled(coordinate: str) -> list[str]:
    """The ball's vertices with one coordinate replaced."""
    lines = ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in ball().vertices]
    lines[7] = f"v 1.0 {coordinate} 2.0"
    return lines


def textured(name: str, texture: str) -> Files:
    """OBJ and MTL of a mesh that names `texture`."""
    return {f"{name}.obj": obj("m.mtl"), "m.mtl": f"newmtl m\nmap_Kd {texture}\n"}


def export(kind: str, **how: Any) -> bytes:
    """The ball in another format."""
    return ball().export(file_type=kind, **how)


def flipped(data: bytes, *bits: tuple[int, int]) -> bytes:
    """`data` with a bit turned at each (byte, bit)."""
    changed = bytearray(data)
    for byte, bit in bits:
        changed[byte] ^= 1 << bit
    return bytes(changed)


def png_that_claims(width: int, height: int, rows: bytes = b"") -> bytes:
    """A PNG whose header says a size; `rows` is its compressed content."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + crc

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", rows or zlib.compress(b"")), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def deflated_zeros(count: int) -> bytes:
    """Zeros by the million, a thousandth as long."""
    compressor, million = zlib.compressobj(1), bytes(10**6)
    parts = [compressor.compress(million) for _ in range(count // 10**6)]
    return b"".join([*parts, compressor.compress(bytes(count % 10**6)), compressor.flush()])


def jpeg_that_claims(width: int, height: int) -> bytes:
    """A JPEG whose frame header says a size."""
    data = image("JPEG")
    frame = data.index(b"\xff\xc0")
    return data[: frame + 5] + struct.pack(">HH", height, width) + data[frame + 9 :]


def glb(change: Callable[[dict], None] = lambda header: None, binary: bytes | None = None) -> bytes:
    """The ball as GLB, its JSON changed, its buffer exchanged."""
    header, content = glb_parts(export("glb"))
    change(header)
    return glb_of(json.dumps(header).encode(), content if binary is None else binary)


def glb_parts(data: bytes) -> tuple[dict, bytes]:
    """JSON and buffer of a GLB file."""
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def glb_of(text: bytes, binary: bytes) -> bytes:
    """A GLB file of JSON and buffer."""
    text, binary = text + b" " * (-len(text) % 4), binary + bytes(-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def gltf(uri: str) -> str:
    """The ball as .gltf whose buffer lies at `uri`."""
    header, content = glb_parts(export("glb"))
    header["buffers"] = [{"byteLength": len(content), "uri": uri}]
    return json.dumps(header)


def gltf_image(uri: str) -> bytes:
    """The ball as GLB with a texture at `uri`."""

    def change(header: dict) -> None:
        header["images"] = [{"uri": uri}]
        header["textures"] = [{"source": 0}]
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    return glb(change)


def positions(value: float) -> bytes:
    """The ball as GLB with one coordinate replaced in its buffer."""
    header, content = glb_parts(export("glb"))
    primitive = header["meshes"][0]["primitives"][0]
    accessor = header["accessors"][primitive["attributes"]["POSITION"]]
    view = header["bufferViews"][accessor["bufferView"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0) + 12
    return glb(binary=content[:start] + struct.pack("<f", value) + content[start + 4 :])


def set_all(key: str, index: int, **values: Any) -> Callable[[dict], None]:
    """A change of a GLB's JSON: these values in entry `index` of the list `key`."""
    return lambda header: header[key][index].update(values)


def ply_ascii(header: dict[str, str] | None = None) -> str:
    """The ball as ASCII PLY, words of its header replaced."""
    text = export("ply", encoding="ascii").decode()
    for old, new in (header or {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    return text


def ply_binary(header: dict[str, str] | None = None) -> bytes:
    """The ball as binary PLY, words of its header replaced."""
    data = export("ply")
    for old, new in (header or {}).items():
        assert old.encode() in data
        data = data.replace(old.encode(), new.encode(), 1)
    return data


def polygon(corners: int) -> np.ndarray:
    """(corners, 3) on a circle as high as a person."""
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    return np.column_stack([40 * np.cos(angle), 0 * angle, 85 * np.sin(angle)])


def million_gon() -> str:
    """An OBJ of one face with a million corners."""
    vertices = map("v %.3f 0 %.3f".__mod__, map(tuple, polygon(1_000_000)[:, ::2].tolist()))
    return "\n".join(vertices) + "\n" + "f " + " ".join(map(str, range(1, 1_000_001))) + "\n"


def million_gon_ply() -> bytes:
    """A binary PLY of one face with a million corners."""
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 1000000\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list int int vertex_indices\nend_header\n"
    )
    face = np.arange(-1, 1_000_000, dtype="<i4")
    face[0] = 1_000_000
    return header.encode() + polygon(1_000_000).astype("<f4").tobytes() + face.tobytes()


def line_of_faces() -> str:
    """An OBJ all of whose faces have three places on one line, so no area."""
    vertices = [f"v 0 0 {z}" for z in range(0, 170, 10)]
    return obj(vertices=vertices, faces=[f"f {i}/1 {i + 1}/1 {i + 2}/1" for i in range(1, 16, 2)])


def make_pipe(path: Path) -> None:
    """A named pipe that nobody writes to."""
    os.mkfifo(path)


def link_to(target: str) -> Callable[[Path], None]:
    """What makes a link to `target`."""
    return lambda path: path.symlink_to(target)


def make_unreadable(path: Path) -> None:
    """A file that its owner may not read."""
    path.write_text(obj())
    path.chmod(0)


def _obj_cases() -> Iterator[Case]:
    sound = obj()
    half = sound.index("\nv ", len(sound) // 4)
    for name, word, text in (
        ("obj_empty", "no surface", ""),
        ("obj_cut_among_vertices", "no surface", sound[:half]),
        ("obj_cut_within_a_face", "a face of 2 corners", sound[: sound.rindex("/1 ")]),
        ("obj_bits_flipped", "damaged", flipped(sound.encode(), *((90 + i, 6) for i in range(9)))),
        ("obj_of_points", "no surface", "".join(f"v {i} 0 {i * 50}\n" for i in range(4))),
        ("obj_nan", "NaN or infinite", obj(vertices=spoiled("nan"))),
        ("obj_infinite", "NaN or infinite", obj(vertices=spoiled("-inf"))),
        ("obj_overflow", "NaN or infinite", obj(vertices=spoiled("1e999"))),
        ("obj_galaxy", "seems to lie", obj(vertices=spoiled("1e300"))),
        ("obj_nan_coordinates", "texture coordinates", sound.replace("vt 0.5", "vt nan")),
        ("obj_index_beyond", "a face names v 163", obj(faces=["f 1/1 2/1 163/1"])),
        ("obj_index_zero", "a face names v 0", obj(faces=["f 0/1 1/1 2/1"])),
        ("obj_index_negative", "a face names v -163", obj(faces=["f -163/1 1/1 2/1"])),
        ("obj_index_terabytes", "obj_index_terabytes.obj", obj(faces=[f"f 1/1 2/1 {'9' * 30}/1"])),
        ("obj_faces_of_one_place", "no faces with an area", obj(faces=["f 1/1 1/1 2/1"] * 5)),
        ("obj_faces_on_a_line", "nothing is seen", line_of_faces()),
        ("obj_million_gon", "1000000 corners", million_gon()),
        ("obj_utf16", "obj_utf16.obj", sound.encode("utf-16")),
        ("obj_of_zeros", "no surface", bytes(5000)),
        ("obj_that_is_a_picture", "no surface", image("JPEG")),
        ("obj_many_triangles", "subjects.limits.triangles", sound + "f 1 2 3\n" * 1_100_000),
    ):
        yield in_folder(name, word, {f"{name}.obj": text})


def _material_cases() -> Iterator[Case]:
    for name, word, library in (
        ("mtl_missing", "gone.mtl", "gone.mtl"),
        ("mtl_climbs", "outside its folder", "../../secret.mtl"),
        ("mtl_climbs_midway", "outside its folder", "a/../../../secret.mtl"),
        ("mtl_absolute", "outside its folder", "/etc/passwd"),
        ("mtl_of_a_drive", "outside its folder", "C:\\secret.mtl"),
        ("mtl_with_a_null", "cannot be opened", "m\0.mtl"),
        ("mtl_is_the_folder", "cannot be opened", "."),
    ):
        yield in_folder(name, word, {f"{name}.obj": obj(library)})
    for name, word, text in (
        ("mtl_cut_within_a_number", "'Kd 0.8 0.'", "newmtl m\nKd 0.8 0."),
        ("mtl_bits_flipped", "'Kd p/8 0.8 0.8'", "newmtl m\nKd p/8 0.8 0.8\n"),
        ("mtl_empty", "does not define", ""),
        ("mtl_infinite", "'Kd inf 0 0'", "newmtl m\nKd inf 0 0\n"),
    ):
        yield in_folder(name, word, {f"{name}.obj": obj("m.mtl"), "m.mtl": text})
    for name, word, texture in (
        ("texture_climbs", "outside its folder", "../../secret.png"),
        ("texture_climbs_by_windows", "outside its folder", "..\\..\\secret.png"),
        ("texture_absolute", "outside its folder", "/etc/passwd"),
        ("texture_missing", "gone.png", "gone.png"),
        ("texture_is_the_mesh", "no readable image", "texture_is_the_mesh.obj"),
    ):
        yield in_folder(name, word, textured(name, texture))


def _texture_cases() -> Iterator[Case]:
    jpeg, png = image("JPEG", 64), image("PNG", 64)
    for name, word, content in (
        ("jpeg_truncated", "cannot be decoded", jpeg[: len(jpeg) // 2]),
        ("jpeg_bits_flipped", "no readable image", flipped(jpeg, (0, 3), (1, 5), (2, 1))),
        ("jpeg_huge", "megapixels", jpeg_that_claims(65_000, 65_000)),
        ("png_truncated", "cannot be decoded", png[: len(png) // 2]),
        ("png_bits_flipped", "texture 'skin'", flipped(png, *((45 + 7 * i, 2) for i in range(9)))),
        ("png_huge", "megapixels", png_that_claims(2**31 - 1, 2**31 - 1)),
        (
            "png_bomb",
            "megapixels",
            png_that_claims(17_000, 17_000, deflated_zeros(17_000 * 51_001)),
        ),
        ("png_of_nothing", "cannot be decoded", png_that_claims(64, 64)),
        ("picture_empty", "no readable image", b""),
        ("picture_of_postscript", "no readable image", b"%!PS-Adobe-3.0 EPSF-3.0\n(w) run\n"),
        ("picture_of_entities", "no readable image", '<!DOCTYPE s [<!ENTITY a "a">]><svg>&a;'),
    ):
        yield in_folder(name, word, textured(name, "skin") | {"skin": content})
    for name, word, make in (
        ("texture_links_out", "no readable image", link_to("/etc/passwd")),
        ("texture_links_to_zeros", "no regular file", link_to("/dev/zero")),
        ("texture_links_to_itself", "cannot be opened", link_to("skin")),
        ("texture_is_a_pipe", "no regular file", make_pipe),
        ("texture_is_a_folder", "no regular file", Path.mkdir),
    ):
        yield with_file(name, word, textured(name, "skin"), "skin", make)


def _gltf_cases() -> Iterator[Case]:
    sound = export("glb")
    (length,) = struct.unpack_from("<I", sound, 12)
    node_cycle = {"children": [0], "mesh": 0}
    huge = set_all("accessors", 0, count=TERABYTE)
    for name, word, data in (
        ("glb_empty", "glTF", b""),
        ("glb_truncated_header", "glb_truncated_header.glb", sound[:11]),
        ("glb_truncated_json", "truncated", sound[:200]),
        ("glb_truncated_buffer", "truncated", sound[:-100]),
        ("glb_header_flipped", "glTF", flipped(sound, (1, 3))),
        ("glb_json_flipped", "damaged", flipped(sound, *((30 + i, 6) for i in range(9)))),
        ("glb_json_length_absurd", "JSON", sound[:12] + b"\xff" * 4 + sound[16:]),
        ("glb_json_endless", "values", glb_of(b"[" * 2_000_000, b"")),
        ("glb_json_deep", "damaged", glb_of(b"[" * 99_999 + b"]" * 99_999, b"")),
        ("glb_json_of_a_list", "no glTF", glb_of(b"[1, 2]", b"")),
        ("glb_count_terabytes", "accessors[0]", glb(huge)),
        ("glb_count_negative", "count", glb(set_all("accessors", 0, count=-3))),
        ("glb_view_beyond", "bufferViews", glb(set_all("bufferViews", 0, byteLength=TERABYTE))),
        ("glb_buffer_short", "bufferViews", glb(binary=b"1234")),
        ("glb_index_beyond", "names", glb(set_all("scenes", 0, nodes=[77]))),
        ("glb_nodes_in_a_ring", "twice", glb(set_all("nodes", 0, **node_cycle))),
        ("glb_nan", "NaN or infinite", positions(np.nan)),
        ("glb_infinite", "NaN or infinite", positions(-np.inf)),
        ("glb_uri_climbs", "outside its folder", gltf_image("../../secret.png")),
        ("glb_uri_climbs_quoted", "outside its folder", gltf_image("%2e%2e/%2e%2e/secret.png")),
        ("glb_uri_of_a_file", "cannot be opened", gltf_image("file:///etc/passwd")),
        ("glb_uri_of_the_web", "cannot be opened", gltf_image("https://localhost:9/a.png")),
    ):
        yield in_folder(name, word, {f"{name}.glb": data})
    for name, word, text in (
        ("gltf_empty", "damaged", ""),
        ("gltf_uri_climbs", "outside its folder", gltf("../../secret.bin")),
        ("gltf_uri_absolute", "outside its folder", gltf("/dev/zero")),
        ("gltf_base64_cut", "bufferViews", gltf("data:application/gltf;base64,AAAA")),
    ):
        yield in_folder(name, word, {f"{name}.gltf": text})
    # length is the JSON's own: the chunk's word for it alone is wrong
    shifted = sound[:12] + struct.pack("<I", length - 9) + sound[16:]
    yield in_folder("glb_json_length_off", "damaged", {"glb_json_length_off.glb": shifted})


def _ply_and_stl_cases() -> Iterator[Case]:
    binary, text, stl = ply_binary(), ply_ascii(), export("stl")
    vertices, faces = "element vertex 162", "element face 320"
    index = ply_ascii().rsplit("\n", 2)[0] + "\n3 0 1 -5\n"
    for name, word, data in (
        ("ply_empty", "header", b""),
        ("ply_without_end", "header", text.replace("end_header", "end_heade")),
        ("ply_truncated_text", "truncated", text[: len(text) // 2]),
        ("ply_truncated_binary", "truncated", binary[: len(binary) // 2]),
        ("ply_count_terabytes", "vertices", ply_ascii({vertices: f"element vertex {TERABYTE}"})),
        ("ply_count_of_30_digits", "vert", ply_binary({vertices: f"element vertex {'9' * 30}"})),
        ("ply_faces_terabytes", "triangles", ply_binary({faces: f"element face {TERABYTE}"})),
        ("ply_count_negative", "ply_count_neg", ply_ascii({vertices: "element vertex -162"})),
        ("ply_type_unknown", "ply_type_unknown.ply", ply_binary({"float x": "quad x"})),
        ("ply_list_terabytes", "ply_list_terabytes.ply", flipped(binary, (-320 * 13, 7))),
        ("ply_nan", "NaN or infinite", text.replace("0.00000000", "nan", 3)),
        ("ply_index_negative", "a face names vertex -5", index),
        ("ply_million_gon", "1000000 corners", million_gon_ply()),
        (
            "ply_texture_climbs",
            "outside its folder",
            ply_ascii({vertices: f"{_CLIMBING}{vertices}"}),
        ),
        ("stl_empty", "stl_empty.stl", b""),
        ("stl_header_alone", "stl_header_alone.stl", bytes(84)),
        ("stl_truncated", "stl_truncated.stl", stl[:-1000]),
        ("stl_count_absurd", "stl_count_absurd.stl", stl[:80] + b"\xff" * 4 + stl[84:]),
        ("stl_truncated_text", "truncated", export("stl_ascii")[:-200]),
        ("stl_nan", "NaN or infinite", stl[:100] + struct.pack("<f", np.nan) + stl[104:]),
    ):
        yield in_folder(name, word, {f"{name}.{name[:3]}": data})


_CLIMBING = "comment TextureFile ../../secret.png\n"


def _file_cases() -> Iterator[Case]:
    for name, word, make in (
        ("mesh_is_a_pipe", "no regular file", make_pipe),
        ("mesh_links_to_zeros", "no regular file", link_to("/dev/zero")),
        ("mesh_links_to_nothing", "cannot be opened", link_to("gone.obj")),
        ("mesh_links_to_itself", "cannot be opened", link_to("mesh_links_to_itself.obj")),
        ("mesh_links_out", "mesh_links_out.obj", link_to("/etc/passwd")),
    ):
        yield with_file(name, word, {}, f"{name}.obj", make)
    yield with_file(
        "body_is_a_pipe", "no regular file", {"body_is_a_pipe.obj": obj()}, "body.obj", make_pipe
    )
    yield with_file(
        "body_is_gone", "cannot be opened", {"body_is_gone.obj": obj()}, "body.obj", link_to("gone")
    )
    taken = textured("name_is_taken", "subject.json") | {"subject.json": image("PNG")}
    yield in_folder("name_is_taken", "taken", taken)
    if os.geteuid() != 0:  # root reads everything
        yield with_file(
            "mesh_is_unreadable", "rights", {}, "mesh_is_unreadable.obj", make_unreadable
        )


def _named_case(id: str, word: str, path: str | bytes) -> Case:
    """A sound mesh in a file of a hostile name, below the scans' folder."""

    def write(root: Path) -> None:
        file = root / os.fsdecode(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(obj())

    return Case(id, word, write)


def _name_cases() -> Iterator[Case]:
    yield _named_case("back_slash", "back\\\\slash", "back\\slash.obj")
    yield _named_case("climb_.._.._out", "climb", "climb\\..\\..\\out.obj")
    yield _named_case("line_break", "line\\nbreak", "line\nbreak.obj")
    yield _named_case("escape__31m", "escape\\x1b[31m", "escape\x1b[31m.obj")
    yield _named_case("turned_round", "\\u202e", "turned\u202eround.obj")
    yield _named_case("bytes__", "\\udcff", b"bytes\xff\xfe.obj")
    for parts in (["n" * 250, "n"], ["d" * 100, "e" * 100, "f" * 98]):
        yield _named_case("_".join(parts), "characters", f"{'/'.join(parts)}.obj")


class Payload:
    """Pickles as a call of `function`, which would make the canary."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> tuple:
        return self.call


PARAMETERS = {
    "betas": np.zeros(10),
    "body_pose": np.zeros((21, 3)),
    "global_orient": np.array([np.pi / 2, 0, 0]),
    "scale": np.array(100.0),
}
"""Of a sound fit, in the axes and the unit of `ball`."""


FITS = {
    "parameters": [f"{{folder}}/fit.{kind}" for kind in ("npz", "pkl", "json")],
    "mesh": ["{folder}/{name}_smplx.ply"],
    "similarity": "{folder}/similarity.json",
}
"""`subjects.fits` for `fits`."""


def npz(**members: bytes) -> bytes:
    """A zip of these members, deflated."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def npy(array: np.ndarray) -> bytes:
    """An array as an npy file, of objects too."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def npy_that_claims(shape: str, kind: str = "<f8", content: bytes = b"") -> bytes:
    """An npy file whose header says a shape and a type."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def _fit(name: str, word: str, kind: str, content: bytes | str) -> Case:
    """A sound scan with a hostile file of parameters."""
    files = {f"{name}.obj": obj(), f"{name}_smplx.ply": export("ply"), f"fit.{kind}": content}
    return in_folder(name, word, files)


def _npz_cases() -> Iterator[Case]:
    members = {name: npy(array) for name, array in PARAMETERS.items()}
    sound = npz(**members)
    claimed = flipped(sound, *((sound.rindex(b"PK\1\2") + 27, bit) for bit in range(7)))
    object_array = np.empty(3, dtype=object)
    object_array[1] = Payload(os.mkdir, CANARY)
    for name, word, data in (
        ("npz_empty", "no npz", b""),
        ("npz_truncated", "no npz", sound[:-30]),
        ("npz_bits_flipped", "truncated", flipped(sound, *((60 + i, 4) for i in range(9)))),
        ("npz_size_absurd", "fit_mb", claimed),
        ("npz_bomb", "fit_mb", npz(**members, zeros=bytes(64 * 2**20))),
        ("npz_shape_terabytes", "betas", npz(betas=npy_that_claims(f"({TERABYTE},)"))),
        ("npz_shape_negative", "betas", npz(betas=npy_that_claims("(-5, -2)", content=bytes(80)))),
        ("npz_header_torn", "betas", npz(betas=npy(np.zeros(10))[:40])),
        ("npz_header_of_code", "betas", npz(betas=npy_that_claims("__import__('os').abort()"))),
        ("npz_version_unknown", "betas", npz(betas=b"\x93NUMPY\x09\x00" + bytes(90))),
        ("npz_objects", "mkdir", npz(**members | {"expression": npy(object_array)})),
        ("npz_nan", "NaN or infinite", npz(**members | {"betas": npy(np.full(10, np.nan))})),
    ):
        yield _fit(name, word, "npz", data)


def _pickle_cases() -> Iterator[Case]:
    sound = pickle.dumps(PARAMETERS)
    for name, word, data in (
        ("pickle_empty", "truncated", b""),
        ("pickle_truncated", "truncated", sound[: len(sound) // 2]),
        ("pickle_bits_flipped", "pickle_bits_flipped", flipped(sound, (12, 6), (40, 7), (41, 5))),
        ("pickle_calls_mkdir", "mkdir", pickle.dumps(Payload(os.mkdir, CANARY))),
        ("pickle_calls_system", "system", pickle.dumps(Payload(os.system, f"touch {CANARY}"))),
        ("pickle_calls_eval", "eval", pickle.dumps(Payload(eval, f"open('{CANARY}', 'w')"))),
        ("pickle_calls_in_text", "system", f"cos\nsystem\n(S'touch {CANARY}'\ntR.".encode()),
        ("pickle_calls_deep", "getattr", pickle.dumps([{"betas": [Payload(getattr, 1, "real")]}])),
        ("pickle_calls_by_inst", "Popen", f"(S'touch {CANARY}'\nisubprocess\nPopen\n.".encode()),
        ("pickle_says_terabytes", "truncated", b"\x80\x04\x8e" + struct.pack("<Q", TERABYTE)),
        ("pickle_doubles", "fit_mb", _doubling(40)),
        ("pickle_nests", "levels deep", b"\x80\x04" + b"]" * 90_000 + b"a" * 89_999 + b"."),
        ("pickle_holds_itself", "levels deep", b"\x80\x04]\x94h\x00a."),
        ("pickle_of_a_list", "parameters by name", pickle.dumps([1, 2])),
        ("pickle_in_gzip_bomb", "fit_mb", gzip.compress(bytes(64 * 2**20))),
        ("pickle_in_bz2_bomb", "fit_mb", bz2.compress(bytes(64 * 2**20))),
        ("pickle_in_gzip_cut", "truncated", gzip.compress(sound)[:-20]),
        ("pickle_nan", "NaN or infinite", pickle.dumps(PARAMETERS | {"scale": np.nan})),
        ("pickle_of_infinite_size", "no size", pickle.dumps(PARAMETERS | {"scale": -1.0})),
    ):
        yield _fit(name, word, "pkl", data)


def _doubling(times: int) -> bytes:
    """A pickle of a tuple that holds the tuple before it twice, so many times over."""
    steps = [b"h" + bytes([i]) + b"h" + bytes([i]) + b"\x86\x94" for i in range(times)]
    return b"\x80\x04)\x94" + b"".join(steps) + b"."


def _json_cases() -> Iterator[Case]:
    values = {name: array.tolist() for name, array in PARAMETERS.items()}
    sound = json.dumps(values)
    for name, word, text in (
        ("json_empty", "no JSON", ""),
        ("json_truncated", "no JSON", sound[:-20]),
        ("json_bits_flipped", "json_bits_flipped", flipped(sound.encode(), (3, 3), (20, 6))),
        ("json_deep", "no JSON", "[" * 99_999 + "]" * 99_999),
        ("json_endless", "values", '{"betas": [' + "[]," * 4_000_000 + "[]]}"),
        ("json_nan", "NaN or infinite", sound.replace("0.0", "NaN", 1)),
        ("json_of_digits", "json_of_digits", sound.replace("0.0", "9" * 10_000, 1)),
    ):
        yield _fit(name, word, "json", text)


def _similarity_cases() -> Iterator[Case]:
    for name, word, make in (
        ("similarity_is_a_pipe", "it is no file", make_pipe),
        ("similarity_links_to_zeros", "it is no file", link_to("/dev/zero")),
        ("similarity_is_gone", "cannot be opened", link_to("gone")),
    ):
        files = {f"{name}.obj": obj(), f"{name}_smplx.ply": export("ply")}
        yield with_file(name, word, files, "similarity.json", make)


def sound_fit() -> Case:
    """A sound scan with a sound fit, as `FITS` says."""
    file = io.BytesIO()
    np.savez(file, **PARAMETERS)
    files: Files = {
        f"{SOUND}.obj": obj(),
        f"{SOUND}_smplx.ply": export("ply"),
        "fit.npz": file.getvalue(),
        "similarity.json": '{"scale": 1.0}',
    }
    return in_folder(SOUND, "", files)


def meshes() -> list[Case]:
    """Hostile scans."""
    groups = (
        *(_obj_cases, _material_cases, _texture_cases, _gltf_cases, _ply_and_stl_cases),
        *(_file_cases, _name_cases),
    )
    return [case for group in groups for case in group()]


def fits() -> list[Case]:
    """Sound scans with hostile fits, to be read as `FITS` says."""
    groups = (_npz_cases, _pickle_cases, _json_cases, _similarity_cases)
    return [case for group in groups for case in group()]
