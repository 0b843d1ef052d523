"""A branch's networks at work: steps of learning, and predictions."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel
from torch.optim import Adam, Optimizer

from trainer import checkpoint, losses, processes
from trainer.branch import Branch
from trainer.checkpoint import Checkpoint, CheckpointError
from trainer.losses import Features, Surface, Terms
from trainer.normals import normals
from trainer.record import from_record
from trainer.views import DepthRange, Sample

Precision = Literal["float32", "bfloat16"]


class Learner:
    """A branch's networks, which learn from batches.

    Where torchrun started several processes, each has a copy and a part of every batch, and all
    take the step of the whole batch.

    Attributes:
        networks: "generator" and, where the branch has one, "discriminator".
        optimizers: of each of them.

    Args:
        branch: what the user chose.
        span: the depths that -1 and 1 stand for.
        rate: of Adam.
        vgg: the features of Eq. 9, or None.
        device: where the networks are.
        precision: of the networks' convolutions; losses and depth are of 32 bits.
    """

    def __init__(
        self,
        branch: Branch,
        span: DepthRange,
        rate: float,
        vgg: Features | None = None,
        device: torch.device | str = "cpu",
        precision: Precision = "float32",
    ) -> None:
        self.branch, self.span, self.vgg = branch, span, vgg
        self.device, self.precision = torch.device(device), precision
        self.networks: dict[str, nn.Module] = {"generator": branch.network()}
        judge = branch.judge()
        if judge is not None:
            self.networks["discriminator"] = judge
        for network in self.networks.values():
            # A pixel's channels side by side: a fifth to two fifths faster on processors.
            network.to(self.device, memory_format=torch.channels_last)
        self.optimizers: dict[str, Optimizer] = {
            name: Adam(network.parameters(), lr=rate) for name, network in self.networks.items()
        }
        self._shared = dict(self.networks)
        if processes.count() > 1:
            self._shared = {
                name: DistributedDataParallel(network) for name, network in self.networks.items()
            }

    def step(self, batch: Sample) -> Terms:
        """Learn from a batch, the discriminator before the generator; the losses' terms."""
        depth, logit = self._generate(self._shared["generator"], batch)
        predicted, true = self.surface(depth, batch), self.surface(self.branch.true(batch), batch)
        judged: Terms = {}
        layers: tuple[list[Tensor], list[Tensor]] = ([], [])
        if "discriminator" in self.networks:
            maps = [self.branch.judged(s, batch.mask, self.span) for s in (predicted, true)]
            fake, real = self._judge(self._shared["discriminator"], maps[0].detach(), maps[1])
            loss, terms = losses.discriminator_loss(real[-1], fake[-1], batch.mask)
            self._descend("discriminator", loss)
            judged = {"discriminator": terms["gan"]}
            with _frozen(self.networks["discriminator"]):
                layers = self._judge(self.networks["discriminator"], *maps)
        loss, terms = self.branch.loss(predicted, true, logit, layers, batch.mask, self.vgg)
        self._descend("generator", loss)
        return {**terms, **judged}

    def predict(self, batch: Sample) -> Tensor:
        """(B, 1, H, W) depth in metres, 0 outside the silhouette.

        No layer of these networks does another thing while it learns: norms are of one sample.
        """
        with torch.no_grad():
            return self._generate(self.networks["generator"], batch)[0]

    def surface(self, depth: Tensor, batch: Sample) -> Surface:
        """Depth with its normals by Eq. 6, true ones too: perfect depth has no loss."""
        return Surface(depth, normals(depth, batch.pixel_size, batch.mask, self.branch.side))

    def set_rate(self, rate: float) -> None:
        """Learn at another rate from now on."""
        for optimizer in self.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = rate

    def state(self) -> dict[str, dict]:
        """Everything that learning changes, by name."""
        networks = {name: network.state_dict() for name, network in self.networks.items()}
        optimizers = {f"{n}_adam": found.state_dict() for n, found in self.optimizers.items()}
        return {**networks, **optimizers}

    def load_state(self, state: dict[str, dict]) -> None:
        """Go on from a state.

        Raises:
            ValueError: it is of other networks.
        """
        try:
            for name, network in self.networks.items():
                network.load_state_dict(state[name])
                self.optimizers[name].load_state_dict(state[f"{name}_adam"])
        except (ValueError, TypeError, KeyError, RuntimeError, AttributeError) as error:
            reason = textwrap.shorten(str(error), 150, placeholder=" ...")
            raise ValueError(f"networks of another program ({reason})") from None

    def _generate(self, network: nn.Module, batch: Sample) -> tuple[Tensor, Tensor | None]:
        """Depth in metres, and the silhouette's logit."""
        with self._autocast():
            depth, logit = self.branch.predict(network, batch, self.span)
        metres = torch.where(batch.mask, self.span.metres(depth.float()), 0)
        return metres, None if logit is None else logit.float()

    def _judge(
        self, network: nn.Module, fake: Tensor, real: Tensor
    ) -> tuple[list[Tensor], list[Tensor]]:
        """The discriminator's layers for both, from one pass; its norms are of single samples."""
        with self._autocast():
            layers = network(torch.cat([fake, real]))
        halves = [layer.float().chunk(2) for layer in layers]
        return [half[0] for half in halves], [half[1] for half in halves]

    def _autocast(self) -> torch.autocast:
        half = self.precision == "bfloat16"
        return torch.autocast(self.device.type, torch.bfloat16, enabled=half)

    def _descend(self, name: str, loss: Tensor) -> None:
        self.optimizers[name].zero_grad(set_to_none=True)
        loss.backward()
        self.optimizers[name].step()


def load(path: Path | str, device: torch.device | str = "cpu") -> Learner:
    """The learner of a checkpoint, to predict with.

    Raises:
        CheckpointError: the file is no checkpoint of this program.
    """
    return restored(checkpoint.load(Path(path)), path, device)


def restored(found: Checkpoint, path: Path | str, device: torch.device | str = "cpu") -> Learner:
    """The learner of a checkpoint that was read from `path`, likewise."""
    try:
        learner = Learner(
            from_record(found.config["branch"]),
            found.range,
            found.config["learning_rate"],
            device=device,
            precision=found.config["precision"],
        )
        learner.load_state(found.state)
    except (ValueError, TypeError, KeyError) as error:
        raise CheckpointError(f"{path} cannot be used: {error}; train again") from None
    return learner


@contextmanager
def _frozen(network: nn.Module) -> Iterator[None]:
    """Leave a network's parameters out of what is computed inside a `with` block."""
    network.requires_grad_(False)
    try:
        yield
    finally:
        network.requires_grad_(True)
