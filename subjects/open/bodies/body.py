"""The bare body: a phenotype drawn from anny's population, posed by linear blend skinning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from subjects.open.base.template import anny_model, bone_weights
from subjects.open.bodies.face import displacement

# World (y up, facing +z) to anny's frame (z up, facing -y).
WORLD_TO_ANNY = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def draw_phenotype(
    generator: np.random.Generator, min_age: float, max_age: float
) -> tuple[float, dict[str, float]]:
    """An age in years and the phenotype of one adult, from anny's shape distribution.

    anny draws gender evenly in [0, 1]; most people are near either end, so it is drawn from
    Beta(1/4, 1/4) here.
    """
    import torch
    from anny.shape_distribution import SimpleShapeDistribution

    model = anny_model()
    # A span of zero is no distribution for torch; a microyear is no age for a person.
    ages = torch.tensor([min_age, max(max_age, min_age + 1e-6)], dtype=model.dtype)
    quarter = torch.tensor(0.25, dtype=model.dtype)
    population = SimpleShapeDistribution(
        model,
        morphological_age_distribution=torch.distributions.Uniform(ages[0], ages[1]),
        gender_distribution=torch.distributions.Beta(quarter, quarter),
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(generator.integers(2**62)))
        age, phenotype = population.sample(1)
    return float(age), {key: float(value) for key, value in sorted(phenotype.items())}


@dataclass(frozen=True, eq=False)
class Rest:
    """A body before it is posed, in the world's axes.

    Attributes:
        face: strength of each facial action, 0 to 1; they are in `vertices`.
        vertices: (19158, 3) float64 metres.
        bones: (J, 4, 4) rest pose of each bone, anny's frame.
        joints: bone label -> (3,) head of the bone in the reference pose (arms half raised).
    """

    phenotype: dict[str, float]
    face: dict[str, float]
    vertices: np.ndarray
    bones: np.ndarray
    joints: dict[str, np.ndarray]


def rest_body(phenotype: dict[str, float], face: dict[str, float] | None = None) -> Rest:
    """Shape the body that `phenotype` describes, with the facial actions of `face`.

    As in anny, a facial action moves the same vertices by the same lengths on every body, and no
    bone.
    """
    import torch

    face = face or {}

    model = anny_model()
    with torch.no_grad():
        output = model(phenotype_kwargs=phenotype)
    heads = output["bone_poses"][0, :, :3, 3].numpy() @ WORLD_TO_ANNY
    return Rest(
        phenotype,
        face,
        output["rest_vertices"][0].numpy() @ WORLD_TO_ANNY + displacement(face),
        output["rest_bone_poses"][0].numpy(),
        dict(zip(model.bone_labels, heads, strict=True)),
    )


def bone_transforms(rest: Rest, rotations: dict[str, np.ndarray]) -> np.ndarray:
    """Rest to posed transform of each bone, (J, 4, 4), in the world's axes.

    Args:
        rotations: bone label -> (3, 3) rotation against its parent, in the world's axes of the
            reference pose.
    """
    import torch

    model = anny_model()
    pose = np.tile(np.eye(4), (1, len(model.bone_labels), 1, 1))
    for bone, rotation in rotations.items():
        pose[0, model.bone_labels.index(bone), :3, :3] = WORLD_TO_ANNY @ rotation @ WORLD_TO_ANNY.T
    with torch.no_grad():
        transforms, _ = model.get_bone_transforms(
            torch.as_tensor(pose, dtype=model.dtype),
            torch.as_tensor(rest.bones[None], dtype=model.dtype),
        )
    turn = np.eye(4)
    turn[:3, :3] = WORLD_TO_ANNY
    return turn.T @ transforms[0].numpy() @ turn


def skin(vertices: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Linear blend skinning of the base mesh: (19158, 3) rest vertices to posed ones."""
    index, weight, _ = bone_weights()
    blended = np.einsum("nk,nkij->nij", weight, transforms[index][..., :3, :])
    return np.einsum("nij,nj->ni", blended[..., :3], vertices) + blended[..., 3]
