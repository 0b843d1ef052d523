"""How a subject is turned in its views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ViewsConfig:
    """The yaws of every subject: drawn at random, or listed."""

    count: int = 14
    """Views per subject, where they are drawn."""
    max_yaw_deg: float = 30.0
    """Yaws are drawn uniformly between minus and plus this, in degrees."""
    yaw_deg: list[float] | None = None
    """The same yaws for every subject, in degrees, instead of drawn ones."""

    def __post_init__(self) -> None:
        if not 1 <= self.count <= 10000:
            raise ValueError(f"views.count: {self.count}; give 1 to 10000, such as 14")
        if not 0 <= self.max_yaw_deg <= 180:
            raise ValueError(f"views.max_yaw_deg: {self.max_yaw_deg}; give 0 to 180, such as 30")
        if self.yaw_deg is not None and (
            not self.yaw_deg or not np.all(np.abs(self.yaw_deg) <= 360)
        ):
            raise ValueError(
                f"views.yaw_deg: {self.yaw_deg}; list yaws between -360 and 360, such as [0, 15]"
            )

    @property
    def total(self) -> int:
        """How many views each subject has."""
        return self.count if self.yaw_deg is None else len(self.yaw_deg)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """(V,) float32 degrees."""
        if self.yaw_deg is not None:
            return np.asarray(self.yaw_deg, dtype=np.float32)
        return rng.uniform(-self.max_yaw_deg, self.max_yaw_deg, self.count).astype(np.float32)
