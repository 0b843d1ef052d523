"""Any folder of scans as a source of subjects."""

from __future__ import annotations

import glob
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from subjects.fits.body import Body, surface_distance
from subjects.fits.fit import Fit
from subjects.fits.fits import Fits
from subjects.fits.pattern import check_pattern, expand
from subjects.limits import Limits
from subjects.mesh import Material, Mesh, MeshError
from subjects.meshfile import check_winding, read_mesh, read_mesh_and_files, read_texture
from subjects.scans.folder import BODY, find_scans, is_body, linked, place_of, scan_id
from subjects.scans.placement import Axis, Placement, Unit
from subjects.source import Source
from subjects.subject import Subject
from subjects.wavefront import write_mesh

BODY_DECIMALS = 9
"""Of a body's coordinates in its scan's unit, which may be long."""

BODY_HEIGHTS = (0.6, 1.1)
"""A body's height over its scan's: hair and what is held up add to a scan, little to a body."""


@dataclass(frozen=True)
class Scans(Source):
    """A folder of OBJ, PLY, glTF or STL scans, one person each.

    What a scan's file does not say is asked for: which way is up, which way the person looks and
    how long a unit is; or a body fitted to it says so. `body.obj` in a scan's folder is its
    parametric body, in the same coordinates and unit; `fits` names bodies of other kinds. Neither
    `body.obj` nor a file with "smplx" in its name is taken for a scan.
    """

    root: str
    """Folder that holds the scans, at any depth."""
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
    `root`, in which * stands for anything, such as {folder}/tex/*_dif*.jpg; the first by name."""
    flip_faces: bool = False
    """Turn all faces round, for scans whose faces look inwards."""
    licence: str = "unknown (not redistributable)"
    """SPDX identifier or name of the scans' licence; goes into every shard."""
    fits: Fits = field(default_factory=Fits)
    """The bodies fitted to the scans; `body.obj` beside a scan where none are named."""
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
                f"subjects {key}: body asks for subjects.fits; say where the bodies lie, "
                f"or give {key} itself"
            )
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"subjects limit: {self.limit} leaves no scan; give 1 or more")
        for key in ("max_scan_to_body", "max_body_to_scan"):
            if not getattr(self, key) > 0:
                raise ValueError(f"subjects {key}: {getattr(self, key)} m; give metres above 0")
        if self.texture is not None:
            check_pattern(self.texture, "subjects texture")
        pattern = PurePosixPath(self.pattern)
        if not pattern.parts or pattern.is_absolute() or ".." in pattern.parts:
            raise ValueError(
                f"subjects pattern: '{self.pattern}' does not stay below root; "
                "give one like '**/*.obj'"
            )

    @property
    def packages(self) -> tuple[str, ...]:
        """As `Source.packages`."""
        posing = ("smplx", "torch") if self.fits.parameters and find_spec("smplx") else ()
        return ("libigl", "pillow", "scipy", *posing)

    def ids(self) -> list[str]:
        """The subjects' ids, sorted: each scan's path below `root` in letters that files allow.

        A fit whose scan is missing has an id too, so that it is set aside with a reason.

        Raises:
            ValueError: `root` holds no scans, or two of them get the same id.
        """
        return sorted([*self._paths, *self._strays])[: self.limit]

    def refuse_output(self, output: Path) -> None:
        """As `Source.refuse_output`: links below `root` would be scans of the next build."""
        for root in (self._root, self.fits.base(self._root)):
            if output.resolve().is_relative_to(root.resolve()):
                raise ValueError(
                    f"'{output}' lies inside subjects root '{root}'; "
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
        if subject in self._strays:
            raise MeshError(
                f"{self._strays[subject]}: is a fit without a scan in '{self.root}'; "
                "put the scan there or take the fit away"
            )
        if subject not in self._paths:
            raise ValueError(f"subjects root: '{self.root}' has no scan '{subject}'; see its ids")
        path = self._paths[subject]
        texture = self._texture(subject, path)
        cover = None if texture is None else Material(texture=read_texture(texture, self.limits))
        mesh, named = read_mesh_and_files(path, self.limits, cover)
        # What is wrong with a fit's files names those; the rest is the scan's.
        fit = self._fit(subject, path)
        posed = None if fit is None else fit.posed()
        try:
            check_winding(mesh, flip_faces=self.flip_faces)
            body, mesh_to_world = self._placed(mesh, fit, posed)
            record = {}
            if body is not None and fit is not None:
                record = self._checked(body, fit, mesh, mesh_to_world)
        except MeshError as error:
            raise MeshError(f"{path}: {error}") from None

        files = [linked(path.parent / name, folder / name) for name in named]
        if fit is not None and body is not None:
            files += [
                linked(source, folder / f"fit_{role}{source.suffix.lower()}")
                for role, source in fit.files.items()
            ]
            placed = body.in_scan()
            write_mesh(folder / BODY, placed.vertices, placed.faces, BODY_DECIMALS)
        return Subject(
            id=subject,
            source="scans",
            licence=self.licence,
            mesh=linked(path, folder / path.name),
            mesh_to_world=mesh_to_world,
            flip_faces=self.flip_faces,
            body=None if body is None else folder / BODY,
            body_parameters=record,
            texture=None if texture is None else linked(texture, folder / texture.name),
            files=tuple(files),
            limits=self.limits,
        )

    def _texture(self, subject: str, path: Path) -> Path | None:
        """The image that covers the scan at `path` in place of its own materials, if one does."""
        if self.texture is None:
            return None
        pattern = expand(self.texture, place_of(subject, path, self._root), glob.escape)
        found = sorted(file for file in self._root.glob(pattern) if file.is_file())
        if not found:
            raise MeshError(
                f"{path}: has no texture '{pattern}' in '{self._root}'; put it there or correct "
                "subjects texture"
            )
        return found[0]

    def _fit(self, subject: str, path: Path) -> Fit | None:
        """The fit of the scan at `path`, or None where it has none and needs none."""
        if self.fits.named:
            place = place_of(subject, path, self._root)
            fit = self.fits.read(place, self._root, self.limits)
            if fit is None:
                raise MeshError(f"{path}: {self.fits.missing(place, self._root)}")
            return fit
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
        return Fit({"mesh": body}, mesh=read_mesh(body, self.limits, Material()))

    def _placed(
        self, mesh: Mesh, fit: Fit | None, posed: Mesh | None
    ) -> tuple[Body | None, np.ndarray]:
        """The scan's body, and (4, 4) from the scan's coordinates to the world."""
        if fit is None or posed is None:
            return None, self._placement.mesh_to_world(mesh.vertices, None)
        if fit.estimate is None:
            body = fit.body(posed, self._placement.units_per_metre)
            return body, self._placement.mesh_to_world(mesh.vertices, body)
        # A picture was taken of the scan as it stands in the world, so it has to stand first.
        mesh_to_world = self._placement.mesh_to_world(mesh.vertices, None)
        body = fit.estimated_body(posed, self.fits.picture, mesh, mesh_to_world)
        return body, mesh_to_world

    def _checked(
        self, body: Body, fit: Fit, mesh: Mesh, mesh_to_world: np.ndarray
    ) -> dict[str, Any]:
        """What made `body` and how far the scan is from it; MeshError where it is not the scan's.

        Args:
            body: of the scan, by `fit`.
            mesh: the scan, in its file's coordinates.
            mesh_to_world: (4, 4) that takes both into the world.
        """
        placed = body.in_scan().transformed(mesh_to_world)
        scan = mesh.transformed(mesh_to_world)
        (low, high), (scan_low, scan_high) = placed.bounds, scan.bounds
        height, scan_height = high[1] - low[1], scan_high[1] - scan_low[1]
        centre = (low + high) / 2
        fault = None
        if not BODY_HEIGHTS[0] <= height / scan_height <= BODY_HEIGHTS[1]:
            fault = "is of another size than the scan"
        elif not ((scan_low <= centre) & (centre <= scan_high)).all():
            fault = "lies elsewhere than the scan"
        if fault is not None:
            raise MeshError(
                f"its body '{fit.name}' {fault} ({height:.4g} m high, the scan "
                f"{scan_height:.4g} m, by subjects unit: {self.unit}); export it in the scan's "
                "coordinates and unit"
            )
        found = {
            "scan_to_body": surface_distance(scan, placed),
            "body_to_scan": surface_distance(placed, scan),
        }
        for key, distance in found.items():
            most = getattr(self, f"max_{key}")
            if distance > most:
                raise MeshError(
                    f"is off its body '{fit.name}': {key.replace('_', ' ')} {1000 * distance:.1f} "
                    f"mm in the mean, where {1000 * most:.1f} mm are allowed; correct the fit, or "
                    f"raise subjects max_{key} where it is right"
                )
        return body.parameters | {f"{key}_mm": round(1000 * d, 2) for key, d in found.items()}

    @cached_property
    def _root(self) -> Path:
        root = Path(self.root).expanduser()
        if not root.is_dir():
            raise ValueError(f"subjects root: '{root}' is no folder; give the scans' folder")
        return root

    @cached_property
    def _placement(self) -> Placement:
        return Placement(self.up, self.front, self.unit)

    @cached_property
    def _paths(self) -> dict[str, Path]:
        return find_scans(self._root, self.pattern)

    @cached_property
    def _strays(self) -> dict[str, Path]:
        """Id -> file of every fit without a scan."""
        places = [place_of(name, path, self._root) for name, path in self._paths.items()]
        strays = self.fits.strays(places, self._root)
        named = {scan_id(Path(f"{name}.fit")): path for name, path in strays.items()}
        return {name: path for name, path in named.items() if name not in self._paths}
