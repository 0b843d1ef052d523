"""Everyday poses in anatomical terms, their seeded variation, and the bone rotations they mean.

Directions are (outward, up, forward) in the frame of the trunk for arms: the same numbers hold
for the left and the right. Angles are in degrees.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.open.body import Rest

Direction = tuple[float, float, float]
SIDES = (("L", 1.0), ("R", -1.0))
FINGERS = ("2", "3", "4", "5")
SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
NECK = ("neck01", "neck02", "neck03", "head")


@dataclass(frozen=True)
class Arm:
    """One arm: where the upper arm and the forearm point, and how the hand is held."""

    upper: Direction = (0.24, -1.0, -0.06)
    fore: Direction = (0.14, -1.0, 0.24)
    pronation: float = 0.0
    """Turn of the forearm that brings the palm to face backwards when the arm hangs."""
    wrist: float = 0.0
    """Bend of the hand towards the palm."""
    curl: float = 16.0
    """Bend of each finger joint."""


@dataclass(frozen=True)
class Leg:
    """One leg: thigh forward and outward, knee bend, toes outward, foot."""

    forward: float = 4.0
    outward: float = 2.0
    knee: float = 2.0
    toes: float = 8.0
    pitch: float | None = 0.0
    """Toes down against the ground; None leaves the ankle as the shin carries it."""


@dataclass(frozen=True)
class Pose:
    """A whole body. The trunk bends over five vertebrae, the head over four."""

    left_arm: Arm = field(default_factory=Arm)
    right_arm: Arm = field(default_factory=Arm)
    left_leg: Leg = field(default_factory=Leg)
    right_leg: Leg = field(default_factory=Leg)
    hips: Direction = (0.0, 0.0, 0.0)
    """Pelvis: lean forward, turn left, tilt to the right."""
    trunk: Direction = (0.0, 0.0, 0.0)
    """The same of the spine against the pelvis."""
    head: Direction = (0.0, 0.0, 0.0)
    """The same of the head against the trunk."""
    skirt: bool = True
    """Whether the legs leave a skirt its shape."""


HANGING = Arm()
ON_HIP = Arm((0.92, -0.80, -0.40), (-0.52, -0.66, 0.40), 10.0, -20.0, 45.0)
POSES: dict[str, Pose] = {
    "stand": Pose(),
    "a_pose": Pose(
        Arm((0.8, -1.0, 0.0), (0.7, -1.0, 0.3)),
        Arm((0.8, -1.0, 0.0), (0.7, -1.0, 0.3)),
        Leg(outward=6),
        Leg(outward=6),
    ),
    "weight_on_one_leg": Pose(
        Arm((0.30, -1.0, -0.1), (0.20, -1.0, 0.3)),
        Arm((0.26, -1.0, 0.0), (0.10, -1.0, 0.35)),
        Leg(outward=3, knee=2),
        Leg(forward=14, outward=10, knee=26, toes=20),
        hips=(0, 6, -5),
        trunk=(0, -4, 6),
        head=(0, 12, 3),
    ),
    "hands_on_hips": Pose(ON_HIP, ON_HIP, Leg(outward=4), Leg(outward=8)),
    "hand_on_hip": Pose(
        HANGING,
        ON_HIP,
        Leg(outward=10, forward=6, knee=14, toes=16),
        Leg(outward=3),
        hips=(0, -8, 4),
        trunk=(0, 4, -5),
        head=(2, -12, 0),
    ),
    "walk": Pose(
        Arm((0.24, -1.0, -0.38), (0.16, -1.0, -0.02)),
        Arm((0.22, -1.0, 0.26), (0.06, -0.8, 0.55)),
        Leg(forward=22, outward=3, knee=10, pitch=-8),
        Leg(forward=-16, outward=3, knee=24, pitch=22),
        hips=(2, -6, 0),
        trunk=(2, 12, 0),
        head=(0, -5, 0),
    ),
    "jog": Pose(
        Arm((0.36, -0.9, -0.62), (0.05, -0.35, 0.9), curl=45),
        Arm((0.30, -0.95, 0.28), (-0.15, 0.45, 0.85), curl=45),
        Leg(forward=48, outward=3, knee=72, pitch=None),
        Leg(forward=-14, outward=3, knee=18, pitch=32),
        hips=(8, -6, 0),
        trunk=(4, 14, 0),
        head=(-8, -6, 0),
        skirt=False,
    ),
    "wave": Pose(
        HANGING,
        Arm((0.92, 0.05, 0.25), (0.30, 1.0, 0.25), 20.0, -5.0, 6.0),
        hips=(0, -3, 0),
        head=(0, -6, 4),
    ),
    "point": Pose(
        Arm((0.42, -0.25, 0.95), (0.38, -0.02, 1.0), 35.0, 0.0, 30.0),
        HANGING,
        Leg(forward=8, outward=5, knee=6),
        Leg(forward=-6, outward=6, knee=8, pitch=8),
        trunk=(0, -10, 0),
        head=(0, 14, 0),
    ),
    "on_the_phone": Pose(
        HANGING,
        Arm((0.62, -0.80, 0.42), (0.02, 1.0, 0.12), -25.0, 5.0, 42.0),
        head=(4, 6, 2),
        hips=(0, 5, -2),
    ),
    "reading_a_phone": Pose(
        Arm((0.30, -1.0, 0.22), (-0.26, 0.22, 1.0), -40.0, 5.0, 30.0),
        Arm((0.30, -1.0, 0.16), (-0.20, 0.02, 1.0), -50.0, 5.0, 34.0),
        head=(22, 0, 0),
        trunk=(6, 0, 0),
    ),
    "reach_up": Pose(
        HANGING,
        Arm((0.34, 1.0, 0.34), (0.18, 1.0, 0.52), 20.0, 0.0, 12.0),
        Leg(outward=5, pitch=0.0),
        Leg(outward=6),
        trunk=(-4, -8, -6),
        head=(-18, -10, 0),
    ),
    "arms_overhead": Pose(
        Arm((0.52, 1.0, 0.10), (0.18, 1.0, 0.25), 10.0, 0.0, 10.0),
        Arm((0.52, 1.0, 0.10), (0.18, 1.0, 0.25), 10.0, 0.0, 10.0),
        Leg(outward=4),
        Leg(outward=4),
        trunk=(-6, 0, 0),
        head=(-8, 0, 0),
    ),
    "arms_open": Pose(
        Arm((0.85, -0.62, 0.35), (0.75, -0.05, 0.85), -70.0, -10.0, 10.0),
        Arm((0.85, -0.62, 0.35), (0.75, -0.05, 0.85), -70.0, -10.0, 10.0),
        Leg(outward=4),
        Leg(outward=4),
        head=(-3, 0, 5),
    ),
    "t_stretch": Pose(
        Arm((1.0, -0.06, -0.05), (1.0, -0.02, 0.14)),
        Arm((1.0, -0.06, -0.05), (1.0, -0.02, 0.14)),
        Leg(outward=6),
        Leg(outward=6),
    ),
    "squat": Pose(
        Arm((0.28, -0.55, 0.85), (-0.05, -0.10, 1.0), 0.0, 0.0, 22.0),
        Arm((0.28, -0.55, 0.85), (-0.05, -0.10, 1.0), 0.0, 0.0, 22.0),
        Leg(forward=62, outward=20, knee=78, toes=22),
        Leg(forward=62, outward=20, knee=78, toes=22),
        hips=(14, 0, 0),
        trunk=(8, 0, 0),
        head=(-20, 0, 0),
        skirt=False,
    ),
    "lunge": Pose(
        Arm((0.40, -0.9, -0.30), (0.22, -1.0, 0.15)),
        Arm((0.40, -0.9, 0.25), (0.10, -0.7, 0.70)),
        Leg(forward=52, outward=5, knee=58),
        Leg(forward=-26, outward=4, knee=26, pitch=42),
        hips=(3, -4, 0),
        trunk=(2, 6, 0),
        skirt=False,
    ),
    "look_back": Pose(
        Arm((0.36, -1.0, -0.15), (0.24, -1.0, 0.20)),
        Arm((0.30, -1.0, 0.12), (0.10, -1.0, 0.42)),
        Leg(forward=10, outward=5, knee=8, pitch=-4),
        Leg(forward=-8, outward=5, knee=10, pitch=10),
        hips=(0, 10, 0),
        trunk=(0, 26, 0),
        head=(0, 38, 0),
    ),
    "bend_forward": Pose(
        Arm((0.20, -1.0, 0.55), (0.05, -0.85, 0.70)),
        Arm((0.20, -1.0, 0.55), (0.05, -0.85, 0.70)),
        Leg(forward=2, outward=4, knee=10),
        Leg(forward=2, outward=4, knee=10),
        hips=(18, 0, 0),
        trunk=(24, 0, 0),
        head=(-10, 0, 0),
    ),
    "step_up": Pose(
        Arm((0.28, -1.0, -0.30), (0.16, -1.0, 0.10)),
        Arm((0.26, -0.95, 0.35), (0.02, -0.40, 0.95)),
        Leg(forward=56, outward=7, knee=62, pitch=0.0),
        Leg(forward=-2, outward=4, knee=3),
        hips=(3, 0, 0),
        trunk=(5, 4, 0),
        head=(6, 0, 0),
        skirt=False,
    ),
    "carry": Pose(
        Arm((0.26, -1.0, 0.05), (-0.02, -0.08, 1.0), -60.0, -8.0, 18.0),
        Arm((0.26, -1.0, 0.05), (-0.02, -0.08, 1.0), -60.0, -8.0, 18.0),
        Leg(outward=7),
        Leg(outward=7, forward=4, knee=8),
        trunk=(-4, 0, 0),
    ),
}


def varied(pose: Pose, generator: np.random.Generator, arm_room: float, leg_room: float) -> Pose:
    """`pose` as one person takes it: directions and angles moved a little.

    Args:
        arm_room: 0 as drawn; more takes the arms further from the trunk, for a body that is
            wider than the pose expects.
        leg_room: the same for the legs and each other.
    """

    def arm(a: Arm) -> Arm:
        room = np.array([0.16 * arm_room, 0.0, 0.05 * arm_room])
        upper = np.array(a.upper) + generator.normal(0, 0.05, 3) + room
        fore = np.array(a.fore) + generator.normal(0, 0.06, 3) + room
        return replace(
            a,
            upper=tuple(np.round(upper, 4).tolist()),
            fore=tuple(np.round(fore, 4).tolist()),
            pronation=round(a.pronation + float(generator.normal(0, 8)), 2),
            wrist=round(a.wrist + float(generator.normal(0, 5)), 2),
            curl=round(max(a.curl + float(generator.normal(0, 5)), 2.0), 2),
        )

    def leg(v: Leg) -> Leg:
        drawn = generator.normal(0, 1, 4) * (3.0, 1.2, 3.0, 4.0)
        return replace(
            v,
            forward=round(v.forward + float(drawn[0]), 2),
            outward=round(max(v.outward + float(drawn[1]), 2.0) + 3.0 * leg_room, 2),
            knee=round(max(v.knee + float(drawn[2]), 1.0), 2),
            toes=round(v.toes + float(drawn[3]), 2),
        )

    def angles(a: Direction, spread: float) -> Direction:
        moved = np.array(a) + generator.normal(0, spread, 3)
        x, y, z = np.round(moved, 2).tolist()
        return (x, y, z)

    left, right = pose.left_arm, pose.right_arm
    legs = pose.left_leg, pose.right_leg
    return replace(
        pose,
        left_arm=arm(left),
        right_arm=arm(right),
        left_leg=leg(legs[0]),
        right_leg=leg(legs[1]),
        hips=angles(pose.hips, 1.5),
        trunk=angles(pose.trunk, 2.5),
        head=angles(pose.head, 4.0),
    )


def mirrored(pose: Pose) -> Pose:
    """Left and right exchanged."""

    def flip(a: Direction) -> Direction:
        return (a[0], -a[1], -a[2])

    return replace(
        pose,
        left_arm=pose.right_arm,
        right_arm=pose.left_arm,
        left_leg=pose.right_leg,
        right_leg=pose.left_leg,
        hips=flip(pose.hips),
        trunk=flip(pose.trunk),
        head=flip(pose.head),
    )


def as_json(pose: Pose) -> dict[str, Any]:
    """The pose's numbers, JSON-ready."""
    return asdict(pose)


