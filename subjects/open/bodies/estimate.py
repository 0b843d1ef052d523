"""The body that an estimator would make of a picture: the exact one, with its published error.

A coarse back comes from a body model that a network estimated. Such a network errs; here its body
is the exact one with every joint turned and the shape changed at random, so much that the mean
error equals what is published for the network.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.open.base.template import anny_model, bare_body
from subjects.open.bodies import body
from subjects.open.bodies.skeleton import FINGERS, NECK, SIDES, SPINE, Pose, rotations

EstimatorName = Literal["exact", "pixie", "pymafx"]

JOINTS = (
    *("foot.L", "lowerleg01.L", "upperleg01.L", "foot.R", "lowerleg01.R", "upperleg01.R"),
    *("wrist.L", "lowerarm01.L", "upperarm01.L", "wrist.R", "lowerarm01.R", "upperarm01.R"),
    *("neck01", "head"),
)
"""The bones whose heads stand for the 14 joints that 3DPW's figures are over."""


@dataclass(frozen=True)
class Estimator:
    """A published estimator and the size of the turns that reach its error.

    Attributes:
        error_mm: mean joint error after Procrustes alignment (PA-MPJPE) on 3DPW.
        source: the paper that publishes `error_mm`.
        turn_deg: standard deviation of a turn of weight 1 in `WEIGHTS`.
    """

    title: str
    error_mm: float
    source: str
    turn_deg: float


ESTIMATORS: dict[str, Estimator] = {
    "pixie": Estimator("PIXIE", 61.3, "Feng et al., 3DV 2021, 3DPW", 10.42),
    "pymafx": Estimator("PyMAF-X (HR48)", 47.1, "Zhang et al., TPAMI 2023, 3DPW", 7.92),
}
"""Each `error_mm` is the PA-MPJPE on 3DPW that the estimator's own paper reports among its results
(PyMAF-X's with the HR48 backbone, not trained on 3DPW): measured there on photographs, over SMPL's
joints, and taken over here without running the network.

`turn_deg` was found by making the mean error over every pose and four draws of each, on twelve
bodies drawn as the humans' are, equal `error_mm`; benchmarks/estimate.py measures it on other ones.
"""
SPREAD = 0.2
"""Standard deviation of the logarithm of one draw's strength: some pictures are harder."""
HINGES = {"lowerarm01": ("upperarm01", "wrist"), "lowerleg01": ("upperleg01", "foot")}
"""Joints that bend about one axis -> the bones before and after: sideways they err little."""
SIDEWAYS = 0.3
WEIGHTS: dict[str, float] = {
    "clavicle": 0.35,
    "upperarm01": 1.0,
    "lowerarm01": 1.3,
    "wrist": 1.6,
    "upperleg01": 0.8,
    "lowerleg01": 1.1,
    "foot": 1.3,
}
"""How much a joint of either side turns: errors grow along a limb."""
TRUNK, HEAD, CURL = 0.9, 1.0, 1.5
"""The same of the whole spine, the whole neck, and each finger joint."""
BOTH_SIDES = 0.35
"""Share of a turn's variance that left and right have in common, forward or back: monocular
estimators mistake depth."""
SHAPE: dict[str, float] = {
    "age": 0.05,
    "gender": 0.12,
    "height": 0.04,
    "muscle": 0.12,
    "proportions": 0.15,
    "weight": 0.08,
}
"""Standard deviation of the phenotype's error at a strength of 1, on anny's scale of 0 to 1."""


def estimated(
    pose: Pose, rest: body.Rest, model_name: EstimatorName, generator: np.random.Generator
) -> tuple[np.ndarray, dict[str, Any]]:
    """The posed body as `model_name` would estimate it, and how it came about.

    Published accuracy, mean per-joint error after Procrustes alignment on 3DPW (14 joints):
    61.3 mm for PIXIE (Feng et al., "Collaborative regression of expressive bodies using
    moderation", 3DV 2021), 47.1 mm for PyMAF-X (Zhang et al., "PyMAF-X: towards well-aligned
    full-body model regression from monocular images", TPAMI 2023; HR48, not trained on 3DPW).

    The body is aligned to the exact one by the similarity (turn, length, shift) that takes its
    joints nearest: beside the picture there is a depth map of the front, which tells place, size
    and heading, and a body is fitted to it before its back is used. What is left is what the
    published figure measures.

    Returns:
        (19158, 3) float64 base mesh in the frame of the posed body, metres; and a JSON-ready
        record with "model" and, but for "exact", the estimator's figure, the draws, and the
        error measured.
    """
    turns = rotations(pose, rest)
    transforms = body.bone_transforms(rest, turns)
    exact = body.skin(rest.vertices, transforms)
    if model_name == "exact":
        return exact, {"model": "exact"}
    estimator = ESTIMATORS[model_name]
    strength = float(np.exp(generator.normal(-(SPREAD**2) / 2, SPREAD)))
    errors = _errors(turns, rest, strength * estimator.turn_deg, generator)
    phenotype = dict(rest.phenotype)
    for key, deviation in SHAPE.items():
        value = phenotype[key] + strength * float(generator.normal(0.0, deviation))
        phenotype[key] = float(np.clip(value, 0.0, 1.0))
    guess = body.rest_body(phenotype, rest.face)
    for bone, error in errors.items():
        turns[bone] = Rotation.from_rotvec(error, degrees=True).as_matrix() @ turns.get(
            bone, np.eye(3)
        )
    guessed = body.bone_transforms(guess, turns)
    joints, true_joints = joint_places(guess, guessed), joint_places(rest, transforms)
    scale, turn, shift = similarity(joints, true_joints)
    vertices = scale * (body.skin(guess.vertices, guessed) @ turn.T) + shift
    aligned = scale * (joints @ turn.T) + shift
    skin, _ = bare_body()
    return vertices, {
        "model": model_name,
        "estimator": estimator.title,
        "source": estimator.source,
        "published_pa_mpjpe_mm": estimator.error_mm,
        "pa_mpjpe_mm": _mean_distance_mm(aligned, true_joints),
        "vertex_error_mm": _mean_distance_mm(vertices[skin], exact[skin]),
        "strength": round(strength, 4),
        "turns_deg": {bone: np.round(error, 3).tolist() for bone, error in errors.items()},
        "phenotype": {key: round(value, 6) for key, value in phenotype.items()},
    }


