"""Where each texel of the clothing charts lies on the cloth, whatever is cut from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from subjects.open.base.atlas import GROUPS, texels
from subjects.open.base.template import TIGHTS, template
from subjects.open.clothes.garments import arm_length

LEG_RADIUS, ARM_RADIUS, ARM_JOINT = 0.075, 0.048, 0.22
"""Metres for a radian around a leg and an arm, and for a joint along the arm."""
CROTCH, SIDE = -0.04, 0.004
"""Template height of the crotch, and depth of the side seams."""


@dataclass(frozen=True, eq=False)
class Suit:
    """The N texels of one chart, all float32 but `on_arm`.

    Attributes:
        place: (N, 3) template coordinates.
        on_arm: (N,) bool.
        arm: (N,) joints from the shoulder.
        around: (N,) metres around the trunk from the middle of front or back or, on an arm,
            around that.
        along: (N,) metres up the trunk or, on an arm, down that.
        leg: (N,) radians around the leg, 0 in front, positive outwards.
    """

    place: np.ndarray
    on_arm: np.ndarray
    arm: np.ndarray
    around: np.ndarray
    along: np.ndarray
    leg: np.ndarray

    @property
    def around_leg(self) -> np.ndarray:
        """(N,) metres around the leg, or above the crotch around the hips."""
        x, y = self.place[:, 0], self.place[:, 1]
        return np.where(y > CROTCH, self.around, LEG_RADIUS * self.leg * np.sign(x))


@lru_cache(maxsize=6)
def suit(group: str, size: int) -> Suit:
    """The chart of `group` in a texture of `size` pixels."""
    baked = texels(size)
    place = baked.place[baked.group == GROUPS.index(group)]
    joints = template().joints
    x, y, z = place.T
    arm = arm_length(place)
    on_arm = (np.abs(x) > 0.20) & (y > 0.1) & (arm > 0.12)
    around = _around_trunk(x, y, z)
    along = y.copy()

    mirrored = place[on_arm] * np.array([1.0, 1.0, 1.0])
    mirrored[:, 0] = np.abs(mirrored[:, 0])
    shoulder, elbow, wrist = (joints[f"l-{j}"] for j in ("shoulder", "elbow", "hand"))
    at = arm[on_arm][:, None]
    axis = np.where(at < 1, shoulder + at * (elbow - shoulder), elbow + (at - 1) * (wrist - elbow))
    off = mirrored - axis
    direction = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    front = np.array([0.0, 0.0, 1.0]) - direction[2] * direction
    front /= np.linalg.norm(front)
    above = np.cross(front, direction)
    around[on_arm] = ARM_RADIUS * np.arctan2(off @ above, off @ front)
    along[on_arm] = ARM_JOINT * arm[on_arm]

    line = np.array([joints[f"l-{name}"] for name in ("ankle", "knee", "upper-leg")])
    side = np.abs(x) - np.interp(y, line[:, 1], line[:, 0])
    leg = np.arctan2(side, z - np.interp(y, line[:, 1], line[:, 2]))
    single = np.float32
    return Suit(
        place.astype(single),
        on_arm,
        arm.astype(single),
        around.astype(single),
        along.astype(single),
        leg.astype(single),
    )


def _around_trunk(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(N,) metres from the middle of the front or of the back, whose cloth meets at the sides.

    A panel's threads run straight down its middle; towards the sides, depth adds to width.
    """
    vertices = template().vertices[np.unique(template().groups[TIGHTS].quads)]
    middle = vertices[(np.abs(vertices[:, 0]) < 0.012) & (vertices[:, 1] > CROTCH - 0.05)]
    front, back = middle[middle[:, 2] > 0.02], middle[middle[:, 2] < -0.02]
    front, back = front[np.argsort(front[:, 1])], back[np.argsort(back[:, 1])]
    ahead = np.interp(y, front[:, 1], front[:, 2]) - z
    behind = z - np.interp(y, back[:, 1], back[:, 2])
    # Hollows of the middle line, as between the breasts or buttocks, add nothing.
    depth = 0.7 * np.maximum(np.where(z > SIDE, ahead, behind), 0.0)
    reach = x + np.sign(x) * depth
    return np.where(z > SIDE, reach, reach + 0.5)
