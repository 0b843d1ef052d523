"""The two branches: what each network is given, what it learns, and how it is measured."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.optim import Adam, Optimizer

from trainer import losses
from trainer.back import BackNet, BackNetConfig
from trainer.discriminator import Discriminator, DiscriminatorConfig
from trainer.front import FrontNet, FrontNetConfig
from trainer.losses import BackWeights, Features, FrontWeights, Surface, Terms
from trainer.normals import Side, normals
from trainer.views import DepthRange, Sample

FAR = 1.0
"""Normalised depth of what lies outside the silhouette."""


@dataclass(frozen=True)
class Branch(ABC):
    """What a user chooses of one of the paper's two branches."""

    name: ClassVar[str]
    side: ClassVar[Side]

    @abstractmethod
    def learner(self, span: DepthRange, rate: float, vgg: Features | None) -> Learner:
        """Fresh networks from torch's generator, and their optimisers."""


@dataclass(frozen=True)
class Front(Branch):
    """Denoises the front: colour and sensor depth to depth (section 3.3)."""

    name: ClassVar[str] = "front"
    side: ClassVar[Side] = "front"

    net: FrontNetConfig = field(default_factory=FrontNetConfig)
    """The network."""
    gamma: FrontWeights = field(default_factory=FrontWeights)
    """Coefficients of Eq. 10."""

    def learner(self, span: DepthRange, rate: float, vgg: Features | None) -> FrontLearner:
        return FrontLearner(self, span, rate, vgg)


@dataclass(frozen=True)
class Back(Branch):
    """Refines the back: the body's coarse depth to depth (section 3.4)."""

    name: ClassVar[str] = "back"
    side: ClassVar[Side] = "back"

    generator: BackNetConfig = field(default_factory=BackNetConfig)
    """The generator."""
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    """The Markovian discriminator, on normal maps."""
    beta: BackWeights = field(default_factory=BackWeights)
    """Coefficients of Eq. 14."""

    def learner(self, span: DepthRange, rate: float, vgg: Features | None) -> BackLearner:
        return BackLearner(self, span, rate, vgg)


class Learner(ABC):
    """Networks that learn from batches.

    Attributes:
        networks: name -> module; the first predicts depth.
        optimizers: name -> its optimiser.
    """

    networks: dict[str, nn.Module]

    def __init__(self, side: Side, span: DepthRange, rate: float, vgg: Features | None) -> None:
        self.side, self.span, self.vgg = side, span, vgg
        self.optimizers: dict[str, Optimizer] = {
            name: Adam(network.parameters(), lr=rate) for name, network in self.networks.items()
        }

    @abstractmethod
    def step(self, batch: Sample) -> Terms:
        """Learn from a batch; the unweighted terms of the losses."""

    @abstractmethod
    def predict(self, batch: Sample) -> Tensor:
        """(B, 1, H, W) depth in metres, 0 outside the silhouette."""

    @abstractmethod
    def given(self, batch: Sample) -> Tensor:
        """(B, 1, H, W) metres: the depth that the network improves."""

    def true(self, batch: Sample) -> Tensor:
        """(B, 1, H, W) metres."""
        return batch.front if self.side == "front" else batch.back

    def surface(self, depth: Tensor, batch: Sample) -> Surface:
        """Depth with its normals by Eq. 6, true ones too: perfect depth has no loss."""
        return Surface(depth, normals(depth, batch.pixel_size, batch.mask, self.side))

    def state(self) -> dict[str, dict]:
        """Everything that learning changes, by name."""
        networks = {name: network.state_dict() for name, network in self.networks.items()}
        optimizers = {f"{n}_adam": found.state_dict() for n, found in self.optimizers.items()}
        return {**networks, **optimizers}

    def load_state(self, state: dict[str, dict]) -> None:
        """Go on from a state.

        Raises:
            RuntimeError, KeyError: it is of other networks.
        """
        for name, network in self.networks.items():
            network.load_state_dict(state[name])
            self.optimizers[name].load_state_dict(state[f"{name}_adam"])

    def train(self, mode: bool) -> None:
        """Whether the networks are to learn."""
        for network in self.networks.values():
            network.train(mode)

    def normalised(self, depth: Tensor, batch: Sample) -> Tensor:
        """What a network is given of a depth in metres."""
        return torch.where(batch.mask, self.span.normalised(depth), FAR)

    def metres(self, normalised: Tensor, batch: Sample) -> Tensor:
        """What a network's depth means."""
        return torch.where(batch.mask, self.span.metres(normalised), 0)

    def _descend(self, name: str, loss: Tensor) -> None:
        self.optimizers[name].zero_grad(set_to_none=True)
        loss.backward()
        self.optimizers[name].step()


