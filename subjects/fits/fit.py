"""One scan's fit: its files, and the body that they mean."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from subjects.fits.body import Body
from subjects.fits.parameters import Parameters
from subjects.fits.similarity import compose
from subjects.mesh import Mesh, MeshError

SCALE_TOLERANCE = 0.05
"""By which a fit's scale may differ from the unit that is stated for its scan."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What the files of one scan's fit say.

    Attributes:
        files: role ("parameters", "mesh", "similarity") -> file.
        posed: the body, in the coordinates of its mesh file or, posed by `parameters`, in SMPL-X's.
        parameters: SMPL-X's, or None where the body is a mesh alone.
        record: what else is to be kept of how the body was made, JSON-ready.
        similarity: (4, 4) from `posed` to the scan's coordinates; None where the mesh is in these,
            or the parameters say it.
    """

    files: dict[str, Path]
    posed: Mesh
    parameters: Parameters | None = None
    record: dict[str, Any] = field(default_factory=dict)
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
        to_scan = self.similarity
        if to_scan is None:
            to_scan = self._placed(units_per_metre)
            if "mesh" in self.files:
                # The mesh is in the scan's coordinates; the body's own are metric.
                vertices = (vertices - to_scan[:3, 3]) / to_scan[0, 0]
        record = {"model": "mesh"} if smplx is None else {"model": "smplx", **smplx.to_json()}
        record |= self.record | {"body_to_scan": to_scan.tolist()}
        if smplx is None:
            return Body(vertices, faces, to_scan, parameters=record)
        return Body(vertices, faces, to_scan, smplx.orientation, smplx.upright, record)

    def _placed(self, units_per_metre: float | None) -> np.ndarray:
        """(4, 4) from metres to the scan's coordinates, as the parameters or the unit say."""
        smplx = self.parameters
        own = None if smplx is None else smplx.scale
        if own is not None and units_per_metre is not None:
            ratio = own / units_per_metre
            if abs(ratio - 1) > SCALE_TOLERANCE:
                raise MeshError(
                    f"has a fit '{self.name}' with a scale of {own:.4g} to the metre, where "
                    f"subjects.unit says {units_per_metre:.4g}; give subjects.unit: body"
                )
        scale = units_per_metre if own is None else own
        if scale is None:
            raise MeshError(
                f"has a fit '{self.name}' without a scale; give its parameters, or the scans' "
                "subjects.unit"
            )
        return compose(scale, np.eye(3), np.zeros(3) if smplx is None else smplx.translation)
