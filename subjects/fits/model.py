"""SMPL-X, the licensed body model: its files, and the bodies that it makes of parameters."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from storage.mirror import local_folder
from subjects.fits.parameters import Gender, Parameters
from subjects.fits.pickles import read_npz, read_pickle
from subjects.mesh import Mesh, MeshError

if TYPE_CHECKING:
    import smplx

VERTICES, FACES, JOINTS = 10475, 20908, 55

SOURCE = "models_smplx_v1_1.zip from https://smpl-x.is.tue.mpg.de (free for research, on request)"
"""Where the model's files are licensed from."""

LARGEST_MODEL_MB = 1024

_SHAPES: dict[str, tuple[int | None, ...]] = {
    "v_template": (VERTICES, 3),
    "f": (FACES, 3),
    "shapedirs": (VERTICES, 3, None),
    "posedirs": (VERTICES, 3, 9 * (JOINTS - 1)),
    "J_regressor": (JOINTS, VERTICES),
    "kintree_table": (2, JOINTS),
    "weights": (VERTICES, JOINTS),
    "lmk_faces_idx": (None,),
    "lmk_bary_coords": (None, 3),
    "hands_componentsl": (45, 45),
    "hands_componentsr": (45, 45),
    "hands_meanl": (45,),
    "hands_meanr": (45,),
}
"""What a model file has to hold; None is any length."""

_SHAPE_SPACE, _EXPRESSION_SPACE = 300, 100
"""Components of a whole model; a small one has 10 and 10."""


def find_model(folder: str | None, gender: Gender) -> Path:
    """The file of SMPL-X's model of `gender` in `folder`, or in what its archive unpacks to.

    Raises:
        MeshError: there is none; the message says which file to put where.
    """
    name = f"SMPLX_{gender.upper()}"
    if folder is None:
        raise MeshError(
            f"needs SMPL-X's {gender} model to be posed: put {name}.npz, of {SOURCE}, into a "
            "folder and give it as subjects.models, or give posed bodies (subjects.fits.mesh)"
        )
    root = local_folder(folder)
    for below in (".", "smplx", "models/smplx"):
        for suffix in (".npz", ".pkl"):
            path = root / below / f"{name}{suffix}"
            if path.is_file():
                return path
    raise MeshError(
        f"needs SMPL-X's {gender} model to be posed: put {name}.npz, of {SOURCE}, into "
        f"'{root}' (subjects.models)"
    )


def has_model(folder: str | None, gender: Gender) -> bool:
    """Whether `find_model` finds one, and the package to pose it is installed."""
    try:
        find_model(folder, gender)
    except MeshError:
        return False
    return find_spec("smplx") is not None


@dataclass(frozen=True, eq=False)
class Posed:
    """A body of SMPL-X.

    Attributes:
        mesh: 10475 vertices, metres, and 20908 faces.
        record: what it was made with, JSON-ready: gender, hands, the model's file and checksum.
    """

    mesh: Mesh
    record: dict[str, Any]


def posed(
    fit: Path,
    folder: str | None,
    gender: Gender,
    parameters: Parameters,
    flat_hand_mean: bool = False,
    vertices: np.ndarray | None = None,
) -> Posed:
    """SMPL-X's body of the parameters in a file.

    Args:
        fit: the file, for messages.
        folder: of the model's files.
        gender: of the model.
        parameters: in `fit`.
        flat_hand_mean: of parameters that do not say it.
        vertices: (10475, 3) metres where they are known and the model gives the faces alone.

    Raises:
        MeshError: as of `find_model` and `pose`.
    """
    try:
        path = find_model(folder, gender)
        if parameters.flat_hand_mean is not None:
            flat_hand_mean = parameters.flat_hand_mean
        if vertices is None:
            vertices = pose(path, parameters, flat_hand_mean)
        shape = _shape(path)
        record = {
            "gender": gender,
            "flat_hand_mean": flat_hand_mean,
            "model_file": path.name,
            "model_sha256": shape.sha256,
        }
        return Posed(Mesh(vertices, shape.faces), record)
    except MeshError as error:
        raise MeshError(f"{fit}: {error}") from None


