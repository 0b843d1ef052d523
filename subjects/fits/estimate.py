"""What an estimator makes of a person's picture: PIXIE's and PyMAF-X's bodies.

Both see one picture and know neither its scale nor how far the person is. Their camera says where
the body is in the picture; the depth of the scan's front says how far.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from subjects.crossings import extents
from subjects.fits import model
from subjects.fits.body import Body
from subjects.fits.parameters import Parameters, parameters_from, read_values
from subjects.fits.pattern import Place
from subjects.fits.pickles import LARGEST_MB
from subjects.fits.similarity import compose
from subjects.mesh import Mesh, MeshError

TO_OPENGL = np.diag([1.0, -1.0, -1.0])
"""From the estimators' frame (x right, y down, z away from the viewer) to the camera's."""

PIXIE_SIDE, PIXIE_MARGIN = 224, 1.1
"""Pixels of PIXIE's crop, and its side over the larger one of the person's box."""

STRIDE = 2
"""Every so many pixels of the picture a line of sight compares the two fronts."""

SCALE_TOLERANCE = 0.01
"""Between PyMAF-X's scales of width and height, which are one in the picture's own pixels."""

LEAST_OVERLAP = 0.3
"""Share of an estimate's silhouette that has to lie on its scan; else it is another person's."""


@dataclass(frozen=True)
class Picture:
    """The picture that an estimator was given: the scan's front, as a build with the same scans and
    fits, but no estimates, renders it."""

    rows: int = 424
    """Height in pixels."""
    columns: int = 512
    """Width in pixels."""
    pixel_size: float = 0.005
    """Metres that a pixel is wide."""
    yaw_deg: float = 0.0
    """By which the person was turned, as a view's yaw."""

    def __post_init__(self) -> None:
        for name in ("rows", "columns"):
            if getattr(self, name) < 1:
                raise ValueError(
                    f"subjects.estimates.picture.{name}: give a number of pixels above 0"
                )
        if not 0 < self.pixel_size < 1:
            raise ValueError(
                f"subjects.estimates.picture.pixel_size: {self.pixel_size} m; "
                "give metres per pixel, such as 0.005"
            )


