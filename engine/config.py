"""The configuration of a build: what each stage is told."""

from __future__ import annotations

from dataclasses import dataclass, field

from augment.color_camera import ColorCamera
from augment.light import LightConfig
from augment.sensors import SENSORS, NormalGAN, Sensor
from render.camera import CameraConfig
from render.cycles import CyclesConfig
from render.views import ViewsConfig
from shards.config import ShardsConfig
from subjects.open import OpenHumans
from subjects.scans import Scans
from subjects.source import Source

SOURCES: tuple[type[Source], ...] = (OpenHumans, Scans)

CHOICES: dict[str, tuple[type, ...]] = {"subjects": SOURCES, "sensor": tuple(SENSORS.values())}
"""Settings that choose a class -> the classes."""


@dataclass(frozen=True)
class BuildConfig:
    """Everything that decides a dataset's bytes."""

    subjects: Source = field(default_factory=OpenHumans)
    """Where the surfaces come from: OpenHumans or Scans, with its options."""
    views: ViewsConfig = field(default_factory=ViewsConfig)
    """How each subject is turned."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    """The orthographic camera."""
    light: LightConfig = field(default_factory=LightConfig)
    """The point light and the exposure."""
    cycles: CyclesConfig = field(default_factory=CyclesConfig)
    """How Blender's Cycles renders."""
    color_camera: ColorCamera | None = None
    """The camera whose noise the colours have, such as {"full_well": 8000}; null for none."""
    sensor: Sensor = field(default_factory=NormalGAN)
    """The depth sensor that looks at the front, with its parameters: NormalGAN, KinectV2,
    TimeOfFlight, KinectV1 or AzureKinect."""
    shards: ShardsConfig = field(default_factory=ShardsConfig)
    """How shards are written."""
    seed: int = 0
    """Every random draw comes from this seed, the subject, the view and the purpose."""

    def __post_init__(self) -> None:
        if not 0 <= self.seed < 2**63:
            raise ValueError(f"seed: {self.seed}; give a whole number from 0 to 2^63 - 1")