def joint_places(rest: body.Rest, transforms: np.ndarray) -> np.ndarray:
    """(14, 3) metres: where `JOINTS` are in the body posed by `transforms` (J, 4, 4)."""
    labels = anny_model().bone_labels
    index = [labels.index(joint) for joint in JOINTS]
    heads = rest.bones[index, :3, 3] @ body.WORLD_TO_ANNY
    chosen = transforms[index]
    return np.einsum("nij,nj->ni", chosen[:, :3, :3], heads) + chosen[:, :3, 3]


def similarity(points: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation (3, 3) and shift (3,) that take `points` (N, 3) nearest to `target`.

    Source: Umeyama 1991, least-squares estimation of transformation parameters.
    """
    middle, target_middle = points.mean(axis=0), target.mean(axis=0)
    centred, aim = points - middle, target - target_middle
    u, singular, vt = np.linalg.svd(np.einsum("ni,nj->ij", aim, centred))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    turn = (u * sign) @ vt
    scale = float((singular * sign).sum() / (centred**2).sum())
    return scale, turn, target_middle - scale * turn @ middle


def _mean_distance_mm(a: np.ndarray, b: np.ndarray) -> float:
    return round(1000.0 * float(np.linalg.norm(a - b, axis=1).mean()), 2)


def _errors(
    turns: dict[str, np.ndarray],
    rest: body.Rest,
    deviation: float,
    generator: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Bone -> (3,) rotation vector in degrees of the error, in the world's axes."""
    errors: dict[str, np.ndarray] = {}
    for bones, weight in ((SPINE, TRUNK), (NECK, HEAD)):
        whole = generator.normal(0.0, weight * deviation, 3)
        errors |= {bone: whole / len(bones) for bone in bones}
    for joint, weight in WEIGHTS.items():
        both = np.array([generator.normal(), 0.0, 0.0])
        for side, _ in SIDES:
            own = generator.normal(0.0, 1.0, 3)
            error = np.sqrt(BOTH_SIDES) * both + np.sqrt(1.0 - BOTH_SIDES) * own
            error *= weight * deviation
            bone = f"{joint}.{side}"
            if joint in HINGES:
                error = _hinged(error, turns[bone], rest.joints, joint, side)
            errors[bone] = error
    for side, sign in SIDES:
        across = rest.joints[f"finger2-1.{side}"] - rest.joints[f"finger5-1.{side}"]
        bend = -sign * across / np.linalg.norm(across)
        for finger in FINGERS:
            curl = abs(generator.normal(0.0, CURL * deviation))
            for joint in ("1", "2"):
                errors[f"finger{finger}-{joint}.{side}"] = curl * bend
    return errors


def _hinged(
    error: np.ndarray, turn: np.ndarray, joints: dict[str, np.ndarray], joint: str, side: str
) -> np.ndarray:
    """`error` with little of it sideways, and not past straight."""
    before, after = HINGES[joint]
    along = joints[f"{joint}.{side}"] - joints[f"{before}.{side}"]
    below = joints[f"{after}.{side}"] - joints[f"{joint}.{side}"]
    hinge = np.cross(along, below)
    sine, cosine = np.linalg.norm(hinge), along @ below
    hinge = hinge / sine
    bent = np.degrees(np.arctan2(sine, cosine) + Rotation.from_matrix(turn).as_rotvec() @ hinge)
    # The axis of a knee is not exact at rest; a straight joint may err a little.
    bend = max(float(error @ hinge), -max(float(bent), 0.0))
    return bend * hinge + SIDEWAYS * (error - (error @ hinge) * hinge)
