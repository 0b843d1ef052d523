"""The two branches: what a user chooses of each, what its network sees, and what it descends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import torch
from torch import Tensor, nn

from trainer import losses
from trainer.losses import BackWeights, Features, FrontWeights, Surface, Terms
from trainer.networks.back import BackNet, BackNetConfig
from trainer.networks.discriminator import Discriminator, DiscriminatorConfig
from trainer.networks.front import FrontNet, FrontNetConfig
from trainer.normals import Side
from trainer.views import DepthRange, Sample

FAR = 1.0
"""Normalised depth of what lies outside the silhouette."""


@dataclass(frozen=True)
class Branch(ABC):
    """What a user chooses of one of the paper's two branches."""

    name: ClassVar[str]
    side: ClassVar[Side]

    @property
    def needs_body(self) -> bool:
        """Whether the network is given the body's maps."""
        return False

    @abstractmethod
    def network(self) -> nn.Module:
        """The generator, its weights drawn from torch's generator."""

    @abstractmethod
    def judge(self) -> Discriminator | None:
        """The discriminator, likewise, if one judges this branch."""

    @abstractmethod
    def given(self, batch: Sample) -> Tensor:
        """(B, 1, H, W) metres: the depth that the branch has to better."""

    @abstractmethod
    def predict(
        self, network: nn.Module, batch: Sample, span: DepthRange
    ) -> tuple[Tensor, Tensor | None]:
        """Normalised depth, and the silhouette's logit of a network that has one: (B, 1, H, W)."""

    @abstractmethod
    def loss(
        self,
        predicted: Surface,
        true: Surface,
        logit: Tensor | None,
        layers: tuple[Sequence[Tensor], Sequence[Tensor]],
        mask: Tensor,
        vgg: Features | None,
    ) -> tuple[Tensor, Terms]:
        """What the generator descends, and its terms.

        Args:
            layers: the discriminator's for the predicted maps and for the true; empty without one.
        """

    def true(self, batch: Sample) -> Tensor:
        """(B, 1, H, W) metres."""
        return batch.front if self.side == "front" else batch.back

    def judged(self, surface: Surface, mask: Tensor, span: DepthRange) -> Tensor:
        """(B, C, H, W) maps that the discriminator sees; 0 outside the silhouette."""
        return surface.normal


@dataclass(frozen=True)
class Front(Branch):
    """Denoises the front: colour and sensor depth to depth (section 3.3)."""

    name: ClassVar[str] = "front"
    side: ClassVar[Side] = "front"

    net: FrontNetConfig = field(default_factory=FrontNetConfig)
    """The network."""
    gamma: FrontWeights = field(default_factory=FrontWeights)
    """Coefficients of Eq. 10."""
    normal_gan: DiscriminatorConfig | None = None
    """A discriminator of the normals, as NormalGAN has (Table 3's "U-Net+nGAN"); null for none."""

    def __post_init__(self) -> None:
        for name in ("gan", "matching"):
            changed = getattr(self.gamma, name) != getattr(FrontWeights(), name)
            if changed and self.normal_gan is None:
                raise ValueError(
                    f"branch.gamma.{name}: nothing judges this front; give branch.normal_gan too"
                )

    def network(self) -> FrontNet:
        return FrontNet(self.net)

    def judge(self) -> Discriminator | None:
        return None if self.normal_gan is None else Discriminator(self.normal_gan, 3)

    def given(self, batch: Sample) -> Tensor:
        return batch.sensor

    def predict(
        self, network: nn.Module, batch: Sample, span: DepthRange
    ) -> tuple[Tensor, Tensor | None]:
        depth = _normalised(batch.sensor, batch.mask, span)
        return network(2 * batch.rgb - 1, depth, batch.valid, batch.mask), None

    def loss(
        self,
        predicted: Surface,
        true: Surface,
        logit: Tensor | None,
        layers: tuple[Sequence[Tensor], Sequence[Tensor]],
        mask: Tensor,
        vgg: Features | None,
    ) -> tuple[Tensor, Terms]:
        return losses.front_loss(predicted, true, mask, self.gamma, vgg, *layers)


@dataclass(frozen=True)
class Back(Branch):
    """Refines the back: the body's coarse depth to depth (section 3.4)."""

    name: ClassVar[str] = "back"
    side: ClassVar[Side] = "back"

    generator: BackNetConfig = field(default_factory=BackNetConfig)
    """The generator."""
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    """The Markovian discriminator."""
    beta: BackWeights = field(default_factory=BackWeights)
    """Coefficients of Eq. 14."""
    source: Literal["body", "sensor"] = "body"
    """What the back is made from: the body's coarse back, or colour and depth of the front as
    NormalGAN does (Table 4's "nGAN").
    """
    silhouette: Literal["given", "predicted"] = "given"
    """Whether the generator sees the subject's silhouette, or the body alone, as far as it lies
    inside that, and learns by L_P how far clothes and hair reach (Eq. 5 and 13).
    """
    judged_by: Literal["normals", "depth"] = "normals"
    """What the discriminator sees; "depth" is Table 4's "dGAN"."""

    def __post_init__(self) -> None:
        if self.source == "sensor" and self.silhouette == "predicted":
            raise ValueError(
                "branch.silhouette: predicted, but the sensor's depth shows it; give branch.source "
                "body, or given"
            )

    @property
    def needs_body(self) -> bool:
        return self.source == "body"

    def network(self) -> BackNet:
        if self.source == "body":
            return BackNet(self.generator, inputs=2)
        return BackNet(self.generator, inputs=4, correction=0.5)

    def judge(self) -> Discriminator:
        return Discriminator(self.discriminator, 3 if self.judged_by == "normals" else 1)

    def given(self, batch: Sample) -> Tensor:
        return batch.coarse

    def predict(
        self, network: nn.Module, batch: Sample, span: DepthRange
    ) -> tuple[Tensor, Tensor | None]:
        if self.source == "body":
            shown_at = batch.mask if self.silhouette == "given" else batch.body
            depth, more = batch.coarse, 2.0 * batch.body - 1
        else:
            shown_at, depth, more = batch.mask, batch.sensor, 2 * batch.rgb - 1
        seen = torch.cat([_normalised(depth, shown_at, span), more], dim=1)
        return network(seen, _normalised(depth, batch.mask, span), shown_at)

    def loss(
        self,
        predicted: Surface,
        true: Surface,
        logit: Tensor | None,
        layers: tuple[Sequence[Tensor], Sequence[Tensor]],
        mask: Tensor,
        vgg: Features | None,
    ) -> tuple[Tensor, Terms]:
        assert logit is not None
        silhouette = logit.sigmoid()
        return losses.generator_loss(predicted, true, silhouette, *layers, mask, self.beta, vgg)

    def judged(self, surface: Surface, mask: Tensor, span: DepthRange) -> Tensor:
        if self.judged_by == "normals":
            return surface.normal
        return torch.where(mask, span.normalised(surface.depth), 0)


def _normalised(depth: Tensor, mask: Tensor, span: DepthRange) -> Tensor:
    """What a network is given of a depth in metres."""
    return torch.where(mask, span.normalised(depth), FAR)
