"""STL files."""

from __future__ import annotations

import io
from typing import Any

from trimesh.exchange.stl import load_stl, load_stl_binary

from subjects.meshfile.folder import Folder


def read_stl(data: bytes, folder: Folder) -> dict[str, Any]:
    """The triangles of an STL file, in ASCII or binary, as trimesh gives them."""
    is_text = data.lstrip()[:5].lower() == b"solid"
    return (load_stl if is_text else load_stl_binary)(io.BytesIO(data))
