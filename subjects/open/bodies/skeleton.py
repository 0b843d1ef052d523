"""A pose in anatomical terms, the limits of human joints, and the bone rotations it means.

Directions are (outward, up, forward) in the frame of the trunk for arms: the same numbers hold
for the left and the right. Angles are in degrees.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from subjects.open.bodies.body import Rest

Direction = tuple[float, float, float]
SIDES = (("L", 1.0), ("R", -1.0))
FINGERS = ("2", "3", "4", "5")
SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
NECK = ("neck01", "neck02", "neck03", "head")
KNUCKLES = (0.8, 1.0, 0.6)
"""Bend of a finger's three joints, from the knuckle outwards, as shares of its curl."""
TOES_AT_REST = 8.0

LIMITS: dict[str, tuple[float, float]] = {
    "head forward": (-45.0, 45.0),
    "head turn": (-60.0, 60.0),
    "head tilt": (-45.0, 45.0),
    "trunk forward": (-25.0, 80.0),
    "trunk turn": (-45.0, 45.0),
    "trunk tilt": (-35.0, 35.0),
    "shoulder extension": (-180.0, 60.0),
    "shoulder across": (-90.0, 45.0),
    "shoulder rotation": (-105.0, 95.0),
    "elbow": (0.0, 150.0),
    "pronation": (-80.0, 80.0),
    "wrist": (-70.0, 80.0),
    "finger": (0.0, 100.0),
    "thumb": (0.0, 80.0),
    "hip flexion": (-30.0, 120.0),
    "hip abduction": (-30.0, 45.0),
    "hip rotation": (-45.0, 45.0),
    "knee": (0.0, 135.0),
    "ankle": (-50.0, 20.0),
}
"""Least and greatest of each joint's angles, degrees.

Source: American Academy of Orthopaedic Surgeons, Joint Motion: Method of Measuring and Recording
(1965), the normal ranges of adults. Its shoulder rotation, 90 degrees out and 70 in, is the upper
arm's against a held shoulder blade; here the blade adds 15 and 25, its share in throwing and in
a hand on the back.
"""


@dataclass(frozen=True)
class Hand:
    """How the fingers are held; all zero is the hand of the reference pose, flat and spread."""

    curl: tuple[float, float, float, float] = (14.0, 22.0, 27.0, 31.0)
    """Bend of the middle joint of index, middle, ring and little finger."""
    spread: float = -4.5
    """Turn of each finger away from its neighbour, against the reference pose."""
    thumb: float = 24.0
    """Bend of the thumb's joints across the palm."""
    adduction: float = 30.0
    """Turn of the thumb from in front of the palm to beside the index finger."""


RELAXED = Hand()
FLAT = Hand((4.0, 5.0, 6.0, 7.0), -5.0, 8.0, 34.0)
OPEN = Hand((7.0, 9.0, 11.0, 12.0), 1.0, 8.0, 12.0)
CUPPED = Hand((30.0, 36.0, 40.0, 44.0), -5.0, 22.0, 14.0)
GRIPPING = Hand((58.0, 64.0, 68.0, 72.0), -5.0, 30.0, 12.0)
FIST = Hand((92.0, 96.0, 97.0, 98.0), -6.0, 48.0, 26.0)
POINTING = Hand((5.0, 84.0, 92.0, 96.0), -4.0, 46.0, 26.0)


@dataclass(frozen=True)
class Arm:
    """One arm: where the upper arm and the forearm point, and how the hand is held."""

    upper: Direction = (0.24, -1.0, -0.06)
    fore: Direction = (0.14, -1.0, 0.24)
    pronation: float = 0.0
    """Turn of the forearm that brings the palm to face backwards when the arm hangs."""
    wrist: float = 0.0
    """Bend of the hand towards the palm."""
    hand: Hand = RELAXED


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
    hard: bool = False
    """Whether the front and the back of the body differ much in depth.

    Of each pixel of an orthographic view from the front, the depth of the front, seen from the
    front, and that of the back, seen from behind, each less the greatest of its surface: in a hard
    pose they differ by more than 100 mm in a quarter of the pixels or more.
    """


