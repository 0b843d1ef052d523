"""The files that a mesh's file names."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

from subjects.mesh import MeshError


class Folder:
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