@dataclass(frozen=True, eq=False)
class Estimate:
    """A body estimated from a picture, in the estimator's frame.

    Attributes:
        file: that it was read from.
        estimator: "pixie" or "pymafx".
        parameters: SMPL-X's.
        camera: of the estimator, as its file has it.
        posed: metres; x right, y down, z away from the viewer.
        box: left, top, right, bottom of PIXIE's crop in pixels, before its margin; None where the
            whole picture was taken.
        record: what else is to be kept, JSON-ready.
    """

    file: Path
    estimator: str
    parameters: Parameters
    camera: np.ndarray
    posed: Mesh
    box: np.ndarray | None = None
    record: dict[str, Any] = field(default_factory=dict)

    def body(self, picture: Picture, level: float, scan: Mesh, mesh_to_world: np.ndarray) -> Body:
        """The body, brought to the scan.

        Args:
            picture: what the estimator saw.
            level: height of the picture's centre in the world, metres.
            scan: in the coordinates of its file.
            mesh_to_world: (4, 4) that takes it into the world.

        Raises:
            MeshError: the body does not lie over the scan.
        """
        to_world = self.to_world(picture, level, scan.transformed(mesh_to_world))
        record = {
            "model": self.estimator,
            "camera": self.camera.tolist(),
            **self.parameters.to_json(),
            **self.record,
            "scale": float(np.linalg.norm(to_world[:3, 0])),
        }
        to_scan = np.linalg.inv(mesh_to_world) @ to_world
        record["body_to_scan"] = to_scan.tolist()
        return Body(self.posed.vertices, self.posed.faces, to_scan, parameters=record)

    def in_picture(self, picture: Picture) -> tuple[float, np.ndarray]:
        """Pixels per metre, and (2,) the column and row where the body's x = y = 0 falls.

        (0, 0) is the upper left corner of the picture; a pixel's centre is half a pixel on.

        Raises:
            MeshError: the crop is not known.
        """
        if self.estimator == "pymafx":
            # The whole picture is [-1, 1] in both directions: u = W/2 (1 + sx (x + tx)).
            half = np.array([picture.columns, picture.rows]) / 2
            scales, shift = self.camera[:2] * half, self.camera[2:]
            if abs(scales[0] - scales[1]) > SCALE_TOLERANCE * abs(scales).max():
                raise MeshError(
                    f"its picture was not {picture.columns} x {picture.rows} pixels (the camera's "
                    f"scales are {scales[0]:.1f} and {scales[1]:.1f} pixels per metre there); "
                    "correct subjects.estimates.picture"
                )
            return float(scales.mean()), half + scales * shift
        left, top, right, bottom = self._box(picture)
        side = int(PIXIE_MARGIN * max(right - left, bottom - top)) if self.box is not None else (
            picture.rows - 1
        )  # fmt: skip
        middle = np.array([left + right, top + bottom]) / 2
        # The crop's corners become the centres of its first and last pixels.
        per_pixel = side / (PIXIE_SIDE - 1)
        scale = self.camera[0] * PIXIE_SIDE / 2 * per_pixel
        corner = middle - side / 2 + 0.5
        return float(scale), corner + PIXIE_SIDE / 2 * per_pixel + scale * self.camera[1:]

    def _box(self, picture: Picture) -> np.ndarray:
        if self.box is not None:
            return self.box
        if picture.rows != picture.columns:
            raise MeshError(
                "PIXIE's file names no bbox, and its whole picture is not square; "
                "let PIXIE crop, or give it square pictures"
            )
        return np.array([0, 0, picture.columns - 1, picture.rows - 1], dtype=np.float64)

    def to_world(self, picture: Picture, level: float, scan: Mesh) -> np.ndarray:
        """(4, 4) similarity from the estimator's frame to the subject's world.

        Across the picture the camera places the body. Towards the viewer the median over all lines
        of sight that meet both brings its front to the scan's.

        Args:
            picture: what the estimator saw.
            level: height of the picture's centre in the world, metres.
            scan: in the world, metres.

        Raises:
            MeshError: the body does not lie over the scan.
        """
        per_metre, origin = self.in_picture(picture)
        scale = per_metre * picture.pixel_size
        if not np.isfinite(scale) or scale <= 0:
            raise MeshError(f"its camera has the scale {per_metre:g}; estimate the body again")
        size = np.array([picture.columns, picture.rows])
        across = (origin - size / 2) * [1, -1] * picture.pixel_size
        to_camera = compose(scale, TO_OPENGL, np.array([*across, 0.0]))

        angle = np.radians(picture.yaw_deg)
        cos, sin = np.cos(angle), np.sin(angle)
        camera_to_world = np.eye(4)
        camera_to_world[:3, :3] = [[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]]
        camera_to_world[1, 3] = level

        columns, rows = (np.arange(0, n, STRIDE) + 0.5 - n / 2 for n in size)
        x, y = np.meshgrid(columns, -rows)
        xy = np.stack([x.ravel(), y.ravel()], axis=1) * picture.pixel_size
        seen = (self.posed.transformed(to_camera), scan.transformed(np.linalg.inv(camera_to_world)))
        fronts = [extents(xy, mesh.vertices, mesh.faces)[0] for mesh in seen]
        both = np.isfinite(fronts[0]) & np.isfinite(fronts[1])
        if not both.any() or both.sum() < LEAST_OVERLAP * np.isfinite(fronts[0]).sum():
            raise MeshError(
                "its estimated body does not lie over it; correct subjects.estimates.picture, "
                "or it is another picture's"
            )
        to_camera[2, 3] = np.median(fronts[1][both] - fronts[0][both])
        to_world: np.ndarray = camera_to_world @ to_camera
        return to_world


def read_estimate(
    path: Path, place: Place, models: str | None, largest_mb: float = LARGEST_MB
) -> Estimate:
    """The estimate that PIXIE's *_param.pkl or PyMAF-X's output.pkl holds of one scan's picture.

    PyMAF-X writes one file for a folder of pictures; the picture is found by its name, which is
    the scan's {id} or {name}.

    Args:
        path: the file.
        place: the scan.
        models: folder of SMPL-X's files; PyMAF-X's bodies take its triangles only.
        largest_mb: most megabytes that the file may hold, and may unpack to.

    Raises:
        MeshError: something is missing, of another shape, or not of that picture.
    """
    status = path.stat()
    values = _values(path, largest_mb, status.st_mtime_ns, status.st_size)
    if "body_cam" not in values and "orig_cam" not in values:
        raise MeshError(
            f"{path}: has neither PIXIE's body_cam nor PyMAF-X's orig_cam; give an estimator's "
            "output, or a fit's parameters as subjects.fits.parameters"
        )
    if "body_cam" in values:
        camera = _array(values, "body_cam", (3,), path)
        box = None if values.get("bbox") is None else _array(values, "bbox", (4,), path)
        parameters = parameters_from(values, path)
        posed = model.posed(path, models, "neutral", parameters, flat_hand_mean=True)
        return Estimate(path, "pixie", parameters, camera, posed.mesh, box, posed.record)
    cameras = _array(values, "orig_cam", (-1, 4), path)
    row, name = _row(values, len(cameras), path, place)
    vertices = _row_of(values, "smplx_verts", len(cameras), row, (model.VERTICES, 3), path)
    camera = cameras[row]
    parameters = parameters_from(_pymafx_parameters(values, len(cameras), row, path), path)
    posed = model.posed(path, models, "neutral", parameters, True, vertices)
    return Estimate(
        path, "pymafx", parameters, camera, posed.mesh, record=posed.record | {"person": name}
    )


