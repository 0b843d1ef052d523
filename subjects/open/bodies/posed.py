"""A body that has taken a pose: the draw of one it can take, and the way into it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.mesh import MeshError
from subjects.open.base import surface
from subjects.open.base.subdivision import triangles
from subjects.open.base.template import BODY, bare_body, template
from subjects.open.bodies import body
from subjects.open.bodies.penetration import ALLOWED, penetration
from subjects.open.bodies.poses import POSES
from subjects.open.bodies.skeleton import Pose, mirrored, rotations, varied

if TYPE_CHECKING:
    from collections.abc import Iterator

ATTEMPTS = 18
"""Draws of one pose, each standing a little more clear of itself, before another is tried."""
CLEARANCE_STEP = 0.3
CLOTH = 0.003
"""Metres that a limb is taken to be thicker all round: between arm and trunk lies cloth."""


@dataclass(frozen=True, eq=False)
class Posed:
    """A posed bare body and how it came about.

    Attributes:
        vertices: (19158, 3) base mesh in the world frame, before it is set on the ground.
        rest: the body before.
        transforms: (J, 4, 4) that take the bones of `rest` to the pose, see `body.skin`.
        depth: metres that one limb, as thick as clothes make it, stands inside another part,
            and `where`.
        attempts: draws it took, those of poses given up included.
    """

    name: str
    pose: Pose
    vertices: np.ndarray
    rest: body.Rest
    transforms: np.ndarray
    depth: float
    where: str
    attempts: int


def draw_pose(
    names: list[str],
    hard_share: float,
    max_height: float,
    subject: str,
    generator: np.random.Generator,
    rest: body.Rest,
) -> Posed:
    """The first draw whose limbs stay out of each other, and which is low enough.

    Args:
        names: of the poses to choose from.
        hard_share: probability that the hard ones of them are tried first; else the others are.
            Where they are all of one kind, it has no effect.
        max_height: that the posed bare body may reach, metres.
        subject: the id that an error names.

    Raises:
        MeshError: none of the poses suits the body.
    """
    skin, _ = bare_body()
    draws = 0
    for name in _order(names, hard_share, generator):
        pose = POSES[name]
        if generator.random() < 0.5:
            pose = mirrored(pose)
        arm_room = leg_room = 0.0
        for _ in range(ATTEMPTS):
            draws += 1
            drawn = varied(pose, generator, arm_room, leg_room)
            transforms = body.bone_transforms(rest, rotations(drawn, rest))
            vertices = body.skin(rest.vertices, transforms)
            if np.ptp(vertices[skin, 1]) > max_height:
                break  # arms that reach too high do so in every variation
            depth, where = penetration(clad(vertices))
            if depth <= ALLOWED:
                return Posed(name, drawn, vertices, rest, transforms, depth, where, draws)
            if "arm" in where:
                arm_room += CLEARANCE_STEP
            else:
                leg_room += CLEARANCE_STEP
    raise MeshError(
        f"{subject}: no pose of {', '.join(names)} keeps this body's limbs apart and "
        f"below {max_height:.2f} m; allow more in subjects.poses or a larger subjects.max_height"
    )


def clad(vertices: np.ndarray) -> np.ndarray:
    """(19158, 3) base mesh, as thick as clothes make its skin."""
    outward = surface.normals(vertices, triangles(template().groups[BODY].quads))
    return vertices + CLOTH * outward


def approach(pose: Pose, rest: body.Rest, count: int) -> Iterator[np.ndarray]:
    """`count` base meshes, (19158, 3) each, on the way from the reference pose to `pose`.

    The first is the reference pose; `pose` itself is not among them. Each joint turns evenly,
    slowly at both ends.
    """
    turns = {
        bone: Rotation.from_matrix(matrix).as_rotvec()
        for bone, matrix in rotations(pose, rest).items()
    }
    for k in range(count):
        share = (k / count) ** 2 * (3.0 - 2.0 * k / count)
        partial = {bone: Rotation.from_rotvec(share * t).as_matrix() for bone, t in turns.items()}
        yield body.skin(rest.vertices, body.bone_transforms(rest, partial))


def _order(names: list[str], hard_share: float, generator: np.random.Generator) -> list[str]:
    """`names` shuffled, the hard ones first with probability `hard_share`, else last."""
    shuffled = [str(name) for name in generator.permutation(names)]
    hard_first = bool(generator.random() < hard_share)
    return sorted(shuffled, key=lambda name: POSES[name].hard is not hard_first)
