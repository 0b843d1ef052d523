"""The second Kinect by its statistics: what a time-of-flight camera does to a depth map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from augment.sensors.axial import axial_sigma
from augment.sensors.lateral import displaced
from augment.sensors.sensor import Sensor
from augment.sensors.view import Reading, View

LATERAL = 0.0016
"""Metres: standard deviation across the view, indoors (Fankhauser et al. 2015)."""


@dataclass(frozen=True)
class KinectV2(Sensor):
    """Axial noise, lateral noise, mixed pixels, dropout, whole millimetres, a range.

    The axial model is Fankhauser et al.'s (ICAR 2015) with pi/2; the lateral one is theirs too, a
    displacement of the place that is read and no number added to depth. A pixel at the outline or
    at a depth step may see both sides: it reads a depth between them. Surfaces at a grazing angle
    and dark ones return too little light and are lost. Every part can be switched off.
    """

    name: ClassVar[str] = "kinect_v2"

    lateral: float = LATERAL
    """Standard deviation in metres of the place that a pixel reads; 0 leaves it out."""
    mixed: float = 0.3
    """Odds that a pixel at the outline or at a depth step reads a mixture; 0 leaves it out."""
    step: float = 0.05
    """Metres of depth between neighbours from which on there is a step."""
    background: float = 3.5
    """Metres from the device to the wall that outlines mix with."""
    graze_deg: tuple[float, float] = (70.0, 88.0)
    """Angles of incidence at which pixels begin to be lost and all are; [90, 90] loses none."""
    dark: float = 0.02
    """Brightness (linear, 0 to 1) under which pixels begin to be lost, at 0 all; 0 loses none."""
    millimetres: bool = True
    """Round depth to whole millimetres, as the device does."""
    range: tuple[float, float] = (0.5, 4.5)
    """Metres from the device within which it measures."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checks = {
            "lateral": 0 <= self.lateral <= 0.1,
            "mixed": 0 <= self.mixed <= 1,
            "step": self.step > 0,
            "background": self.background > 0,
            "graze_deg": 0 <= self.graze_deg[0] <= self.graze_deg[1] <= 90,
            "dark": 0 <= self.dark <= 1,
            "range": 0 <= self.range[0] < self.range[1],
        }
        for key, right in checks.items():
            if not right:
                raise ValueError(
                    f"sensor.{key}: {getattr(self, key)} is out of bounds; see its --help"
                )

    def measure(self, view: View, rng: np.random.Generator) -> Reading:
        """As `Sensor.measure`.

        Draws, each where its part is on and in this order: 2 N normals across, N normals along,
        2 E uniforms for the E pixels at edges, N uniforms for loss.
        """
        size = view.grid.pixel_size
        depth = displaced(view, self.lateral / size, rng) if self.lateral else view.depth_at.copy()
        valid = depth > 0
        depth = np.where(valid, depth, view.depth_at)  # an outline that reads nothing may still mix
        sigma = (self.noise * axial_sigma(view.distance_at, view.cosine_at)).astype(np.float32)
        depth += sigma * rng.standard_normal(len(sigma), dtype=np.float32)
        offset = np.float32(self.distance - view.grid.distance)
        if self.mixed:
            edge, far = view.edges(self.step, float(self.background - offset))
            chance, share = rng.random((2, len(edge)), dtype=np.float32)
            drawn = chance < self.mixed
            edge, far, share = edge[drawn], far[drawn], share[drawn]
            depth[edge] += share * (far - depth[edge])
            valid[edge] = True
        lost = self._odds_of_loss(view)
        if lost is not None:
            valid &= rng.random(len(depth), dtype=np.float32) >= lost
        distance = depth + offset
        valid &= (distance >= self.range[0]) & (distance <= self.range[1])
        if self.millimetres:
            depth = np.rint(distance * np.float32(1e3)) / np.float32(1e3) - offset
        depth[~valid] = 0
        return Reading(view.on_map(depth), view.on_map(valid), view.on_map(sigma))

    def _odds_of_loss(self, view: View) -> np.ndarray | None:
        """(N,) odds that a pixel returns too little light; None where none is ever lost."""
        kept = None
        begin, end = np.cos(np.radians(self.graze_deg))
        if begin > 1e-6:
            kept = np.clip((view.cosine_at - end) / max(begin - end, 1e-6), 0, 1)
        if self.dark:
            lit = np.minimum(view.luminance_at / np.float32(self.dark), 1)
            kept = lit if kept is None else kept * lit
        return None if kept is None else 1 - kept