@lru_cache(maxsize=1)
def _values(path: Path, largest_mb: float, _changed: int, _size: int) -> Mapping[str, Any]:
    """The values of a file, kept for the next scan: PyMAF-X's holds everybody."""
    return read_values(path, largest_mb)


def _row(values: Mapping[str, Any], people: int, path: Path, place: Place) -> tuple[int, str]:
    """Which person of PyMAF-X's file belongs to a scan."""
    given = values.get("person_ids")
    names = [str(name) for name in given] if isinstance(given, list | tuple | np.ndarray) else []
    if len(names) != people:
        raise MeshError(f"{path}: has {people} cameras and {len(names)} person_ids; run it again")
    stems = [re.sub(r"_f\d+_p\d+$", "", name) for name in names]
    # An id is one scan's alone; scans of several folders may share a name.
    wanted = place.id if place.id in stems else place.name
    rows = [i for i, stem in enumerate(stems) if stem == wanted]
    if len(rows) != 1:
        found = f"{len(rows)} people" if rows else "nobody"
        raise MeshError(
            f"{path}: has {found} of a picture called '{place.id}' or '{place.name}' (it has "
            f"{', '.join(names[:4])}{' ...' if people > 4 else ''}); name the pictures by the scans"
        )
    return rows[0], names[rows[0]]


def _row_of(
    values: Mapping[str, Any],
    name: str,
    people: int,
    row: int,
    shape: tuple[int, ...],
    path: Path,
) -> np.ndarray:
    """One person's part of a member, without a copy of everybody's."""
    array = values.get(name)
    if not isinstance(array, np.ndarray) or array.shape != (people, *shape):
        found = np.shape(array) if isinstance(array, np.ndarray) else type(array).__name__
        raise MeshError(f"{path}: its {name} is {found}, not {(people, *shape)}; run it again")
    return _array({name: array[row]}, name, shape, path)


_PYMAFX = {
    "shape": "betas",
    "expression": "expression",
    "left_hand_pose": "left_hand_pose",
    "right_hand_pose": "right_hand_pose",
    "jaw_pose": "jaw_pose",
    "leye_pose": "leye_pose",
    "reye_pose": "reye_pose",
}
"""PyMAF-X's names -> SMPL-X's, but for the body, whose first joint is the pelvis."""


def _pymafx_parameters(
    values: Mapping[str, Any], people: int, row: int, path: Path
) -> dict[str, np.ndarray]:
    """SMPL-X parameters of one row; the file has them by batches of pictures."""
    batches = values.get("smplx_params")
    if not isinstance(batches, Sequence) or not all(isinstance(b, Mapping) for b in batches):
        raise MeshError(f"{path}: has no list of smplx_params; run PyMAF-X's SMPL-X demo")

    def whole(name: str) -> np.ndarray | None:
        parts = [batch[name] for batch in batches if batch.get(name) is not None]
        if not parts:
            return None
        try:
            joined = np.concatenate([np.asarray(part, dtype=np.float64) for part in parts])
        except (TypeError, ValueError, OverflowError):
            joined = np.zeros(0)
        if len(joined) != people:
            raise MeshError(f"{path}: its {name} is not of {people} people; run PyMAF-X again")
        return joined[row]

    body = whole("body_pose")
    if body is None or body.ndim != 3 or len(body) < 22:
        raise MeshError(f"{path}: its smplx_params lack body_pose of 22 joints or more")
    found = {ours: whole(theirs) for theirs, ours in _PYMAFX.items()}
    given = {name: value for name, value in found.items() if value is not None}
    return given | {"global_orient": body[:1], "body_pose": body[1:22]}


def _array(values: Mapping[str, Any], name: str, shape: tuple[int, ...], path: Path) -> np.ndarray:
    """A numeric member reshaped to `shape`."""
    try:
        array = np.asarray(values[name], dtype=np.float64)
        if not np.isfinite(array).all():
            raise ValueError
        return array.reshape(shape)
    except (KeyError, TypeError, ValueError, OverflowError):
        due = ", ".join("any" if n < 0 else str(n) for n in shape)
        raise MeshError(
            f"{path}: its {name} is not ({due}) finite numbers; run the estimator again"
        ) from None
