"""STL files."""

from __future__ import annotations

import io
import re
from typing import Any

from subjects.mesh import MeshError
from subjects.meshfile.folder import Folder

SOLIDS = 1000
"""Most solids of an ASCII file: naming them apart takes the square of their number."""


def read_stl(data: bytes, folder: Folder) -> dict[str, Any]:
    """The triangles of an STL file, in ASCII or binary, as trimesh gives them."""
    from trimesh.exchange.stl import load_stl, load_stl_binary

    folder.limits.check_count(triangles=(len(data) - 84) // 50)
    if data.lstrip()[:5].lower() != b"solid":
        return load_stl_binary(io.BytesIO(data))
    begun, ended = (
        len(re.findall(rb"^[ \t]*%b\b" % word, data, re.MULTILINE | re.IGNORECASE))
        for word in (b"solid", b"endsolid")
    )
    if begun and ended < begun and b"\0" not in data:
        raise MeshError(f"is truncated: {ended} of {begun} solids end; copy it again")
    if ended > SOLIDS:
        raise MeshError(f"has {ended} solids, more than {SOLIDS}; export it as one")
    return load_stl(io.BytesIO(data))
