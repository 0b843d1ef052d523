"""A person's SMPL-X parameters in one form, whatever the form of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.fits.pickles import LARGEST_MB, read_json, read_npy, read_npz, read_pickle
from subjects.mesh import MeshError

Gender = Literal["neutral", "female", "male"]

BODY_JOINTS, HAND_JOINTS = 21, 15

_UP = np.array([0.0, 1.0, 0.0])
_SPINE, _LEGS = (2, 5, 8), ((0, 3), (1, 4))
"""Rows of `body_pose`: the spine's joints from below, and each leg's hip and knee."""

LARGEST_TURN = 4 * np.pi
"""Radians that a joint may turn; optimisers may go round once, degrees are more."""

ROTATION_TOLERANCE = 1e-2
"""On R^T R = 1 of rotation matrices; networks give theirs in single precision."""

_NAMES: dict[str, tuple[str, ...]] = {
    "betas": ("betas", "shape", "shape_params"),
    "expression": ("expression", "exp", "expression_params"),
    "global_orient": ("global_orient", "global_pose", "root_orient", "root_pose"),
    "body_pose": ("body_pose", "pose_body"),
    "left_hand_pose": ("left_hand_pose", "lhand_pose"),
    "right_hand_pose": ("right_hand_pose", "rhand_pose"),
    "jaw_pose": ("jaw_pose", "pose_jaw"),
    "leye_pose": ("leye_pose", "left_eye_pose"),
    "reye_pose": ("reye_pose", "right_eye_pose"),
    "transl": ("transl", "trans"),
    "translation": ("translation",),
    "scale": ("scale",),
}
"""What the files of fits and estimators call SMPL-X's parameters."""

_WHOLE = ("poses", "full_pose", "fullpose")
"""All 55 joints in one array, as AMASS has them: root, body, jaw, eyes, left and right hand."""

_HALVES = {
    "pose_hand": ("left_hand_pose", "right_hand_pose"),
    "pose_eye": ("leye_pose", "reye_pose"),
}


@dataclass(frozen=True, eq=False)
class Parameters:
    """SMPL-X parameters of one person.

    The body they mean is `scale * (SMPLX(betas, ..., reye_pose) + transl) + translation`, in the
    coordinates of the scan that it was fitted to. THuman2.0 gives a scale and a translation, ECON
    a transl and a scale, a metric scan's fit a transl alone.

    Attributes:
        betas: (B,) shape.
        expression: (E,).
        global_orient: (3,) axis-angle of the pelvis, radians.
        body_pose: (21, 3) axis-angle.
        left_hand_pose, right_hand_pose: (15, 3) axis-angle, or (C,) components of the model's
            hand space.
        jaw_pose, leye_pose, reye_pose: (3,) axis-angle.
        transl, translation: (3,).
        scale: scan units per metre; None where the file does not say it.
        gender: of the model, where the file says it.
        flat_hand_mean: whether hands are turns from the flat hand (else from the model's mean
            hand), where the file says it.
    """

    betas: np.ndarray
    expression: np.ndarray
    global_orient: np.ndarray
    body_pose: np.ndarray
    left_hand_pose: np.ndarray
    right_hand_pose: np.ndarray
    jaw_pose: np.ndarray
    leye_pose: np.ndarray
    reye_pose: np.ndarray
    transl: np.ndarray
    translation: np.ndarray
    scale: float | None
    gender: Gender | None = None
    flat_hand_mean: bool | None = None

    @property
    def orientation(self) -> np.ndarray:
        """(3, 3) rotation of the pelvis out of the model's frame (y up, facing +z)."""
        matrix: np.ndarray = Rotation.from_rotvec(self.global_orient).as_matrix()
        return matrix

    @property
    def upright(self) -> np.ndarray:
        """(3,) unit direction from the feet to the head: the mean of trunk, thighs and shins.

        A trunk that bows, or thighs that sit, alone tilt it by no more than 27 degrees.
        """
        body = Rotation.from_rotvec(self.body_pose)
        pelvis = Rotation.from_rotvec(self.global_orient)
        trunk, turn = pelvis.apply(_UP), pelvis
        for joint in _SPINE:
            turn = turn * body[joint]
            trunk = trunk + turn.apply(_UP)
        legs = np.zeros(3)
        for hip, knee in _LEGS:
            thigh = pelvis * body[hip]
            legs = legs + (thigh.apply(_UP) + (thigh * body[knee]).apply(_UP)) / 2
        whole = trunk / np.linalg.norm(trunk) + legs
        unit: np.ndarray = whole / max(np.linalg.norm(whole), 1e-12)
        return unit

    def to_json(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in vars(self).items()
        }


