"""How a scan's file stands in its subject's world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from subjects.fits.body import Body, yaw_of
from subjects.mesh import MeshError

Axis = Literal["x", "y", "z", "-x", "-y", "-z", "body"]
Unit = Literal["m", "dm", "cm", "mm", "in", "ft", "body"]

AXES = {
    sign + name: (-1.0 if sign else 1.0) * axis
    for sign in ("", "-")
    for name, axis in zip("xyz", np.eye(3), strict=True)
}

METRES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres per unit of length."""

HEIGHTS = (0.5, 3.0)
"""Metres that a person's scan may be high, crouching child to giant; else the unit is wrong."""

WIDEST = 2.5
"""Times its height that a person's scan may be wide or deep; else another axis is up."""

UPRIGHT = 0.7
"""Cosine between a body's upright and an axis from which on the axis is up."""

LYING = 0.35
"""Cosine between up and a body's upright below which another axis is up."""


@dataclass(frozen=True)
class Placement:
    """What is said of a set of scans, or left to their bodies to say.

    Attributes:
        up: the file's axis that points from feet to head, or "body": the one nearest to the
            body's own.
        front: the file's axis that the person faces, or "body": where the body's pelvis faces.
        unit: the file's unit of length, by name or in metres, or "body": as the body's scale says.
    """

    up: Axis
    front: Axis
    unit: Unit | float

    def __post_init__(self) -> None:
        for name in ("up", "front"):
            if getattr(self, name) not in (*AXES, "body"):
                raise ValueError(
                    f"subjects.{name}: '{getattr(self, name)}' is no axis; "
                    f"give one of {', '.join(AXES)}, body"
                )
        if self.up == "body" and self.front != "body":
            raise ValueError(
                "subjects.up: body may be any axis, so no axis is sure to be the front; "
                "give front: body too"
            )
        if "body" not in (self.up, self.front) and self.up[-1] == self.front[-1]:
            raise ValueError(
                f"subjects.front: '{self.front}' is parallel to up: '{self.up}'; "
                "give the axis that the person faces"
            )
        known = (*METRES, "body")
        if not (self.unit in known if isinstance(self.unit, str) else 0 < self.unit < np.inf):
            raise ValueError(
                f"subjects.unit: '{self.unit}' is no length; "
                f"give one of {', '.join(known)} or the unit's metres"
            )

    @property
    def asks_body(self) -> bool:
        """Whether a scan cannot be placed without its body."""
        return "body" in (self.up, self.front, self.unit)

    def mesh_to_world(self, vertices: np.ndarray, body: Body | None) -> np.ndarray:
        """(4, 4) similarity from the file's coordinates to the subject's world.

        The world is metric, y is up, the person faces +z, the lowest vertex is at y = 0 and the
        middle of the bounding box on the vertical axis.

        Args:
            vertices: (N, 3) of the scan, in the file's coordinates.
            body: of the scan, where there is one.

        Raises:
            MeshError: it has not a person's size or lies, or `body` does not say what it should.
        """
        units = self.units_per_metre or _known(body).scan_units_per_metre
        mesh_to_world = np.eye(4)
        mesh_to_world[:3, :3] = self._axes(body) / units
        placed = vertices @ mesh_to_world[:3, :3].T
        lowest, highest = placed.min(axis=0), placed.max(axis=0)
        height = highest[1] - lowest[1]
        if not HEIGHTS[0] <= height <= HEIGHTS[1]:
            told = f"correct subjects.unit: {self.unit} (or up: {self.up})"
            if self.unit == "body":
                told = f"correct the scale of its fit, 1 m to {units:.4g} (or up: {self.up})"
            raise MeshError(f"is {height:.4g} m high, no person's height; {told}")
        span = float((highest - lowest)[[0, 2]].max())
        if span > WIDEST * height:
            raise MeshError(
                f"is {height:.4g} m high and {span:.4g} m across: it seems to lie; "
                f"correct subjects.up: {self.up}"
            )
        middle = (lowest + highest) / 2
        mesh_to_world[:3, 3] = -middle[0], -lowest[1], -middle[2]
        return mesh_to_world

    @property
    def units_per_metre(self) -> float | None:
        """Of the file; None where each scan's body has to say it."""
        if self.unit == "body":
            return None
        return 1 / (METRES[self.unit] if isinstance(self.unit, str) else float(self.unit))

    def _axes(self, body: Body | None) -> np.ndarray:
        """(3, 3) whose rows are the world's axes in the file's coordinates."""
        up = _nearest_axis(_known(body)) if self.up == "body" else AXES[self.up]
        if body is not None and body.upright is not None and up @ body.upright_in_scan() < LYING:
            raise MeshError(
                f"has a body that lies or stands on its head where subjects.up is {self.up}; "
                "correct up, or the fit, which may be in an image's coordinates (y down)"
            )
        if self.front != "body":
            front = AXES[self.front]
            return np.stack([np.cross(up, front), up, front])
        # Any axis may stand for the front at first: the body's yaw in that frame is undone.
        front = np.roll(up, 1)
        axes = np.stack([np.cross(up, front), up, front])
        yaw = yaw_of(axes @ _known(body).orientation_in_scan())
        cos, sin = np.cos(yaw), np.sin(yaw)
        back = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
        undone: np.ndarray = back @ axes
        return undone


def _nearest_axis(body: Body) -> np.ndarray:
    """(3,) the file's axis nearest to a body's upright."""
    direction = body.upright_in_scan()
    axis = max(AXES.values(), key=lambda axis: float(axis @ direction))
    if axis @ direction < UPRIGHT:
        raise MeshError(
            "has a body that leans too far to say which axis is up; give subjects.up as an axis"
        )
    return axis


def _known(body: Body | None) -> Body:
    # A source that leaves up, front or unit to bodies has one for every scan.
    assert body is not None
    return body