def varied(pose: Pose, generator: np.random.Generator, arm_room: float, leg_room: float) -> Pose:
    """`pose` as one person takes it: directions and angles moved a little, within `LIMITS`.

    Args:
        arm_room: 0 as drawn; more takes the arms further from the trunk, for a body that is
            wider than the pose expects.
        leg_room: the same for the legs and each other, and of one who sits or bends for the trunk
            and the thighs, and for thighs and shins.
    """

    # Who stands level sways little to the front and back: what is easy stays easy.
    sway = 1.0 if pose.hard else 0.4

    def hand(h: Hand) -> Hand:
        # Fingers of one hand bend together, each a little by itself.
        bend = generator.normal(0, 4.5) + generator.normal(0, 2.5, 4)
        spread, thumb, adduction = generator.normal(0, (1.0, 4.0, 4.0))
        curl = np.round(np.clip(np.array(h.curl) + bend, *LIMITS["finger"]), 2)
        index, middle, ring, little = curl.tolist()
        return Hand(
            (index, middle, ring, little),
            round(h.spread + float(spread), 2),
            round(float(np.clip(h.thumb + thumb, *LIMITS["thumb"])), 2),
            round(h.adduction + float(adduction), 2),
        )

    def arm(a: Arm) -> Arm:
        # Arms in front of the trunk gain room forwards, others sideways.
        front = a.fore[0] < -0.2 and a.fore[2] > 0.0 and a.upper[2] > 0.0
        room = arm_room * np.array([0.06, 0.0, 0.16] if front else [0.16, 0.0, 0.05])
        level = np.array([1.0, 1.0, sway])
        upper = np.array(a.upper) + level * (generator.normal(0, 0.05, 3) + room)
        fore = np.array(a.fore) + level * (generator.normal(0, 0.06, 3) + room)
        return Arm(
            (float(upper[0]), float(upper[1]), float(upper[2])),
            (float(fore[0]), float(fore[1]), float(fore[2])),
            a.pronation + float(generator.normal(0, 8)),
            a.wrist + float(generator.normal(0, 5)),
            hand(a.hand),
        )

    def leg(v: Leg) -> Leg:
        forward, outward, knee, toes = generator.normal(0, (3.0, 1.2, 3.0, 4.0)).tolist()
        # The feet of straight legs stay level: what stands does not hover on one foot.
        still = min(1.0, (abs(v.forward) + v.knee) / 30.0)
        return replace(
            v,
            forward=v.forward + still * sway * forward,
            outward=max(v.outward + outward, min(v.outward, 2.0)) + 3.0 * leg_room,
            knee=max(
                v.knee + still * sway * knee - (2.5 * leg_room if v.knee > 70.0 else 0.0), 1.0
            ),
            toes=v.toes + toes,
        )

    def moved(a: Direction, spread: float) -> Direction:
        x, y, z = (np.array(a) + [sway, 1.0, 1.0] * generator.normal(0, spread, 3)).tolist()
        return (x, y, z)

    # Bent hips gain room between trunk and thighs as the trunk rises.
    flexed = pose.hips[0] + max(pose.left_leg.forward, pose.right_leg.forward) > 40.0
    back = 2.5 * leg_room if flexed else 0.0
    return limited(
        replace(
            pose,
            left_arm=arm(pose.left_arm),
            right_arm=arm(pose.right_arm),
            left_leg=leg(pose.left_leg),
            right_leg=leg(pose.right_leg),
            hips=moved((pose.hips[0] - back, *pose.hips[1:]), 1.5),
            trunk=moved(pose.trunk, 2.5),
            head=moved(pose.head, 4.0),
        )
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


def limited(pose: Pose) -> Pose:
    """The pose nearest to `pose` whose joints keep to `LIMITS`."""

    def clip(name: str, value: float, zero: float = 0.0) -> float:
        low, high = LIMITS[name]
        return round(float(np.clip(value, low + zero, high + zero)), 2)

    def body(part: str, values: Direction) -> Direction:
        forward, turn, tilt = values
        return (
            clip(f"{part} forward", forward),
            clip(f"{part} turn", turn),
            clip(f"{part} tilt", tilt),
        )

    def arm(a: Arm) -> Arm:
        upper = _unit(np.array(a.upper))
        for axis, name in ((2, "shoulder extension"), (0, "shoulder across")):
            least = -np.sin(np.radians(LIMITS[name][1]))
            if upper[axis] < least:
                # What points straight there comes back by way of hanging.
                upper[axis], upper[1] = 0.0, upper[1] - 1e-9
                upper *= np.sqrt(1.0 - least**2) / np.linalg.norm(upper)
                upper[axis] = least
        fore = _unit(np.array(a.fore))
        bend = np.degrees(np.arccos(np.clip(upper @ fore, -1.0, 1.0)))
        hinge = np.cross(upper, fore)
        if bend > LIMITS["elbow"][1]:
            fore = _about(hinge, LIMITS["elbow"][1] - bend) @ fore
        inward = _inward_rotation(upper, fore)
        excess = inward - float(np.clip(inward, *LIMITS["shoulder rotation"]))
        if excess:
            fore = _about(upper, -excess) @ fore
        return replace(
            a,
            upper=_rounded(upper),
            fore=_rounded(fore),
            pronation=clip("pronation", a.pronation),
            wrist=clip("wrist", a.wrist),
        )

    def leg(v: Leg, sign: float) -> Leg:
        forward = clip("hip flexion", v.forward, -pose.hips[0])
        knee = clip("knee", v.knee)
        pitch = v.pitch
        if pitch is not None:
            pitch = round(knee - forward - clip("ankle", knee - forward - pitch), 2)
        return Leg(
            forward,
            clip("hip abduction", v.outward, sign * pose.hips[2]),
            knee,
            clip("hip rotation", v.toes, sign * pose.hips[1]),
            pitch,
        )

    return replace(
        pose,
        left_arm=arm(pose.left_arm),
        right_arm=arm(pose.right_arm),
        left_leg=leg(pose.left_leg, 1.0),
        right_leg=leg(pose.right_leg, -1.0),
        hips=_rounded(np.array(pose.hips), 2),
        trunk=body("trunk", pose.trunk),
        head=body("head", pose.head),
    )


def rotations(pose: Pose, rest: Rest) -> dict[str, np.ndarray]:
    """Bone label -> (3, 3) rotation against its parent, in the world's axes at the reference."""
    result: dict[str, np.ndarray] = {"root": _lean(pose.hips)}
    for bones, values in ((SPINE, pose.trunk), (NECK, pose.head)):
        part = (values[0] / len(bones), values[1] / len(bones), values[2] / len(bones))
        for bone in bones:
            result[bone] = _lean(part)
    for (side, sign), arm, leg in zip(
        SIDES, (pose.left_arm, pose.right_arm), (pose.left_leg, pose.right_leg), strict=True
    ):
        result |= _arm(arm, side, sign, rest.joints)
        result |= _hand(arm, side, sign, rest.joints)
        result |= _leg(leg, side, sign, rest.joints, result["root"])
    return result


def _rounded(values: np.ndarray, digits: int = 4) -> Direction:
    x, y, z = np.round(values, digits).tolist()
    return (x, y, z)


def _lean(values: Direction) -> np.ndarray:
    """Forward about x, left about y, to the right about z."""
    return Rotation.from_euler("YXZ", [values[1], values[0], values[2]], degrees=True).as_matrix()


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


def _unturned(upper: np.ndarray) -> np.ndarray:
    """Where the forearm of a bent elbow points if the upper arm swings here without turning."""
    x, y, z = upper
    # The shortest turn from straight down; straight up has no one such turn.
    down = max(1.0 - y, 1e-6)
    return np.array([-x * z / down, z, 1.0 - z * z / down])


def _inward_rotation(upper: np.ndarray, fore: np.ndarray) -> float:
    """Degrees by which the upper arm is turned inwards; 0 of a straight arm.

    In (outward, up, forward): against the arm swung from hanging with the forearm in front.
    """
    zero = _unturned(upper)
    bent = fore - upper * (fore @ upper)
    if np.linalg.norm(bent) < np.sin(np.radians(12.0)):
        return 0.0
    return float(np.degrees(np.arctan2(np.cross(zero, bent) @ upper, zero @ bent)))


def _arm(arm: Arm, side: str, sign: float, joints: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    mirror = np.array([sign, 1.0, 1.0])
    upper, fore = _unit(np.array(arm.upper)), _unit(np.array(arm.fore))
    # A straight elbow tells no hinge: the unturned arm's, then.
    hinge = np.cross(upper, fore + 0.15 * _unturned(upper))
    upper, fore, hinge = upper * mirror, fore * mirror, sign * hinge * mirror
    along = joints[f"lowerarm01.{side}"] - joints[f"upperarm01.{side}"]
    below = joints[f"wrist.{side}"] - joints[f"lowerarm01.{side}"]
    # The collar bone takes part as the arm rises.
    rise = 26.0 * float(np.clip((upper[1] + 0.35) / 1.35, 0.0, 1.0))
    girdle = _about(np.array([0.0, 0.0, sign]), rise)
    # The elbow is a hinge: its axis is square to both bones, at rest and in the pose.
    turn = _frame(girdle.T @ upper, girdle.T @ hinge) @ _frame(along, np.cross(along, below)).T
    twist = _twist_degrees(turn, along)
    untwist = _about(along, -twist / 2)
    elbow = (
        _frame(turn.T @ girdle.T @ fore, np.cross(along, below))
        @ _frame(below, np.cross(along, below)).T
    )
    pronate = _about(below, sign * arm.pronation / 2)
    return {
        f"clavicle.{side}": girdle,
        f"upperarm01.{side}": turn @ untwist,
        f"upperarm02.{side}": untwist.T,
        f"lowerarm01.{side}": elbow @ pronate,
        f"lowerarm02.{side}": pronate,
    }


def _hand(arm: Arm, side: str, sign: float, joints: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    hand = arm.hand
    across = joints[f"finger2-1.{side}"] - joints[f"finger5-1.{side}"]
    along = joints[f"finger3-1.{side}"] - joints[f"wrist.{side}"]
    # A turn about `bend` takes the fingers to the palm, one about `part` to the thumb's side.
    bend, part = -sign * across, np.cross(along, across)
    result = {f"wrist.{side}": _about(bend, arm.wrist)}
    for finger, curl, outward in zip(FINGERS, hand.curl, (1.0, 0.0, -1.0, -2.0), strict=True):
        base = f"finger{finger}-1.{side}"
        # Each finger bends in its own plane.
        own = _frame(joints[f"finger{finger}-3.{side}"] - joints[base], bend)[:, 1]
        for joint, share in enumerate(KNUCKLES, start=1):
            result[f"finger{finger}-{joint}.{side}"] = _about(own, share * curl)
        result[base] = _about(part, outward * hand.spread) @ result[base]
    # The thumb closes over the palm, towards the little finger.
    thumb = joints[f"finger1-3.{side}"] - joints[f"finger1-2.{side}"]
    close = np.cross(thumb, -across)
    result[f"finger1-1.{side}"] = _about(bend, -hand.adduction) @ _about(close, 0.4 * hand.thumb)
    result[f"finger1-2.{side}"] = _about(close, 0.6 * hand.thumb)
    result[f"finger1-3.{side}"] = _about(close, hand.thumb)
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
    rest_toes = np.radians(TOES_AT_REST)
    rest_axis = np.cross([sign * np.sin(rest_toes), 0.0, np.cos(rest_toes)], along)
    # Thigh angles are against the upright, whatever the pelvis does.
    hip = hips.T @ _frame(thigh, np.cross(front, thigh)) @ _frame(along, rest_axis).T
    knee = _about(rest_axis, leg.knee)
    result = {f"upperleg01.{side}": hip, f"lowerleg01.{side}": knee}
    if leg.pitch is not None:
        flat = Rotation.from_euler(
            "YX", [sign * (leg.toes - TOES_AT_REST), leg.pitch], degrees=True
        ).as_matrix()
        result[f"foot.{side}"] = (hips @ hip @ knee).T @ flat
    return result