def pose(model: Path, parameters: Parameters, flat_hand_mean: bool) -> np.ndarray:
    """(10475, 3) float64 metres: SMPL-X's vertices, posed by the `smplx` package.

    Args:
        model: SMPLX_*.npz or .pkl.
        parameters: their translation and scale play no part, their transl does.
        flat_hand_mean: as `Parameters.flat_hand_mean`, which plays no part.

    Raises:
        MeshError: the model cannot be read, or has not as many components as the parameters.
    """
    if find_spec("smplx") is None:
        raise MeshError("needs the package smplx to be posed; install it: pip install smplx")
    import torch

    left, right = parameters.left_hand_pose, parameters.right_hand_pose
    # One layout for both hands: components only where both have as many.
    components = len(left) if left.ndim == right.ndim == 1 and len(left) == len(right) else None
    body = _layer(
        model,
        components,
        flat_hand_mean,
        len(parameters.betas),
        len(parameters.expression),
    )
    hands = {"left_hand_pose": left, "right_hand_pose": right}
    if components is None:
        hands = {name: _axis_angles(model, name, hand) for name, hand in hands.items()}
    values = {
        "betas": parameters.betas,
        "expression": parameters.expression,
        "global_orient": parameters.global_orient,
        "body_pose": parameters.body_pose,
        "jaw_pose": parameters.jaw_pose,
        "leye_pose": parameters.leye_pose,
        "reye_pose": parameters.reye_pose,
        "transl": parameters.transl,
        **hands,
    }
    tensors = {
        name: torch.from_numpy(value.reshape(1, -1).astype(np.float64))
        for name, value in values.items()
    }
    with torch.no_grad():
        vertices: np.ndarray = body(**tensors).vertices[0].numpy()
    return vertices.astype(np.float64)


def _axis_angles(model: Path, name: str, hand: np.ndarray) -> np.ndarray:
    """(15, 3) of a hand that may be given by components."""
    if hand.ndim == 2:
        return hand
    turned: np.ndarray = hand @ _shape(model).hands[name[0]][: len(hand)]
    return turned.reshape(-1, 3)


class _Shape(NamedTuple):
    """The small part of a model, which is kept.

    faces: (20908, 3) int32. hands: side "l" or "r" -> (45, 45) components.
    """

    faces: np.ndarray
    hands: dict[str, np.ndarray]
    sha256: str


@lru_cache(maxsize=6)
def _shape(model: Path) -> _Shape:
    members = _read(model)
    with model.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    hands = {side: np.array(members[f"hands_components{side}"]) for side in "lr"}
    return _Shape(members["f"].astype(np.int32), hands, sha256)


@lru_cache(maxsize=4)
def _layer(
    model: Path, components: int | None, flat_hand_mean: bool, betas: int, expressions: int
) -> smplx.SMPLX:
    """The `smplx` package's model, set up for parameters of these sizes."""
    import smplx
    import torch

    members = _read(model)
    whole = members["shapedirs"].shape[2] >= _SHAPE_SPACE + _EXPRESSION_SPACE
    most = (_SHAPE_SPACE, _EXPRESSION_SPACE) if whole else (10, 10)
    for name, count, limit in zip(("betas", "expression"), (betas, expressions), most, strict=True):
        if count > limit:
            raise MeshError(
                f"{model}: has {limit} components where the fit has {count} of {name}; "
                "use the model's v1.1 files"
            )
    with tempfile.TemporaryDirectory(prefix="rectoverso-") as folder:
        # The package would load the file's pickled members; it is handed plain arrays.
        plain = Path(folder) / "SMPLX.npz"
        np.savez(plain, **members)
        return smplx.SMPLX(
            str(plain),
            ext="npz",
            use_pca=components is not None,
            num_pca_comps=components or 45,
            flat_hand_mean=flat_hand_mean,
            num_betas=betas,
            num_expression_coeffs=expressions,
            dtype=torch.float64,
        )


def _read(model: Path) -> dict[str, np.ndarray]:
    """The arrays of a model file that posing needs, checked."""
    is_npz = model.suffix == ".npz"
    found: Any = (read_npz if is_npz else read_pickle)(model, LARGEST_MODEL_MB)
    if not isinstance(found, Mapping):
        raise MeshError(f"{model}: holds no members by name, so it is no SMPL-X model")
    members = {}
    for name, shape in _SHAPES.items():
        if name not in found:
            raise MeshError(
                f"{model}: has no member '{name}', so it is no SMPL-X model; copy it "
                f"again from {SOURCE}"
            )
        array = found[name] if isinstance(found[name], np.ndarray) else np.zeros(0)
        fits = array.ndim == len(shape) and all(
            due in (None, size) for due, size in zip(shape, array.shape, strict=True)
        )
        if not fits or array.dtype.kind not in "iuf":
            due = ", ".join("any" if n is None else str(n) for n in shape)
            raise MeshError(
                f"{model}: its member '{name}' has shape {array.shape} where ({due}) is due: "
                "it is no SMPL-X model"
            )
        members[name] = array
    return members
