"""Any folder of scans as a source of subjects."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Literal

import numpy as np

from subjects.mesh import Mesh, MeshError
from subjects.meshfile import EXTENSIONS, check_winding, read_mesh_and_files
from subjects.source import Source
from subjects.subject import Subject

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]

METRES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres per unit of length."""

HEIGHTS = (0.5, 3.0)
"""Metres that a person's scan may be high, crouching child to giant; else the unit is wrong."""

WIDEST = 2.5
"""Times its height that a person's scan may be wide or deep; else another axis is up."""

BODY = "body.obj"
"""The file beside a scan that holds its parametric body, in letters of either case."""

BODY_HEIGHTS = (0.6, 1.1)
"""A body's height over its scan's: hair and what is held up add to a scan, little to a body."""


@dataclass(frozen=True)
class Scans(Source):
    """A folder of OBJ, PLY, glTF or STL scans, one person each.

    What a scan's file does not say is asked for: which way is up, which way the person looks and
    how long a unit is. `body.obj` in a scan's folder is its parametric body, in the same
    coordinates and unit; neither it nor a file with "smplx" in its name is taken for a scan.
    """

    root: str
    """Folder that holds the scans, at any depth."""
    up: Axis
    """The file's axis that points from feet to head."""
    front: Axis
    """The file's axis that the person faces; at a right angle to `up`."""
    unit: Literal["m", "dm", "cm", "mm", "in", "ft"] | float
    """The file's unit of length: its name, or its length in metres."""
    pattern: str = "**/*"
    """Which files below `root` are scans; only .obj, .ply, .glb, .gltf and .stl are considered."""
    limit: int | None = None
    """Take only this many, the first by id."""
    flip_faces: bool = False
    """Turn all faces round, for scans whose faces look inwards."""
    licence: str = "unknown (not redistributable)"
    """SPDX identifier or name of the scans' licence; goes into every shard."""

    def __post_init__(self) -> None:
        for name in ("up", "front"):
            if getattr(self, name) not in _AXES:
                raise ValueError(
                    f"subjects {name}: '{getattr(self, name)}' is no axis; "
                    f"give one of {', '.join(_AXES)}"
                )
        if self.up[-1] == self.front[-1]:
            raise ValueError(
                f"subjects front: '{self.front}' is parallel to up: '{self.up}'; "
                "give the axis that the person faces"
            )
        if not (self.unit in METRES if isinstance(self.unit, str) else 0 < self.unit < np.inf):
            raise ValueError(
                f"subjects unit: '{self.unit}' is no length; "
                f"give one of {', '.join(METRES)} or the unit's metres"
            )
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"subjects limit: {self.limit} leaves no scan; give 1 or more")
        pattern = PurePosixPath(self.pattern)
        if not pattern.parts or pattern.is_absolute() or ".." in pattern.parts:
            raise ValueError(
                f"subjects pattern: '{self.pattern}' does not stay below root; "
                "give one like '**/*.obj'"
            )

    def ids(self) -> list[str]:
        """The subjects' ids, sorted: each scan's path below `root` in letters that files allow.

        "0525/0525.obj" is "0525", "a/b.glb" is "a_b".

        Raises:
            ValueError: `root` holds no scans, or two of them get the same id.
        """
        return sorted(self._paths)[: self.limit]

    def refuse_output(self, output: Path) -> None:
        """As `Source.refuse_output`: links below `root` would be scans of the next build."""
        if output.resolve().is_relative_to(Path(self.root).expanduser().resolve()):
            raise ValueError(
                f"'{output}' lies inside subjects root '{self.root}'; "
                "put the dataset beside the scans, not among them"
            )

    def make(self, subject: str, seed: int, folder: Path) -> Subject:
        """The subject of that id, its files linked (or copied, where links fail) into `folder`.

        Args:
            subject: one of `ids`.
            seed: the dataset's; a scan draws nothing from it.
            folder: the subject's own folder in the dataset; made where it is missing.

        Raises:
            ValueError: there is no such scan.
            MeshError: the scan or its body cannot be read, the scan's faces do not look outwards,
                it is no person's height, or the body is not of its size or not within it.
        """
        if subject not in self._paths:
            raise ValueError(f"subjects root: '{self.root}' has no scan '{subject}'; see its ids")
        path = self._paths[subject]
        mesh, named = read_mesh_and_files(path)
        try:
            check_winding(mesh, flip_faces=self.flip_faces)
            mesh_to_world = self._placement(mesh.vertices)
        except MeshError as error:
            raise MeshError(f"{path}: {error}") from None

        body = self._body(path)
        if body is not None:
            body_mesh, body_named = read_mesh_and_files(body)
            placed, scan = body_mesh.transformed(mesh_to_world), mesh.transformed(mesh_to_world)
            self._check_body(body, placed, scan)
            named = tuple(sorted({*named, *body_named}))
            body = _linked(body, folder / BODY)
        return Subject(
            id=subject,
            source="scans",
            licence=self.licence,
            mesh=_linked(path, folder / path.name),
            mesh_to_world=mesh_to_world,
            flip_faces=self.flip_faces,
            body=body,
            files=tuple(_linked(path.parent / name, folder / name) for name in named),
        )

    @cached_property
    def _paths(self) -> dict[str, Path]:
        root = Path(self.root).expanduser()
        if not root.is_dir():
            raise ValueError(f"subjects root: '{self.root}' is no folder; give the scans' folder")
        paths: dict[str, Path] = {}
        for path in sorted(root.glob(self.pattern)):
            below = path.relative_to(root)
            if not _is_scan(path) or any(part.startswith(".") for part in below.parts):
                continue
            name = _id(below)
            if name in paths:
                raise ValueError(
                    f"subjects root: '{paths[name]}' and '{path}' have the same id '{name}'; "
                    "rename one or narrow subjects pattern"
                )
            paths[name] = path
        if not paths:
            raise ValueError(
                f"subjects root: '{self.root}' holds no scan that matches '{self.pattern}'; "
                f"give a folder with {', '.join(EXTENSIONS)} files"
            )
        return paths

    def _placement(self, vertices: np.ndarray) -> np.ndarray:
        """(4, 4) from the file's coordinates to the subject's world, by its bounding box."""
        up, front = _AXES[self.up], _AXES[self.front]
        scale = METRES[self.unit] if isinstance(self.unit, str) else float(self.unit)
        mesh_to_world = np.eye(4)
        mesh_to_world[:3, :3] = scale * np.stack([np.cross(up, front), up, front])
        placed = vertices @ mesh_to_world[:3, :3].T
        lowest, highest = placed.min(axis=0), placed.max(axis=0)
        height = highest[1] - lowest[1]
        if not HEIGHTS[0] <= height <= HEIGHTS[1]:
            raise MeshError(
                f"is {height:.4g} m high, no person's height; "
                f"correct subjects unit: {self.unit} (or up: {self.up})"
            )
        span = float((highest - lowest)[[0, 2]].max())
        if span > WIDEST * height:
            raise MeshError(
                f"is {height:.2f} m high and {span:.2f} m across: it seems to lie; "
                f"correct subjects up: {self.up}"
            )
        middle = (lowest + highest) / 2
        mesh_to_world[:3, 3] = -middle[0], -lowest[1], -middle[2]
        return mesh_to_world

    def _body(self, path: Path) -> Path | None:
        bodies = [file for file in sorted(path.parent.iterdir()) if _is_body(file)]
        if not bodies:
            return None
        body = bodies[0]
        if len(bodies) > 1:
            raise MeshError(f"{body}: lies beside '{bodies[1].name}'; keep the scan's one body")
        beside = [other for other in self._paths.values() if other.parent == path.parent]
        if len(beside) > 1:
            raise MeshError(
                f"{body}: lies beside {len(beside)} scans; give each scan and body their own folder"
            )
        return body

    def _check_body(self, path: Path, body: Mesh, scan: Mesh) -> None:
        """MeshError where `body` has not the size of `scan` or its middle is outside; in metres."""
        (low, high), (scan_low, scan_high) = body.bounds, scan.bounds
        height, scan_height = high[1] - low[1], scan_high[1] - scan_low[1]
        centre = (low + high) / 2
        if not BODY_HEIGHTS[0] <= height / scan_height <= BODY_HEIGHTS[1]:
            fault = "is of another size"
        elif not ((scan_low <= centre) & (centre <= scan_high)).all():
            fault = "lies elsewhere"
        else:
            return
        raise MeshError(
            f"{path}: {fault} than its scan ({height:.4g} m high, the scan {scan_height:.4g} m, "
            f"by subjects unit: {self.unit}); export it in the scan's coordinates and unit"
        )


_AXES = {
    sign + name: (-1.0 if sign else 1.0) * axis
    for sign in ("", "-")
    for name, axis in zip("xyz", np.eye(3), strict=True)
}


def _is_scan(path: Path) -> bool:
    is_body = _is_body(path) or "smplx" in path.name.lower()
    return path.suffix.lower() in EXTENSIONS and not is_body and path.is_file()


def _is_body(path: Path) -> bool:
    return path.name.lower() == BODY and path.is_file()


def _id(below: Path) -> str:
    parts = below.with_suffix("").parts
    if len(parts) > 1 and parts[-1] == parts[-2]:
        parts = parts[:-1]
    return re.sub(r"[^A-Za-z0-9._-]", "_", "_".join(parts))


def _linked(source: Path, link: Path) -> Path:
    """`link`, made to hold what `source` holds."""
    if link.exists() and not link.is_symlink() and link.samefile(source):
        return link
    link.parent.mkdir(parents=True, exist_ok=True)
    link.unlink(missing_ok=True)
    try:
        link.symlink_to(source.resolve())
    except OSError:
        shutil.copyfile(source, link)
    return link
