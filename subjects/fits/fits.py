"""The bodies fitted to a set of scans: where their files lie, and how one is read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from subjects.fits import model
from subjects.fits.body import surface_distance
from subjects.fits.fit import Fit
from subjects.fits.model import has_model
from subjects.fits.parameters import Gender, Parameters, read_parameters
from subjects.fits.pattern import (
    Place,
    base_folder,
    check_pattern,
    expand,
    first_file,
    matching,
    not_there,
)
from subjects.fits.similarity import read_similarity
from subjects.limits import Limits
from subjects.mesh import Material, Mesh, MeshError
from subjects.meshfile import read_mesh

PCA_OF_MALE = 12
"""Hand components of the fits that were made with the male model."""

LARGEST_DISAGREEMENT = 0.02
"""Metres between a posed mesh and its parameters' body; another gender's model makes some 10 mm."""


@dataclass(frozen=True)
class Fits:
    """Bodies fitted to the scans: SMPL-X parameters or posed meshes.

    Files are named by patterns: {folder} is the scan's folder below subjects.root, {name} its file
    name without the ending, {id} the subject's id. Of several patterns the first whose file exists
    counts. With neither parameters nor mesh, `body.obj` beside a scan is its body.
    """

    root: str | None = None
    """Folder that the patterns are relative to; beside the scans, in subjects.root, if left out."""
    parameters: list[str] = field(default_factory=list)
    """SMPL-X parameters: .pkl, .npz, .npy or .json."""
    mesh: list[str] = field(default_factory=list)
    """Posed bodies as meshes, preferred over posing the parameters; in the scan's coordinates, or
    in those that `similarity` takes there."""
    similarity: str | None = None
    """JSON files that say how a posed mesh gets into its scan: {"scale": s, "rotation": 3x3,
    "translation": [x, y, z]} for s R v + t, or {"matrix": 4x4}."""
    gender: Literal["auto", "neutral", "female", "male"] = "auto"
    """The model of fits that do not say theirs; `auto` goes by their hands: male with 12
    components (as THuman2.0 and CustomHumans are fitted), else neutral."""
    flat_hand_mean: bool = False
    """Whether hands are turns from the flat hand, in fits that do not say it."""
    unmatched: Literal["set_aside", "ignored"] = "set_aside"
    """Fits whose scan is missing: listed among the failures, or ignored, as for a part of a set."""

    def __post_init__(self) -> None:
        if not self.named and (self.root is not None or self.similarity is not None):
            raise ValueError(
                "subjects.fits: names a root or a similarity, but neither parameters nor mesh; "
                "give patterns of these, such as '{folder}/smplx_param.pkl'"
            )
        for key in ("parameters", "mesh"):
            for pattern in getattr(self, key):
                check_pattern(pattern, f"subjects.fits.{key}", of_each=True)
        if self.similarity is not None:
            check_pattern(self.similarity, "subjects.fits.similarity", of_each=True)
            if not self.mesh:
                raise ValueError("subjects.fits.similarity: places a posed mesh; give mesh too")

    @property
    def named(self) -> bool:
        """Whether any files are named."""
        return bool(self.parameters or self.mesh)

    def read(
        self,
        place: Place,
        root: Path,
        limits: Limits,
        models: str | None,
        units_per_metre: float | None = None,
    ) -> Fit:
        """The fit of one scan, posed.

        Args:
            place: the scan.
            root: the scans' root, for patterns without a root of their own.
            limits: of a posed mesh's file.
            models: folder of SMPL-X's files.
            units_per_metre: the scan's, where it is stated.

        Raises:
            MeshError: there is no fit, or a file cannot be read; names the file.
        """
        base = self.base(root)
        parameters = first_file(self.parameters, place, base)
        mesh = first_file(self.mesh, place, base)
        if parameters is None and mesh is None:
            patterns = (*self.parameters, *self.mesh)
            missing = not_there(patterns, place, base, "subjects.fits")
            raise MeshError(f"'{place.id}' has no fit: {missing}")
        similarity = None
        if self.similarity is not None and mesh is not None:
            similarity = base / expand(self.similarity, place)
        roles = {"parameters": parameters, "mesh": mesh, "similarity": similarity}
        files = {role: path for role, path in roles.items() if path is not None}
        smplx, posed = None, None
        if parameters is not None:
            smplx = read_parameters(parameters, limits.fit_mb)
            # A posed mesh needs no model; where there is one, the two have to agree.
            if mesh is None or has_model(models, self._gender(smplx)):
                posed = model.posed(
                    parameters, models, self._gender(smplx), smplx, self.flat_hand_mean
                )
        record = {} if posed is None else posed.record
        if mesh is not None:
            body = read_mesh(mesh, limits, Material())
            if posed is not None and smplx is not None and similarity is None:
                scale = smplx.scale or units_per_metre or 1.0
                record = record | _agreement(mesh, body, posed.mesh, smplx, scale)
        else:
            assert posed is not None
            body = posed.mesh
        placed = None if similarity is None else read_similarity(similarity)
        return Fit(files, body, smplx, record, placed)

    def _gender(self, parameters: Parameters) -> Gender:
        """The model that `parameters` are of."""
        if parameters.gender is not None:
            return parameters.gender
        if self.gender != "auto":
            return self.gender
        return "male" if parameters.left_hand_pose.shape == (PCA_OF_MALE,) else "neutral"

    def strays(self, places: Iterable[Place], root: Path) -> dict[str, Path]:
        """What a fit without a scan calls its scan -> the fit's file; none where they are ignored.

        Args:
            places: all scans.
            root: as of `read`.
        """
        if self.unmatched == "ignored":
            return {}
        base, places = self.base(root), list(places)
        patterns = self.parameters or self.mesh
        known = {expand(pattern, place) for pattern in patterns for place in places}
        return {
            name: path
            for pattern in reversed(patterns)
            for path, name in matching(pattern, base)
            if path.relative_to(base).as_posix() not in known
        }

    def base(self, root: Path) -> Path:
        """The folder that the patterns are relative to.

        Raises:
            ValueError: it is no folder.
        """
        return base_folder(self.root, root, "subjects.fits.root")


def _agreement(
    path: Path, mesh: Mesh, posed: Mesh, parameters: Parameters, scale: float
) -> dict[str, float]:
    """How far a posed mesh is from its parameters' body; MeshError where that is too far.

    Args:
        path: of the mesh, for messages.
        mesh: in the scan's coordinates.
        posed: by `parameters`, metres.
        parameters: with the translation that puts the one upon the other.
        scale: of the scan's units to the metre.
    """
    own = Mesh((mesh.vertices - parameters.translation) / scale, mesh.faces)
    apart = surface_distance(own, posed)
    if apart > LARGEST_DISAGREEMENT:
        raise MeshError(
            f"{path}: is {1000 * apart:.0f} mm from the body of its parameters (scale "
            f"{scale:g}); they are of different people or releases: take both from one, or give "
            "subjects.fits.gender if that is wrong"
        )
    return {"mesh_to_parameters_mm": round(1000 * apart, 2)}