def read_values(path: Path, largest_mb: float = LARGEST_MB) -> Mapping[str, Any]:
    """The named values of a .pkl, .npz, .npy or .json file.

    Args:
        path: the file.
        largest_mb: most megabytes that it may hold, and may unpack to.

    Raises:
        MeshError: the file cannot be read, or holds no named values.
    """
    kind = path.suffix.lower()
    if kind == ".npz":
        values: Any = read_npz(path, largest_mb)
    elif kind == ".npy":
        values = read_npy(path, largest_mb)
    elif kind == ".json":
        values = read_json(path, largest_mb)
    elif kind in (".pkl", ".pickle", ".pt", ".pth"):
        values = read_pickle(path, largest_mb)
    else:
        raise MeshError(
            f"{path}: '{path.suffix}' is no known format of parameters; "
            "give .pkl, .npz, .npy or .json"
        )
    if isinstance(values, np.ndarray) and values.dtype == object and values.size == 1:
        values = values.item()
    if isinstance(values, list | tuple) and len(values) == 1:
        values = values[0]
    if not isinstance(values, Mapping):
        raise MeshError(
            f"{path}: holds a {type(values).__name__} where parameters by name are due; "
            "export them as a dictionary of one person"
        )
    return values


def read_parameters(path: Path, largest_mb: float = LARGEST_MB) -> Parameters:
    """The SMPL-X parameters of one person that `path` holds, of whatever schema.

    Raises:
        MeshError: as `read_values` and `parameters_from`.
    """
    return parameters_from(read_values(path, largest_mb), path)


def parameters_from(values: Mapping[str, Any], path: Path) -> Parameters:
    """SMPL-X parameters from named values: the schema is told by keys and sizes.

    Leading axes of length one are dropped. Rotations are axis-angles, or matrices as estimators
    give them. Hands are axis-angles of 15 joints or up to 44 components. What is left out is zero,
    but for the body's pose and shape.

    Args:
        values: by the names of THuman2.0, PIXIE, AMASS and their kin.
        path: the file, for messages.

    Raises:
        MeshError: a value is missing, of another shape, of several people, or not finite.
    """
    try:
        return _from(_named(values))
    except _WrongError as error:
        raise MeshError(f"{path}: {error}") from None


class _WrongError(ValueError):
    """What is wrong with the values of a file; the message does not name the file."""


def _from(named: Mapping[str, Any]) -> Parameters:
    for name in ("betas", "body_pose"):
        if named.get(name) is None:
            raise _WrongError(
                f"has no {name} (its keys: {', '.join(sorted(map(str, named))[:12])}); "
                "give SMPL-X parameters"
            )
    left, right = (_hand(named, f"{side}_hand_pose") for side in ("left", "right"))
    matrices = any(_is_matrices(named.get(f"{side}_hand_pose")) for side in ("left", "right"))
    scale = None if named.get("scale") is None else float(_numbers(named, "scale", 1)[0])
    if scale is not None and not scale > 0:
        raise _WrongError(f"has a scale of {scale:g}, which is no size; correct the fit")
    return Parameters(
        betas=_numbers(named, "betas"),
        expression=_numbers(named, "expression", default=0.0),
        global_orient=_turns(named, "global_orient", 1)[0],
        body_pose=_turns(named, "body_pose", BODY_JOINTS),
        left_hand_pose=left,
        right_hand_pose=right,
        jaw_pose=_turns(named, "jaw_pose", 1)[0],
        leye_pose=_turns(named, "leye_pose", 1)[0],
        reye_pose=_turns(named, "reye_pose", 1)[0],
        transl=_numbers(named, "transl", 3, default=0.0),
        translation=_numbers(named, "translation", 3, default=0.0),
        scale=scale,
        gender=_gender(named.get("gender")),
        # A matrix is a joint's whole turn; the model's mean hand is no part of it.
        flat_hand_mean=True if matrices else _flag(named.get("flat_hand_mean")),
    )


