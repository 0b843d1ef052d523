"""PLY files."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.texture import decode_texture

HEADER = 100_000
"""Bytes within which a header ends."""

_LINE_ENDS = [end.encode() for end in "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"]


def read_ply(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometry of a PLY file as trimesh gives it, with its texture as "material"."""
    from trimesh.exchange.ply import load_ply

    end = data.find(b"end_header", 0, HEADER)
    if end < 0:
        raise MeshError("is no PLY file: its header has no end; copy or export it again")
    header = data[:end].decode("utf-8", errors="replace")
    _check_rows(header, data[end:], folder)
    names = re.findall(r"^comment[ \t]+texturefile[ \t]+(\S.*)", header, re.MULTILINE | re.I)
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
    _check_indices(loaded["metadata"]["_ply_raw"].get("face", {}).get("data", {}))
    if names and folder.material is None:
        name = names[0].strip()
        loaded["material"] = Material(texture=decode_texture(folder.get(name), name, folder))
    return loaded


def _check_rows(header: str, body: bytes, folder: Folder) -> None:
    """MeshError where the header claims more than the limits or the body says otherwise."""
    counts = {
        name: int(count)
        for name, count in re.findall(r"^element[ \t]+(\S+)[ \t]+(\d{1,18})\b", header, re.M)
    }
    for name, count in counts.items():
        folder.limits.check_count(**{"triangles" if name == "face" else "vertices": count})
    if counts.get("edge"):  # trimesh would put their vertices in place of the faces'
        raise MeshError("has edges beside its faces; export it without")
    if any("ascii" in line.lower() for line in header.split("\n")[1:2]):
        lines = sum(body.count(end) for end in _LINE_ENDS)
        if lines > 2 * sum(counts.values()) + 1000:  # every line costs an array
            raise MeshError(
                f"has {lines} lines for {sum(counts.values())} rows; copy or export it again"
            )


def _check_indices(faces: Any) -> None:
    """MeshError where a face's index is negative, which trimesh counts from the end."""
    names = faces.dtype.names if isinstance(faces, np.ndarray) else faces
    for name in {"vertex_index", "vertex_indices"}.intersection(names or ()):
        rows = faces[name]
        values = rows["f1"] if getattr(rows.dtype, "names", None) else rows
        if values.dtype == object:
            values = np.concatenate([np.ravel(row) for row in values])
        if values.size and values.min() < 0:
            raise MeshError(f"a face names vertex {int(values.min())}; export it again")
