"""One scan's fit: its files, and the body that they mean."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from subjects.fits import model
from subjects.fits.body import Body
from subjects.fits.estimate import Estimate, Picture
from subjects.fits.parameters import Gender, Parameters
from subjects.fits.similarity import compose
from subjects.mesh import Mesh, MeshError

PCA_OF_MALE = 12
"""Hand components of the fits that were made with the male model."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What the files of one scan's fit say.

    Attributes:
        files: role ("parameters", "mesh", "similarity") -> file.
        parameters: SMPL-X's, or None where the body is a mesh alone.
        estimate: what an estimator made of the scan's picture, or None.
        mesh: the posed body as its file has it, or None.
        similarity: (4, 4) from the mesh's coordinates to the scan's; None where they are the same.
        models: folder of SMPL-X's files.
        gender: of the model, where parameters do not say it; None lets their hands tell.
        flat_hand_mean: of parameters that do not say it.
    """

    files: dict[str, Path]
    parameters: Parameters | None = None
    estimate: Estimate | None = None
    mesh: Mesh | None = None
    similarity: np.ndarray | None = None
    models: str | None = None
    gender: Gender | None = None
    flat_hand_mean: bool = False

    @property
    def name(self) -> str:
        """The file that a user knows the body by."""
        return str(self.files.get("mesh", self.files.get("parameters")))

    def posed(self) -> Mesh:
        """The posed body in the coordinates of its mesh file, or in the body model's own.

        Raises:
            MeshError: the body model is missing or cannot be read; names the fit's file.
        """
        if self.mesh is not None:
            return self.mesh
        parameters = self.parameters if self.estimate is None else self.estimate.parameters
        assert parameters is not None
        gender = parameters.gender or self.gender
        if gender is None:
            male = parameters.left_hand_pose.shape == (PCA_OF_MALE,)
            gender = "male" if male else "neutral"
        vertices = None if self.estimate is None else self.estimate.vertices
        try:
            path = model.find_model(self.models, gender)
            if vertices is None:
                vertices = model.pose(path, parameters, self.flat_hand_mean)
            return Mesh(vertices, model.faces(path))
        except MeshError as error:
            raise MeshError(f"{self.name}: {error}") from None

    def body(self, posed: Mesh, units_per_metre: float | None) -> Body:
        """The body where its parameters, its mesh or its similarity put it.

        Args:
            posed: as `posed` gives it.
            units_per_metre: the scan's, for parameters without a scale; None where only a fit's
                scale can tell.

        Raises:
            MeshError: nothing says the scale.
        """
        smplx, vertices = self.parameters, posed.vertices
        if smplx is None:
            to_scan = np.eye(4) if self.similarity is None else self.similarity
            return Body(vertices, posed.faces, to_scan, parameters={"model": "mesh"})
        if self.similarity is not None:
            to_scan = self.similarity
        else:
            scale = units_per_metre if smplx.scale is None else smplx.scale
            if scale is None:
                raise MeshError(
                    f"has a fit '{self.name}' without a scale; give the scans' subjects unit"
                )
            to_scan = compose(scale, np.eye(3), smplx.translation)
            if self.mesh is not None:
                # The mesh is in the scan's coordinates; the body's own are metric.
                vertices = (vertices - smplx.translation) / scale
        record = {"model": "smplx", **smplx.to_json()}
        return Body(vertices, posed.faces, to_scan, smplx.orientation, smplx.upright, record)

    def estimated_body(
        self, posed: Mesh, picture: Picture, scan: Mesh, mesh_to_world: np.ndarray
    ) -> Body:
        """The body that an estimator saw in the scan's picture, brought to the scan.

        Args:
            posed: as `posed` gives it.
            picture: what the estimator saw.
            scan: in the coordinates of its file.
            mesh_to_world: (4, 4) that takes it into the world.

        Raises:
            MeshError: the body does not lie over the scan.
        """
        assert self.estimate is not None
        estimate = self.estimate
        to_world = estimate.to_world(posed, picture, scan.transformed(mesh_to_world))
        record = {
            "model": estimate.estimator,
            "camera": estimate.camera.tolist(),
            **estimate.record,
            **estimate.parameters.to_json(),
        }
        to_scan = np.linalg.inv(mesh_to_world) @ to_world
        return Body(posed.vertices, posed.faces, to_scan, parameters=record)
