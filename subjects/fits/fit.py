"""One scan's fit: its files, and the body that they mean."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from subjects.fits.body import Body
from subjects.fits.parameters import Parameters
from subjects.fits.similarity import compose
from subjects.mesh import Mesh, MeshError


@dataclass(frozen=True, eq=False)
class Fit:
    """What the files of one scan's fit say.

    Attributes:
        files: role ("parameters", "mesh", "similarity") -> file.
        posed: the body, in the coordinates of its mesh file or, posed by `parameters`, in SMPL-X's.
        parameters: SMPL-X's, or None where the body is a mesh alone.
        similarity: (4, 4) from `posed` to the scan's coordinates; None where the mesh is in these,
            or the parameters say it.
    """

    files: dict[str, Path]
    posed: Mesh
    parameters: Parameters | None = None
    similarity: np.ndarray | None = None

    @property
    def name(self) -> str:
        """The file that a user knows the body by."""
        return str(self.files.get("mesh", self.files.get("parameters")))

    def body(self, units_per_metre: float | None) -> Body:
        """The body where its parameters, its mesh or its similarity put it.

        Args:
            units_per_metre: the scan's, for parameters without a scale; None where only a fit's
                scale can tell.

        Raises:
            MeshError: nothing says the scale.
        """
        smplx, vertices, faces = self.parameters, self.posed.vertices, self.posed.faces
        if smplx is None:
            to_scan = np.eye(4) if self.similarity is None else self.similarity
            return Body(vertices, faces, to_scan, parameters={"model": "mesh"})
        to_scan = self._placed(smplx, units_per_metre)
        if "mesh" in self.files and self.similarity is None:
            # The mesh is in the scan's coordinates; the body's own are metric.
            vertices = (vertices - to_scan[:3, 3]) / to_scan[0, 0]
        record = {"model": "smplx", **smplx.to_json()}
        return Body(vertices, faces, to_scan, smplx.orientation, smplx.upright, record)

    def _placed(self, smplx: Parameters, units_per_metre: float | None) -> np.ndarray:
        """(4, 4) from SMPL-X's coordinates to the scan's."""
        if self.similarity is not None:
            return self.similarity
        scale = units_per_metre if smplx.scale is None else smplx.scale
        if scale is None:
            raise MeshError(
                f"has a fit '{self.name}' without a scale; give the scans' subjects unit"
            )
        return compose(scale, np.eye(3), smplx.translation)
