"""A source of one's own: vases, turned on a lathe, each from its seed.

python pipeline.py build --config examples/new_source.yaml --output out/vases
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

import seeds
from subjects.source import Source
from subjects.subject import Subject


@dataclass(frozen=True)
class Vases(Source):
    """Vases of random outline. A source is its own configuration: these are its options."""

    count: int = 4
    """How many."""
    height: float = 1.6
    """Metres."""

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"subjects.count: {self.count}; give 1 or more")

    @property
    def packages(self) -> tuple[str, ...]:
        """Whose versions the files' bytes depend on."""
        return ("trimesh",)

    @property
    def loads_torch(self) -> bool:
        """Nothing here does, so that surface and render share a process."""
        return False

    def ids(self) -> list[str]:
        """As `Source.ids`."""
        return [f"vase_{k:04d}" for k in range(self.count)]

    def make(self, subject: str, seed: int, folder: Path) -> Subject:
        """As `Source.make`: every draw comes from the seed and the subject's name."""
        rng = seeds.generator(seed, subject, "outline")
        up = np.linspace(0, 1, 60)
        waves = rng.normal(0, 0.05, 3) @ np.sin(np.outer([1, 2, 3], np.pi * up + rng.uniform(0, 6)))
        radius = 0.25 + waves
        radius[[0, -1]] = 0  # closed at both ends
        outline = np.column_stack([radius, self.height * up])
        mesh = trimesh.creation.revolve(outline, sections=120)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
        mesh.visual.vertex_colors = np.append(rng.integers(60, 250, 3), 255)
        path = folder / f"{subject}.ply"
        mesh.export(path)
        return Subject(subject, source="vases", licence="CC0-1.0", mesh=path)
