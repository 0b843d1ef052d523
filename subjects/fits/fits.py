"""The bodies fitted to a set of scans: where their files lie, and how one is read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from subjects.fits.estimate import Picture, is_estimate, read_estimate
from subjects.fits.fit import Fit
from subjects.fits.parameters import parameters_from, read_values
from subjects.fits.pattern import Place, check_pattern, expand, matching
from subjects.fits.similarity import read_similarity
from subjects.limits import Limits
from subjects.mesh import Material
from subjects.meshfile import read_mesh


@dataclass(frozen=True)
class Fits:
    """Bodies fitted to the scans: SMPL-X parameters, posed meshes, or estimators' outputs.

    Files are named by patterns: {folder} is the scan's folder below subjects.root, {name} its file
    name without the ending, {id} the subject's id. Of several patterns the first whose file exists
    counts. With neither parameters nor mesh, `body.obj` beside a scan is its body.
    """

    root: str | None = None
    """Folder that the patterns are relative to; beside the scans, in subjects.root, if left out."""
    parameters: list[str] = field(default_factory=list)
    """SMPL-X parameters (.pkl, .npz, .npy, .json), PIXIE's *_param.pkl or PyMAF-X's output.pkl."""
    mesh: list[str] = field(default_factory=list)
    """Posed bodies as meshes, preferred over posing the parameters; in the scan's coordinates, or
    in those that `similarity` takes there."""
    similarity: str | None = None
    """JSON files that say how a posed mesh gets into its scan: {"scale": s, "rotation": 3x3,
    "translation": [x, y, z]} for s R v + t, or {"matrix": 4x4}."""
    models: str | None = None
    """Folder of SMPL-X's own files (SMPLX_MALE.npz ...), to pose parameters with."""
    gender: Literal["auto", "neutral", "female", "male"] = "auto"
    """The model of fits that do not say theirs; `auto` goes by their hands: male with 12
    components (as THuman2.0 and CustomHumans are fitted), else neutral."""
    flat_hand_mean: bool = False
    """Whether hands are turns from the flat hand, in fits that do not say it."""
    picture: Picture = field(default_factory=Picture)
    """The picture that an estimator was given."""

    def __post_init__(self) -> None:
        if not self.named and (self.root is not None or self.similarity is not None):
            raise ValueError(
                "subjects.fits: names a root or a similarity, but neither parameters nor mesh; "
                "give patterns of these, such as '{folder}/smplx_param.pkl'"
            )
        for key in ("parameters", "mesh"):
            for pattern in getattr(self, key):
                check_pattern(pattern, f"subjects.fits.{key}")
        if self.similarity is not None:
            check_pattern(self.similarity, "subjects.fits.similarity")
            if not self.mesh:
                raise ValueError("subjects.fits.similarity: places a posed mesh; give mesh too")

    @property
    def named(self) -> bool:
        """Whether any files are named."""
        return bool(self.parameters or self.mesh)

    def read(self, place: Place, root: Path, limits: Limits) -> Fit | None:
        """The fit of one scan, its files read and checked but not yet posed; None without files.

        Args:
            place: the scan.
            root: the scans' root, for patterns without a root of their own.
            limits: of a posed mesh's file.

        Raises:
            MeshError: a file cannot be read; names the file.
        """
        base = self.base(root)
        parameters = _first(self.parameters, place, base)
        mesh = _first(self.mesh, place, base)
        if parameters is None and mesh is None:
            return None
        similarity = None
        if self.similarity is not None and mesh is not None:
            similarity = base / expand(self.similarity, place)
        roles = {"parameters": parameters, "mesh": mesh, "similarity": similarity}
        smplx = estimate = None
        if parameters is not None:
            values = read_values(parameters)
            if is_estimate(values):
                estimate = read_estimate(values, parameters, place)
            else:
                smplx = parameters_from(values, parameters)
        return Fit(
            {role: path for role, path in roles.items() if path is not None},
            parameters=smplx,
            estimate=estimate,
            mesh=None if mesh is None else read_mesh(mesh, limits, Material()),
            similarity=None if similarity is None else read_similarity(similarity),
            models=self.models,
            gender=None if self.gender == "auto" else self.gender,
            flat_hand_mean=self.flat_hand_mean,
        )

    def missing(self, place: Place, root: Path) -> str:
        """What to tell of a scan without a fit."""
        names = [f"'{expand(pattern, place)}'" for pattern in (*self.parameters, *self.mesh)]
        return (
            f"has no fit: {' and '.join(names)} {'is' if len(names) == 1 else 'are'} not in "
            f"'{self.base(root)}'; put it there or correct subjects.fits"
        )

    def strays(self, places: Iterable[Place], root: Path) -> dict[str, Path]:
        """What a fit without a scan calls its scan -> the fit's file."""
        base, places = self.base(root), list(places)
        patterns = [pattern for pattern in self.parameters or self.mesh if "{" in pattern]
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
        base = root if self.root is None else Path(self.root).expanduser()
        if not base.is_dir():
            raise ValueError(f"subjects.fits.root: '{base}' is no folder; give the fits' folder")
        return base


def _first(patterns: Iterable[str], place: Place, base: Path) -> Path | None:
    paths = (base / expand(pattern, place) for pattern in patterns)
    return next((path for path in paths if path.is_file()), None)