class FrontLearner(Learner):
    """Learns Eq. 10."""

    def __init__(self, branch: Front, span: DepthRange, rate: float, vgg: Features | None) -> None:
        self.net = FrontNet(branch.net)
        self.networks = {"front": self.net}
        self.gamma = branch.gamma
        super().__init__(branch.side, span, rate, vgg)

    def given(self, batch: Sample) -> Tensor:
        return batch.sensor

    def predict(self, batch: Sample) -> Tensor:
        depth = self.net(2 * batch.rgb - 1, self.normalised(batch.sensor, batch))
        return self.metres(depth, batch)

    def step(self, batch: Sample) -> Terms:
        predicted = self.surface(self.predict(batch), batch)
        true = self.surface(self.true(batch), batch)
        loss, terms = losses.front_loss(predicted, true, batch.mask, self.gamma, self.vgg)
        self._descend("front", loss)
        return terms


class BackLearner(Learner):
    """Learns Eq. 14 and 15, a step of the discriminator before each of the generator's."""

    def __init__(self, branch: Back, span: DepthRange, rate: float, vgg: Features | None) -> None:
        self.net = BackNet(branch.generator)
        self.judge = Discriminator(branch.discriminator)
        self.networks = {"back": self.net, "discriminator": self.judge}
        self.beta = branch.beta
        super().__init__(branch.side, span, rate, vgg)

    def given(self, batch: Sample) -> Tensor:
        return batch.coarse

    def predict(self, batch: Sample) -> Tensor:
        return self._generate(batch)[0]

    def _generate(self, batch: Sample) -> tuple[Tensor, Tensor]:
        """Depth in metres, and the soft silhouette."""
        depth, logit = self.net(self.normalised(batch.coarse, batch))
        return self.metres(depth, batch), logit.sigmoid()

    def step(self, batch: Sample) -> Terms:
        depth, silhouette = self._generate(batch)
        predicted, true = self.surface(depth, batch), self.surface(self.true(batch), batch)
        real, fake = self.judge(true.normal), self.judge(predicted.normal.detach())
        loss, judged = losses.discriminator_loss(real[-1], fake[-1], batch.mask)
        self._descend("discriminator", loss)
        with _frozen(self.judge):
            real, fake = self.judge(true.normal), self.judge(predicted.normal)
            loss, terms = losses.generator_loss(
                predicted, true, silhouette, fake, real, batch.mask, self.beta, self.vgg
            )
            self._descend("back", loss)
        return {**terms, "discriminator": judged["gan"]}


@contextmanager
def _frozen(network: nn.Module) -> Iterator[None]:
    """Leave a network's parameters out of the gradients inside a `with` block."""
    network.requires_grad_(False)
    try:
        yield
    finally:
        network.requires_grad_(True)


def errors(learner: Learner, batches: Iterable[Sample]) -> dict[str, float]:
    """Mean absolute errors over the silhouettes' pixels: of what was given and what is predicted.

    Returns:
        "given_mm" and "depth_mm" of depth, "given_normal" and "normal" of the normals' parts, and
        the ratios "depth_ratio" and "normal_ratio".
    """
    sums = dict.fromkeys(("given_mm", "depth_mm", "given_normal", "normal"), 0.0)
    pixels = 0
    learner.train(False)
    with torch.no_grad():
        for batch in batches:
            count = int(batch.mask.sum())
            pixels += count
            true = learner.surface(learner.true(batch), batch)
            for depth, of_depth, of_normal in (
                (learner.given(batch), "given_mm", "given_normal"),
                (learner.predict(batch), "depth_mm", "normal"),
            ):
                found = learner.surface(depth, batch)
                off = losses.mean_l1(depth, true.depth, batch.mask)
                sums[of_depth] += 1000 * count * float(off)
                off = losses.mean_l1(found.normal, true.normal, batch.mask)
                sums[of_normal] += count * float(off)
    learner.train(True)
    means = {name: total / max(pixels, 1) for name, total in sums.items()}
    means["depth_ratio"] = means["depth_mm"] / max(means["given_mm"], 1e-9)
    means["normal_ratio"] = means["normal"] / max(means["given_normal"], 1e-9)
    return means