def _named(values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` under SMPL-X's own names."""
    named = {str(key): value for key, value in values.items()}
    for name, aliases in _NAMES.items():
        given = [alias for alias in aliases if named.get(alias) is not None]
        if given:
            named[name] = named[given[0]]
    for both, (left, right) in _HALVES.items():
        if named.get(both) is not None:
            half = _flat(named[both], both)
            named[left], named[right] = np.split(half[: len(half) // 2 * 2], 2)
    for whole in _WHOLE:
        if named.get(whole) is not None:
            joints = _joints(named[whole], whole, 55)
            named |= {
                "global_orient": joints[:1],
                "body_pose": joints[1:22],
                "jaw_pose": joints[22:23],
                "leye_pose": joints[23:24],
                "reye_pose": joints[24:25],
                "left_hand_pose": joints[25:40],
                "right_hand_pose": joints[40:],
            }
    return named


def _flat(value: Any, name: str) -> np.ndarray:
    """(N,) float64 of any numeric value."""
    try:
        flat = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        raise _WrongError(f"has a {name} that is no array of numbers; export it again") from None
    if not np.isfinite(flat).all():
        raise _WrongError(f"has a {name} that is NaN or infinite; fit the body again")
    return flat


def _numbers(
    named: Mapping[str, Any], name: str, size: int | None = None, default: float | None = None
) -> np.ndarray:
    """(size,) of a parameter, or (N,) of any where no `size` is due."""
    if named.get(name) is None:
        return np.full(size or 0, default)
    flat = _flat(named[name], name)
    shape = np.shape(named[name])
    if size is not None and len(flat) != size:
        raise _WrongError(
            f"has a {name} of shape {shape} where {size} value{'s' if size > 1 else ''} "
            f"{'are' if size > 1 else 'is'} due{_several(shape)}"
        )
    if size is None and int(np.prod(shape[:-1])) != 1:
        raise _WrongError(f"has a {name} of shape {shape}{_several(shape)}")
    return flat


def _turns(named: Mapping[str, Any], name: str, joints: int) -> np.ndarray:
    """(joints, 3) axis-angle of a parameter; zero where it is missing."""
    if named.get(name) is None:
        return np.zeros((joints, 3))
    return _joints(named[name], name, joints)


def _joints(value: Any, name: str, joints: int) -> np.ndarray:
    """(joints, 3) axis-angle from axis-angles or matrices."""
    flat = _flat(value, name)
    shape = np.shape(value)
    if len(flat) == 3 * joints:
        turns = flat.reshape(joints, 3)
        if np.linalg.norm(turns, axis=1).max() > LARGEST_TURN:
            raise _WrongError(f"has a {name} of many turns, as if in degrees; give radians")
        return turns
    if len(flat) == 9 * joints and _is_matrices(value):
        matrices = flat.reshape(joints, 3, 3)
        off = np.abs(matrices.transpose(0, 2, 1) @ matrices - np.eye(3)).max()
        if off > ROTATION_TOLERANCE or (np.linalg.det(matrices) < 0).any():
            raise _WrongError(f"has a {name} whose matrices are no rotations; export it again")
        from_matrices: np.ndarray = Rotation.from_matrix(matrices).as_rotvec()
        return from_matrices
    hint = _several(shape)
    if name == "body_pose" and len(flat) == 32:
        hint = ": it is a code of VPoser; decode it into 21 joints first"
    elif name == "body_pose" and len(flat) in (69, 207):
        hint = ": it is SMPL's, of 23 joints; give SMPL-X's"
    raise _WrongError(
        f"has a {name} of shape {shape} where {joints} joints of 3 values (or 3x3) are due{hint}"
    )


def _hand(named: Mapping[str, Any], name: str) -> np.ndarray:
    """(15, 3) axis-angle, or (C,) components."""
    value = named.get(name)
    if value is None:
        return np.zeros((HAND_JOINTS, 3))
    flat = _flat(value, name)
    if len(flat) < 3 * HAND_JOINTS and int(np.prod(np.shape(value)[:-1])) == 1 and len(flat):
        return flat
    return _joints(value, name, HAND_JOINTS)


def _is_matrices(value: Any) -> bool:
    return value is not None and np.shape(value)[-2:] == (3, 3)


def _several(shape: tuple[int, ...]) -> str:
    many = len(shape) > 1 and shape[0] > 1
    return f"; a file holds one person, this may be {shape[0]}" if many else ""


def _gender(value: Any) -> Gender | None:
    if value is None:
        return None
    while isinstance(value, np.ndarray | list | tuple) and np.size(np.asarray(value, object)) == 1:
        value = np.asarray(value, object).ravel()[0]
    text = value if isinstance(value, str | bytes) else type(value).__name__
    text = text.decode("ascii", errors="replace") if isinstance(text, bytes) else str(text)
    for gender in get_args(Gender):
        if text.strip().lower() == gender:
            return gender
    raise _WrongError(f"says the gender '{text}'; give one of {', '.join(get_args(Gender))}")


def _flag(value: Any) -> bool | None:
    return None if value is None else bool(_flat(value, "flat_hand_mean").all())
