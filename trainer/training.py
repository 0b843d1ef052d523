"""A training: epochs over the training views, figures on the test views, resumed if stopped."""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch.utils.data import DataLoader
from tqdm import tqdm

from shards.atomic import atomic_write
from trainer import checkpoint, vgg
from trainer.branch import Branch, Front, Learner, errors
from trainer.checkpoint import CheckpointError
from trainer.views import DepthRange, Sample, Views, ViewsConfig

CHECKPOINT, HISTORY = "checkpoint.pt", "history.jsonl"


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides what a training learns."""

    branch: Branch = field(default_factory=Front)
    """Front or Back, with its networks and the coefficients of its losses."""
    views: ViewsConfig = field(default_factory=ViewsConfig)
    """How the views are cropped and varied."""
    epochs: int = 45
    """How often every training view is seen."""
    batch: int = 16
    """Views in a batch."""
    learning_rate: float = 1e-3
    """Of Adam."""
    vgg: str | None = None
    """File of torchvision's vgg19 weights for L_V of Eq. 9; null leaves that term out."""
    seed: int = 0
    """Of the networks' first values, the order of the views and their variation."""

    def __post_init__(self) -> None:
        for name, least, most in (("epochs", 1, 10**6), ("batch", 1, 4096)):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name}: {getattr(self, name)}; give {least} to {most}")
        if not 0 < self.learning_rate < 1:
            raise ValueError(f"learning_rate: {self.learning_rate}; give 0 to 1, such as 0.001")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed: {self.seed}; give a whole number from 0 to 2147483647")


class Training:
    """A training's folder: its checkpoint, and a line of history for each epoch.

    Args:
        config: the training's.
        record: the same as plain JSON values, for the checkpoint to keep.
        data: folder of the dataset.
        output: folder of the training; made if missing, taken up again if it was interrupted.
        workers: processes that read views; 0 reads them in this one.
        device: "cpu", "cuda", ...

    Raises:
        ValueError: the dataset lacks a split, the checkpoint is of another configuration or
            dataset, or `output` holds other things.
    """

    def __init__(
        self,
        config: TrainConfig,
        record: dict[str, Any],
        data: Path,
        output: Path,
        workers: int = 0,
        device: str = "cpu",
    ) -> None:
        self.config, self.output = config, output
        self.record = json.loads(json.dumps(record))
        self.workers, self.device = workers, torch.device(device)
        self.train_views = Views(data, "train", config.views, varied=True, seed=config.seed)
        self.test_views = Views(data, "test", config.views, varied=False, seed=config.seed)
        self.data = {
            "config_sha256": self.train_views.dataset.description["config_sha256"],
            "subjects": [*self.train_views.subjects, *self.test_views.subjects],
        }
        self.history: list[dict[str, float]] = []
        found = self._found()
        span = DepthRange(*found["range"]) if found else self.train_views.depth_range()
        torch.manual_seed(config.seed)
        features = None if config.vgg is None else vgg.load(config.vgg).to(self.device)
        self.learner: Learner = config.branch.learner(span, config.learning_rate, features)
        if found:
            self.learner.load_state(found["state"])
            self.history = list(found["metrics"])
        self._to_device()

    @property
    def done(self) -> int:
        """How many epochs are behind it."""
        return len(self.history)

    def run(self) -> dict[str, float]:
        """Train to the last epoch; the figures of the last."""
        if self.config.vgg is None:
            print("no vgg file: the VGG19 term (Eq. 9) is off", file=sys.stderr)
        if self.done:
            print(f"{self.done} of {self.config.epochs} epochs stand already", file=sys.stderr)
        for epoch in range(self.done, self.config.epochs):
            figures = self._epoch(epoch)
            self.history.append(figures)
            self._save()
            print(
                f"  epoch {epoch + 1}/{self.config.epochs}: test depth {figures['depth_mm']:.2f} mm"
                f" of {figures['given_mm']:.2f} given ({figures['depth_ratio']:.0%}), normals "
                f"{figures['normal_ratio']:.0%}, {figures['seconds']:.0f} s, "
                f"{figures['waiting']:.0%} of it waiting for data",
                file=sys.stderr,
                flush=True,
            )
        return self.history[-1]

    def _epoch(self, epoch: int) -> dict[str, float]:
        start = time.monotonic()
        waiting = 0.0
        sums: dict[str, float] = {}
        loader = self._loader(self.train_views, epoch)
        batches = iter(loader)
        bar = tqdm(
            total=len(loader),
            desc=f"epoch {epoch + 1}",
            leave=False,
            disable=not sys.stderr.isatty(),
        )
        with bar:
            for _ in range(len(loader)):
                asked = time.monotonic()
                batch = self._moved(next(batches))
                waiting += time.monotonic() - asked
                for name, term in self.learner.step(batch).items():
                    sums[name] = sums.get(name, 0.0) + float(term)
                bar.update()
        elapsed = time.monotonic() - start
        terms = {f"loss_{name}": total / len(loader) for name, total in sums.items()}
        if not all(map(math.isfinite, terms.values())):
            raise FloatingPointError(
                f"epoch {epoch + 1}: a loss is not finite ({terms}); lower learning_rate"
            )
        found = errors(self.learner, map(self._moved, self._loader(self.test_views, 0, False)))
        return {**terms, **found, "seconds": elapsed, "waiting": waiting / elapsed}

    def _loader(self, views: Views, epoch: int, shuffle: bool = True) -> DataLoader:
        views.set_epoch(epoch)
        order = torch.Generator().manual_seed(self.config.seed * 1_000_003 + epoch)
        return DataLoader(
            views,
            batch_size=self.config.batch,
            shuffle=shuffle,
            num_workers=self.workers,
            generator=order,
            pin_memory=self.device.type == "cuda",
        )

    def _moved(self, batch: Sample) -> Sample:
        return Sample(*(part.to(self.device, non_blocking=True) for part in batch))

    def _to_device(self) -> None:
        for network in self.learner.networks.values():
            network.to(self.device)
        for optimizer in self.learner.optimizers.values():
            for state in optimizer.state.values():
                for key, value in state.items():
                    if isinstance(value, torch.Tensor) and key != "step":
                        state[key] = value.to(self.device)

    def _found(self) -> dict[str, Any] | None:
        """The checkpoint that stands, if there is one."""
        path = self.output / CHECKPOINT
        if not path.exists():
            if self.output.exists() and any(self.output.iterdir()):
                raise ValueError(
                    f"{self.output} is not empty and holds no {CHECKPOINT}; choose a new folder"
                )
            return None
        found = checkpoint.load(path)
        same = {k: v for k, v in found["config"].items() if k != "epochs"}
        if same != {k: v for k, v in self.record.items() if k != "epochs"}:
            keys = sorted(k for k in self.record if same.get(k) != self.record[k] and k != "epochs")
            raise CheckpointError(
                f"{path} is of another configuration ({', '.join(keys)}); choose another folder"
            )
        if found["data"] != self.data:
            raise CheckpointError(f"{path} learned from another dataset; choose another folder")
        return found

    def _save(self) -> None:
        self.output.mkdir(parents=True, exist_ok=True)
        checkpoint.save(
            self.output / CHECKPOINT,
            {
                "branch": self.config.branch.name,
                "config": self.record,
                "range": list(self.learner.span),
                "epoch": self.done,
                "state": self.learner.state(),
                "metrics": self.history,
                "data": self.data,
            },
        )
        with atomic_write(self.output / HISTORY) as file:
            file.writelines(json.dumps(figures).encode() + b"\n" for figures in self.history)
