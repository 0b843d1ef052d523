"""The files that a mesh's file names."""

from __future__ import annotations

import stat
from pathlib import Path, PurePosixPath, PureWindowsPath

from subjects.limits import Limits
from subjects.mesh import Material, MeshError


class Folder:
    """The files a mesh may name, as trimesh asks for them: those in its folder or below.

    trimesh's own resolver resolves links before it compares paths, so it refuses the linked
    textures of a linked mesh. Each file is read once.

    Attributes:
        material: covers the whole mesh in place of its own materials, which are not read then.
    """

    def __init__(self, path: Path, limits: Limits, material: Material | None = None) -> None:
        self.path = path
        self.limits = limits
        self.material = material
        self._contents: dict[Path, bytes] = {}
        self._size = 0
        self._pixels = 0

    @property
    def opened(self) -> tuple[Path, ...]:
        """The files that `get` has read, relative to the folder."""
        return tuple(sorted(self._contents))

    def get(self, name: str) -> bytes:
        """What the file of that name holds.

        Raises:
            MeshError: it is outside the folder, missing or too large.
        """
        name = name.strip().strip('"')
        below = PurePosixPath(name.replace("\\", "/"))
        if below.is_absolute() or PureWindowsPath(name).drive or ".." in below.parts:
            raise MeshError(
                f"names '{name}', which is outside its folder; "
                "put that file beside the mesh and name it by a relative path"
            )
        key = Path(below)
        if key not in self._contents:
            try:
                self._contents[key] = self.read(self.path / key)
            except (OSError, ValueError) as error:
                if isinstance(error, MeshError):
                    raise
                raise MeshError(
                    f"names '{name}', which cannot be opened "
                    f"({getattr(error, 'strerror', None) or error}); "
                    "put that file there, or correct the name where it is referred to"
                ) from None
        return self._contents[key]

    __getitem__ = get

    def read(self, path: Path) -> bytes:
        """What the file at `path` holds, counted to what is read for this mesh.

        Raises:
            MeshError: all that is read for this mesh would be too large.
            OSError: there is no such regular file; a pipe or a device has no end.
        """
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise OSError(0, "no regular file")
        self._size += status.st_size
        self.limits.check_megabytes(self._size, f"its files up to '{path.name}' hold")
        with path.open("rb") as file:
            return file.read(status.st_size)

    def count_pixels(self, pixels: int, name: str) -> None:
        """Count a texture about to be decoded; MeshError where all of them are too large."""
        self._pixels += pixels
        self.limits.check_pixels(self._pixels, name)
