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
    normal_gan_width: int | None = None
    """Channels of the discriminator of U-Net+nGAN; null as in its configuration."""
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
        for key in ("seeds", "views", "sweep_views"):
            given = getattr(self, key)
            if given is None:
                continue
            if not given or len(set(given)) < len(given) or min(given) < 0:
                raise ValueError(f"{key}: {given}; give one or more from 0, each once")
        for key in ("front_epochs", "back_epochs", "normal_gan_width"):
            given = getattr(self, key)
            if given is not None and given < 1:
                raise ValueError(f"{key}: {given}; give 1 or more")
        if self.step is not None and not 0 < self.step < 10:
            raise ValueError(f"step: {self.step}; give metres, such as {STEP}, or null")
        if not 100 <= self.samples <= 10**7:
            raise ValueError(f"samples: {self.samples}; give 100 to 10000000")
