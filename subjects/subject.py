"""A subject: one person's surface, where it lies and how it becomes metres."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from subjects.limits import Limits
from subjects.mesh import Material, Mesh
from subjects.meshfile import read_mesh, read_texture


@dataclass(frozen=True, eq=False)
class Subject:
    """What a source hands to the renderer: files and a similarity.

    Attributes:
        id: unique in the dataset; letters, digits, '.', '_', '-'.
        source: the name of the source that made it, e.g. "open".
        licence: SPDX identifier or the licence's name; goes into every shard and the card.
        mesh: the surface's file.
        mesh_to_world: (4, 4) similarity from the file's coordinates to the subject's world
            (metres, y up, facing +z, feet near y = 0, vertical axis through the body).
        body: file of the parametric body in the same coordinates as the mesh, or None.
        body_parameters: what made the body, JSON-ready.
        texture: an image that covers the surface in place of the mesh's own materials, or None.
        files: further files that belong to the surface (materials, textures).
        flip_faces: the mesh file's faces look inwards and are turned when it is read.
        limits: how large the files may be.
        read: what `mesh` holds, where it was read already; no part of the subject's record.
    """

    id: str
    source: str
    licence: str
    mesh: Path
    mesh_to_world: np.ndarray = field(default_factory=lambda: np.eye(4))
    body: Path | None = None
    body_parameters: dict[str, Any] = field(default_factory=dict)
    texture: Path | None = None
    files: tuple[Path, ...] = ()
    flip_faces: bool = False
    limits: Limits = field(default_factory=Limits)
    read: Mesh | None = None

    def surface(self) -> Mesh:
        """The surface in the subject's world, its faces looking outwards.

        Raises:
            MeshError: as `read_mesh`.
        """
        mesh = self.read
        if mesh is None:
            cover = None
            if self.texture is not None:
                cover = Material(texture=read_texture(self.texture, self.limits))
            mesh = read_mesh(self.mesh, self.limits, cover)
        return (mesh.flipped() if self.flip_faces else mesh).transformed(self.mesh_to_world)

    def body_surface(self) -> Mesh | None:
        """The parametric body in the subject's world, or None where there is none.

        Raises:
            MeshError: as `read_mesh`.
        """
        if self.body is None:
            return None
        return read_mesh(self.body, self.limits).transformed(self.mesh_to_world)

    @property
    def made_of(self) -> tuple[Path, ...]:
        """All files that the subject's bytes are in."""
        optional = (self.body, self.texture)
        return (self.mesh, *self.files, *(path for path in optional if path is not None))

    def content_sha256(self) -> str:
        """The hash of what the files hold, wherever they lie and whatever they are called."""
        optional = (("body", self.body), ("texture", self.texture))
        roles = [("mesh", self.mesh), *(("file", path) for path in self.files)]
        roles += [(role, path) for role, path in optional if path is not None]
        whole = hashlib.sha256()
        for role, path in roles:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            whole.update(f"{role} {digest}\n".encode())
        return whole.hexdigest()

    def to_json(self, folder: Path) -> dict[str, Any]:
        """The subject as JSON values; paths below `folder` are relative to it, others absolute."""

        def name(path: Path) -> str:
            # links are not followed: a linked scan belongs to the folder that links it
            path, base = path.absolute(), folder.absolute()
            return (path.relative_to(base) if path.is_relative_to(base) else path).as_posix()

        kept = [f.name for f in fields(self) if f.name != "read"]
        return {key: getattr(self, key) for key in kept} | {
            "mesh": name(self.mesh),
            "mesh_to_world": self.mesh_to_world.tolist(),
            "body": None if self.body is None else name(self.body),
            "texture": None if self.texture is None else name(self.texture),
            "files": [name(path) for path in self.files],
            "limits": asdict(self.limits),
        }

    @classmethod
    def from_json(cls, record: dict[str, Any], folder: Path) -> Subject:
        """The subject that `to_json` gave, with its relative paths below `folder`."""
        body, texture = record["body"], record["texture"]
        return cls(
            **record
            | {
                "mesh": folder / record["mesh"],
                "mesh_to_world": np.array(record["mesh_to_world"]),
                "body": None if body is None else folder / body,
                "texture": None if texture is None else folder / texture,
                "files": tuple(folder / path for path in record["files"]),
                "limits": Limits(**record["limits"]),
            }
        )
