"""What an experiment is run with."""

from __future__ import annotations

from dataclasses import dataclass, field

from surface.fusion import STEP
from surface.truth import SAMPLES


@dataclass(frozen=True)
class ExperimentConfig:
    """The size of a study. Files are looked for here, then in the checkout."""

    data: str | None = None
    """Folder of a dataset that stands; null builds one in the study's folder."""
    build: str = "configs/open.yaml"
    """Configuration of the dataset that is built."""
    front: str = "configs/train_front_cpu.yaml"
    """Configuration of the front branch's trainings."""
    back: str = "configs/train_back_cpu.yaml"
    """Likewise of the back branch's."""
    front_epochs: int | None = None
    """In place of its configuration's."""
    back_epochs: int | None = None
    """Likewise."""
    seeds: list[int] = field(default_factory=lambda: [0, 1])
    """Each training is repeated with these."""
    device: str = "cpu"
    """Where networks learn and predict; two trainings share it."""
    views: list[int] | None = None
    """Of each test subject, that are reconstructed and measured; null takes all."""
    step: float | None = STEP
    """As `reconstruct` has it."""
    samples: int = SAMPLES
    """As `evaluate` has it."""
    sweep: str = "configs/light_sweep.yaml"
    """Configuration of the light sweep."""
    sweep_views: list[int] = field(default_factory=lambda: [0])
    """Of each test subject, that are reconstructed under every power."""

    def __post_init__(self) -> None:
        if not self.seeds or len(set(self.seeds)) < len(self.seeds):
            raise ValueError(f"seeds: {self.seeds}; give one or more, each once")
        if not self.sweep_views:
            raise ValueError("sweep_views: give one or more")
