"""Any folder of scans as a source of subjects."""

from __future__ import annotations

import glob
import socket
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from storage.mirror import local_folder
from subjects.fits.body import Body
from subjects.fits.estimates import Estimates
from subjects.fits.fit import Fit
from subjects.fits.fits import Fits
from subjects.fits.pattern import Place, check_pattern, expand
from subjects.limits import Limits
from subjects.mesh import Material, Mesh, MeshError
from subjects.meshfile import check_winding, read_mesh, read_mesh_and_files, read_texture
from subjects.scans.agreement import check_size, distances
from subjects.scans.folder import (
    BODY,
    fault_of_name,
    find_scans,
    is_body,
    linked,
    place_of,
    scan_id,
    scans_below,
    shown,
)
from subjects.scans.placement import Axis, Placement, Unit
from subjects.source import Source
from subjects.subject import Subject
from subjects.wavefront import write_mesh

BODY_DECIMALS = 9
"""Of a body's coordinates in its scan's unit, which may be long."""

ESTIMATED = "estimated.obj"
"""The file of the estimated body, beside that of the exact one where there is one."""


RESERVED = ("body.obj", "estimate", "fit_", "subject.json", "cost.json")
"""What the names of files begin with that are made in a subject's folder."""


@dataclass(frozen=True)
class Scans(Source):
    """A folder of OBJ, PLY, glTF or STL scans, one person each.

    What a scan's file does not say is asked for: which way is up, which way the person looks and
    how long a unit is; or a body fitted to it says so. `body.obj` in a scan's folder is its
    parametric body, in the same coordinates and unit; `fits` names bodies of other kinds. Neither
    `body.obj` nor a file with "smplx" in its name is taken for a scan.
    """

    root: str
    """Folder that holds the scans, at any depth; or its URL in a store, from which all files below
    it come to this machine first."""
    up: Axis
    """The file's axis that points from feet to head; or `body`: of each scan, the axis nearest to
    the upright of the body that is fitted to it."""
    front: Axis
    """The file's axis that the person faces, at a right angle to `up`; or `body`: each person is
    turned to face the front by the pelvis of the body that is fitted to it."""
    unit: Unit | float
    """The file's unit of length: its name, or its length in metres; or `body`: the scale of each
    scan's fit."""
    pattern: str = "**/*"
    """Which files below `root` are scans; only .obj, .ply, .glb, .gltf and .stl are considered."""
    limit: int | None = None
    """Take only this many, the first by id."""
    texture: str | None = None
    """The image that covers each scan, in place of its own materials: a pattern as in `fits`, below
    `root`, in which * stands for anything, such as {folder}/tex/*_dif*.jpg; the largest file."""
    flip_faces: bool = False
    """Turn all faces round, for scans whose faces look inwards."""
    licence: str = "unknown (not redistributable)"
    """SPDX identifier or name of the scans' licence; goes into every shard."""
    fits: Fits = field(default_factory=Fits)
    """The bodies fitted to the scans; `body.obj` beside a scan where none are named."""
    estimates: Estimates = field(default_factory=Estimates)
    """Bodies estimated from pictures, for the body maps in place of the exact ones."""
    models: str | None = None
    """Folder of SMPL-X's own files (SMPLX_MALE.npz ...), to pose parameters with."""
    max_scan_to_body: float = 0.035
    """Metres from a scan to its body, the mean over the scan's surface, beyond which the fit has
    gone wrong and the subject is set aside; wide clothes and long hair need more."""
    max_body_to_scan: float = 0.016
    """The same from the body to the scan, which clothes change less."""
    limits: Limits = field(default_factory=Limits)
    """How large a scan's files may be."""

    def __post_init__(self) -> None:
        if self._placement.asks_body and not self.fits.named:
            key = next(key for key in ("up", "front", "unit") if getattr(self, key) == "body")
            raise ValueError(
                f"subjects.{key}: body asks for subjects.fits; say where the bodies lie, "
                f"or give {key} itself"
            )
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"subjects.limit: {self.limit} leaves no scan; give 1 or more")
        for key in ("max_scan_to_body", "max_body_to_scan"):
            if not getattr(self, key) > 0:
                raise ValueError(f"subjects.{key}: {getattr(self, key)} m; give metres above 0")
        if self.texture is not None:
            check_pattern(self.texture, "subjects.texture")
        pattern = PurePosixPath(self.pattern)
        if not pattern.parts or pattern.is_absolute() or ".." in pattern.parts:
            raise ValueError(
                f"subjects.pattern: '{self.pattern}' does not stay below root; "
                "give one like '**/*.obj'"
            )

    def __getstate__(self) -> dict[str, Any]:
        # What is cached is of this machine, which need not be the one that makes the subjects.
        return {field.name: self.__dict__[field.name] for field in fields(self)}

    @property
    def packages(self) -> tuple[str, ...]:
        """As `Source.packages`."""
        poses = bool(self.fits.parameters or self.estimates.files) and self.models is not None
        posing = ("smplx", "torch") if poses and find_spec("smplx") is not None else ()
        return ("libigl", "pillow", "scipy", *posing)

    @property
    def loads_torch(self) -> bool:
        """As `Source.loads_torch`: SMPL-X's model does."""
        return self.models is not None

    def ids(self) -> list[str]:
        """The subjects' ids, sorted: each scan's path below `root` in letters that files allow.

        Raises:
            ValueError: `root` holds no scans, or two of them get the same id.
        """
        return sorted(self._paths.keys() - self._misnamed.keys())[: self.limit]

    def refused(self) -> dict[str, str]:
        """As `Source.refused`: unfit names, and fits without a scan; none for a `limit`."""
        if self.limit is not None:
            return {}
        # Scans that `pattern` leaves out are there all the same.
        scans = scans_below(self._root, "**/*")
        places = [place_of(name, path, self._root) for name, path in scans]
        strays = self.fits.strays(places, self._root)
        return self._misnamed | {
            scan_id(Path(f"{name}.fit")): f"{shown(path)}: is a fit without a scan in "
            f"'{self._root}'; put the scan there or take the fit away, or set "
            "subjects.fits.unmatched: ignored"
            for name, path in strays.items()
        }

    def refuse_output(self, output: Path) -> None:
        """As `Source.refuse_output`: links below `root` would be scans of the next build."""
        roots = {
            "subjects.root": self._root,
            "subjects.fits.root": self.fits.base(self._root),
            "subjects.estimates.root": self.estimates.base(self._root),
        }
        for key, root in roots.items():
            if output.resolve().is_relative_to(root.resolve()):
                raise ValueError(
                    f"'{output}' lies inside {key} '{root}'; "
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
            raise ValueError(f"subjects.root: '{self.root}' has no scan '{subject}'; see its ids")
        path = self._paths[subject]
        place = place_of(subject, path, self._root)
        texture = self._texture(place, path)
        cover = None if texture is None else Material(texture=read_texture(texture, self.limits))
        mesh, named = read_mesh_and_files(path, self.limits, cover)
        # What is wrong with the files of a fit or an estimate names those; the rest is the scan's.
        fit = self._fit(place, path)
        estimate = self.estimates.read(place, self._root, self.models, self.limits.fit_mb)
        try:
            check_winding(mesh, flip_faces=self.flip_faces)
            body = None if fit is None else fit.body(self._placement.units_per_metre)
            mesh_to_world = self._placement.mesh_to_world(mesh.vertices, body)
            record = {}
            if fit is not None and body is not None:
                record = self._checked(mesh, body, fit, mesh_to_world)
            guess = None
            if estimate is not None:
                level = _middle_height(mesh_to_world, mesh, body)
                guess = estimate.body(self.estimates.picture, level, mesh, mesh_to_world)
                check_size(mesh, guess, mesh_to_world, f"'{estimate.file}'")
                apart = distances(mesh, guess, mesh_to_world)
                record = guess.parameters | apart | ({"fit": record} if record else {})
        except MeshError as error:
            raise MeshError(f"{path}: {error}") from None

        sources = {path.name: path, **{str(name): path.parent / name for name in named}}
        if texture is not None:
            sources[texture.name] = texture
        _refuse_reserved(path, sources)
        if fit is not None:
            sources |= {f"fit_{k}{file.suffix.lower()}": file for k, file in fit.files.items()}
        if estimate is not None and not self.estimates.shared:
            sources[f"estimate{estimate.file.suffix.lower()}"] = estimate.file
        links = {file: linked(file, folder / name) for name, file in sources.items()}
        bodies = [
            _write(each, folder / name)
            for name, each in ((BODY, body), (ESTIMATED, guess))
            if each is not None
        ]
        surface = (path, *(() if texture is None else (texture,)))
        files = [link for file, link in links.items() if file not in surface] + bodies[:-1]
        return Subject(
            id=subject,
            source="scans",
            licence=self.licence,
            mesh=links[path],
            mesh_to_world=mesh_to_world,
            flip_faces=self.flip_faces,
            body=bodies[-1] if bodies else None,
            body_parameters=record,
            texture=None if texture is None else links[texture],
            files=tuple(files),
            limits=self.limits,
            read=mesh,
        )

    def _texture(self, place: Place, path: Path) -> Path | None:
        """The image that covers the scan at `path` in place of its own materials, if one does."""
        if self.texture is None:
            return None
        pattern = expand(self.texture, place, glob.escape)
        found = sorted(file for file in self._root.glob(pattern) if file.is_file())
        largest = max(found, key=lambda file: file.stat().st_size, default=None)
        if largest is None:
            raise MeshError(
                f"{path}: has no texture '{pattern}' in '{self._root}'; put it there or correct "
                "subjects.texture"
            )
        return largest

    def _fit(self, place: Place, path: Path) -> Fit | None:
        """The fit of the scan at `path`, or None where it has none and needs none."""
        if self.fits.named:
            self._refuse_shared(place, path)
            units = self._placement.units_per_metre
            return self.fits.read(place, self._root, self.limits, self.models, units)
        bodies = [file for file in sorted(path.parent.iterdir()) if is_body(file)]
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
        return Fit({"mesh": body}, read_mesh(body, self.limits, Material()))

    def _refuse_shared(self, place: Place, path: Path) -> None:
        """MeshError where two scans have one fit: one of them is no scan."""
        for pattern in (*self.fits.parameters, *self.fits.mesh):
            others = self._expanded.get(expand(pattern, place), [])
            if len(others) > 1:
                other = next(name for name in others if name != place.id)
                raise MeshError(
                    f"{path}: has the same fit as '{other}' ({expand(pattern, place)}); take the "
                    "one that is no scan away, or narrow subjects.pattern"
                )

    @cached_property
    def _expanded(self) -> dict[str, list[str]]:
        """Path of a fit -> the ids of the scans that it would be of."""
        found: dict[str, list[str]] = {}
        for name, path in self._paths.items():
            place = place_of(name, path, self._root)
            for pattern in {*self.fits.parameters, *self.fits.mesh}:
                found.setdefault(expand(pattern, place), []).append(name)
        return found

    def _checked(
        self, mesh: Mesh, body: Body, fit: Fit, mesh_to_world: np.ndarray
    ) -> dict[str, Any]:
        """What made `body` and how far the scan is from it; MeshError where it is not the scan's.

        Args:
            mesh: the scan.
            body: of the scan, by `fit`.
            mesh_to_world: (4, 4) from the scan's coordinates.
        """
        check_size(mesh, body, mesh_to_world, f"'{fit.name}', by subjects.unit: {self.unit},")
        apart = distances(mesh, body, mesh_to_world)
        for key, millimetres in apart.items():
            setting = f"max_{key.removesuffix('_mm')}"
            most = 1000 * getattr(self, setting)
            if millimetres > most:
                raise MeshError(
                    f"is off its body '{fit.name}': {key.removesuffix('_mm').replace('_', ' ')} "
                    f"{millimetres:.1f} mm in the mean, where {most:.1f} mm are allowed; correct "
                    f"the fit, or raise subjects.{setting} where it is right"
                )
        return body.parameters | apart

    @cached_property
    def _root(self) -> Path:
        root = local_folder(self.root)
        if not root.is_dir():
            # A MeshError: of the subject, where a worker on another machine does not see it.
            raise MeshError(
                f"subjects.root: '{root}' is no folder on {socket.gethostname()}; "
                "give the scans' folder"
            )
        return root

    @cached_property
    def _placement(self) -> Placement:
        return Placement(self.up, self.front, self.unit)

    @cached_property
    def _paths(self) -> dict[str, Path]:
        return find_scans(self._root, self.pattern)

    @cached_property
    def _misnamed(self) -> dict[str, str]:
        """Id -> reason, of the scans whose names no dataset can take."""
        faults = {
            name: fault_of_name(name, path.relative_to(self._root))
            for name, path in self._paths.items()
        }
        return {name: f"{shown(self._paths[name])}: {why}" for name, why in faults.items() if why}


def _middle_height(mesh_to_world: np.ndarray, mesh: Mesh, body: Body | None) -> float:
    """The height half way between the lowest and the highest vertex of a scan and its body."""
    meshes = [mesh] if body is None else [mesh, body.in_scan()]
    heights = [corner[1] for each in meshes for corner in each.transformed(mesh_to_world).bounds]
    return float(min(heights) + max(heights)) / 2


def _refuse_reserved(path: Path, names: Iterable[str]) -> None:
    """MeshError where a scan brings a file of a name that the subject's folder gives its own."""
    for name in names:
        if name.lower().startswith(RESERVED):
            raise MeshError(
                f"{path}: has a file '{name}', a name that is taken in the subject's folder; "
                "rename it, and in the mesh where it is named"
            )


def _write(body: Body, path: Path) -> Path:
    """`path`, with the body in its scan's coordinates."""
    placed = body.in_scan()
    path.unlink(missing_ok=True)  # never through a link
    write_mesh(path, placed.vertices, placed.faces, BODY_DECIMALS)
    return path
