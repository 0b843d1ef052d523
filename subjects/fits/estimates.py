"""The bodies estimated from pictures of a set of scans: where their files lie."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from subjects.fits.estimate import Estimate, Picture, read_estimate
from subjects.fits.pattern import Place, base_folder, check_pattern, first_file, not_there
from subjects.mesh import MeshError


@dataclass(frozen=True)
class Estimates:
    """Bodies that PIXIE or PyMAF-X estimated from pictures of the scans' fronts.

    Where they are named they are the bodies of the body maps, as a network will be given them, in
    place of the exact ones; patterns are those of `fits`.
    """

    files: list[str] = field(default_factory=list)
    """PIXIE's *_param.pkl of each scan, or PyMAF-X's one output.pkl of all."""
    root: str | None = None
    """Folder that the patterns are relative to; subjects.root if left out."""
    picture: Picture = field(default_factory=Picture)
    """The picture that the estimator was given."""

    def __post_init__(self) -> None:
        for pattern in self.files:
            check_pattern(pattern, "subjects.estimates.files")
        if self.root is not None and not self.files:
            raise ValueError(
                "subjects.estimates.root: names a folder, but no files; give "
                "subjects.estimates.files, such as '{id}/{id}_param.pkl'"
            )

    def read(
        self, place: Place, root: Path, models: str | None, largest_mb: float
    ) -> Estimate | None:
        """The estimate of one scan; None where none are named.

        Args:
            place: the scan.
            root: the scans' root, for patterns without a root of their own.
            models: folder of SMPL-X's files.
            largest_mb: most megabytes of a file.

        Raises:
            MeshError: there is none, or it cannot be read; names the file.
        """
        if not self.files:
            return None
        base = self.base(root)
        path = first_file(self.files, place, base)
        if path is None:
            missing = not_there(self.files, place, base, "subjects.estimates")
            raise MeshError(f"'{place.id}' has no estimate: {missing}")
        return read_estimate(path, place, models, largest_mb)

    @property
    def shared(self) -> bool:
        """Whether one file holds the estimates of several scans."""
        return any("{" not in pattern for pattern in self.files)

    def base(self, root: Path) -> Path:
        """The folder that the patterns are relative to.

        Raises:
            ValueError: it is no folder.
        """
        return base_folder(self.root, root, "subjects.estimates.root")