def rotations(pose: Pose, rest: Rest) -> dict[str, np.ndarray]:
    """Bone label -> (3, 3) rotation against its parent, in the world's axes at the reference."""
    result: dict[str, np.ndarray] = {"root": _lean(pose.hips)}
    for bones, angles in ((SPINE, pose.trunk), (NECK, pose.head)):
        part = (angles[0] / len(bones), angles[1] / len(bones), angles[2] / len(bones))
        for bone in bones:
            result[bone] = _lean(part)
    for (side, sign), arm, leg in zip(
        SIDES, (pose.left_arm, pose.right_arm), (pose.left_leg, pose.right_leg), strict=True
    ):
        result |= _arm(arm, side, sign, rest.joints)
        result |= _leg(leg, side, sign, rest.joints, result["root"])
    return result


def _lean(angles: Direction) -> np.ndarray:
    """Forward about x, left about y, to the right about z."""
    return Rotation.from_euler("YXZ", [angles[1], angles[0], angles[2]], degrees=True).as_matrix()


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _frame(along: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Columns: `along`, `axis` made square to it, and their cross product."""
    first = _unit(along)
    second = _unit(axis - first * (axis @ first))
    return np.stack([first, second, np.cross(first, second)], axis=1)


def _about(axis: np.ndarray, degrees: float) -> np.ndarray:
    return Rotation.from_rotvec(_unit(axis) * np.radians(degrees)).as_matrix()


def _twist_degrees(rotation: np.ndarray, axis: np.ndarray) -> float:
    """How far `rotation` turns about `axis` (swing-twist decomposition)."""
    q = Rotation.from_matrix(rotation).as_quat()
    angle = 2.0 * np.degrees(np.arctan2(q[:3] @ _unit(axis), q[3]))
    return float((angle + 180.0) % 360.0 - 180.0)


def _arm(arm: Arm, side: str, sign: float, joints: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    mirror = np.array([sign, 1.0, 1.0])
    upper, fore = _unit(np.array(arm.upper) * mirror), _unit(np.array(arm.fore) * mirror)
    along = joints[f"lowerarm01.{side}"] - joints[f"upperarm01.{side}"]
    below = joints[f"wrist.{side}"] - joints[f"lowerarm01.{side}"]
    # The collar bone takes part as the arm rises.
    rise = 26.0 * float(np.clip((upper[1] + 0.35) / 1.35, 0.0, 1.0))
    girdle = _about(np.array([0.0, 0.0, sign]), rise)
    local_upper, local_fore = girdle.T @ upper, girdle.T @ fore
    # The elbow is a hinge: its axis is square to both bones, at rest and in the pose.
    turn = (
        _frame(local_upper, np.cross(local_upper, local_fore))
        @ _frame(along, np.cross(along, below)).T
    )
    twist = _twist_degrees(turn, along)
    untwist = _about(along, -twist / 2)
    elbow = (
        _frame(turn.T @ local_fore, np.cross(along, below))
        @ _frame(below, np.cross(along, below)).T
    )
    pronate = _about(below, sign * arm.pronation / 2)
    result = {
        f"clavicle.{side}": girdle,
        f"upperarm01.{side}": turn @ untwist,
        f"upperarm02.{side}": untwist.T,
        f"lowerarm01.{side}": elbow @ pronate,
        f"lowerarm02.{side}": pronate,
    }
    # Fingers and wrist bend about the line across the knuckles.
    across = joints[f"finger2-1.{side}"] - joints[f"finger5-1.{side}"]
    bend = _about(across, arm.wrist)
    result[f"wrist.{side}"] = bend
    for finger in FINGERS:
        for joint in ("1", "2", "3"):
            result[f"finger{finger}-{joint}.{side}"] = _about(across, arm.curl)
    return result


def _leg(
    leg: Leg, side: str, sign: float, joints: dict[str, np.ndarray], hips: np.ndarray
) -> dict[str, np.ndarray]:
    forward, outward, toes = np.radians([leg.forward, leg.outward, leg.toes])
    thigh = np.array(
        [
            sign * np.sin(outward),
            -np.cos(outward) * np.cos(forward),
            np.cos(outward) * np.sin(forward),
        ]
    )
    front = np.array(
        [
            sign * np.sin(toes),
            np.cos(toes) * np.sin(forward),
            np.cos(toes) * np.cos(forward),
        ]
    )
    along = joints[f"lowerleg01.{side}"] - joints[f"upperleg01.{side}"]
    # Rest toes already point outward a little; the knee's axis there is close to x.
    rest_front = np.array([sign * np.sin(np.radians(8.0)), 0.0, np.cos(np.radians(8.0))])
    rest_axis = np.cross(rest_front, along)
    # Thigh angles are against the upright, whatever the pelvis does.
    hip = hips.T @ _frame(thigh, np.cross(front, thigh)) @ _frame(along, rest_axis).T
    knee = _about(rest_axis, leg.knee)
    result = {f"upperleg01.{side}": hip, f"lowerleg01.{side}": knee}
    if leg.pitch is not None:
        flat = Rotation.from_euler(
            "YX", [sign * (leg.toes - 8.0), leg.pitch], degrees=True
        ).as_matrix()
        result[f"foot.{side}"] = (hips @ hip @ knee).T @ flat
    return result
