"""A training: epochs over the training views, figures on the test views, resumed if stopped."""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import torch
from PIL import Image
from torch.utils.data import DataLoader, DistributedSampler, Subset
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

import seeds
from shards.checksum import file_sha256
from shards.lock import LOCK, hold_folder, lock_folder
from shards.manifest import differences
from storage.atomic import atomic_write, is_temporary, remove_temporary_files
from trainer import checkpoint, processes
from trainer.branch import Branch, Front
from trainer.checkpoint import Checkpoint, CheckpointError
from trainer.errors import Figures, errors, told
from trainer.learner import Learner, Precision
from trainer.networks import vgg
from trainer.pictures import picture
from trainer.record import to_record
from trainer.views import Sample, Views, ViewsConfig

CHECKPOINT, HISTORY, PICTURE, BOARD = "checkpoint.pt", "history.jsonl", "test.png", "tensorboard"

SHOWN = 4
"""Test views in the picture, spread evenly over them."""


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
    """Views in a batch, of all processes together."""
    learning_rate: float = 1e-3
    """Of Adam."""
    decay: Literal["none", "cosine"] = "none"
    """Whether the learning rate stays, as in the paper, or falls to 0 over the training."""
    precision: Precision = "float32"
    """Of the networks; bfloat16 is faster where the processor or the GPU knows it."""
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


class DivergedError(ValueError):
    """A loss that is no number any more; one line: where, the losses, the cure."""


class Training:
    """A training's folder: its checkpoint, a line of history for each epoch, and what to look at.

    Started by torchrun, every process opens the same folder and the first writes it.

    Args:
        config: the training's.
        data: folder of the dataset.
        output: folder of the training; made if missing, taken up again if it was interrupted.
        workers: processes that read views, for each process that learns; 0 reads in that itself.
        device: "cpu", "cuda", ...

    Raises:
        ValueError: the dataset lacks a split, the checkpoint is of another configuration or
            dataset, `output` holds other things, crops are too small, or there are too few GPUs.
    """

    def __init__(
        self,
        config: TrainConfig,
        data: Path,
        output: Path,
        workers: int = 0,
        device: str = "cpu",
    ) -> None:
        if workers < 0:
            raise ValueError(f"workers: {workers}; give 0 or more")
        self.config, self.output = config, output
        features = None if config.vgg is None else vgg.load(config.vgg)
        plain = {
            **asdict(config),
            "branch": to_record(config.branch),
            # By its bytes: the file may lie elsewhere on the next machine.
            "vgg": None if config.vgg is None else file_sha256(Path(config.vgg)),
        }
        self.record = json.loads(json.dumps(plain))
        self.workers = workers
        self.device = _device(device)
        if config.batch % processes.count():
            raise ValueError(
                f"batch: {config.batch} for {processes.count()} processes; give a multiple of that"
            )
        views = config.views
        self.train_views = Views(data, "train", views, varied=True, seed=config.seed)
        self.test_views = Views(data, "test", views, varied=False, seed=config.seed)
        if config.branch.needs_body:
            bare = [*self.train_views.without_body(), *self.test_views.without_body()]
            if bare:
                raise ValueError(
                    f"{data}: {bare[0]} has no body to refine, nor have {len(bare) - 1} more; "
                    "build it with fits, or give branch.source sensor"
                )
        # Whole people are measured, however small the crops are that are learned from.
        self.test_views.show_whole()
        self.data = _identity(self.train_views, self.test_views)
        self.history: list[Figures] = []
        found = self._found()
        span = found.range if found else self.train_views.depth_range()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.learner = Learner(
                config.branch,
                span,
                config.learning_rate,
                vgg=None if features is None else features.to(self.device),
                device=self.device,
                precision=config.precision,
            )
        judge = self.learner.networks.get("discriminator")
        if judge is not None and min(views.size) < judge.config.least:
            raise ValueError(
                f"views.size: {views.size}; this discriminator needs {judge.config.least} pixels "
                "or more each way"
            )
        if found:
            try:
                self.learner.load_state(found.state)
            except ValueError as error:
                raise CheckpointError(
                    f"{output / CHECKPOINT} cannot be used: {error}; train again"
                ) from None
            self.history = list(found.metrics)
        self._make_loaders()

    @property
    def is_first(self) -> bool:
        """Whether this is the process that writes and speaks."""
        return processes.rank() == 0

    @property
    def done(self) -> int:
        """How many epochs are behind it."""
        return len(self.history)

    def run(self) -> Figures:
        """Train to the last epoch; the figures of the last.

        Raises:
            DatasetError: a build is writing the dataset, or another training is in this folder.
            CheckpointError: another one went on with it since this one was opened.
            DivergedError: a loss is no number any more.
        """
        with self._locked() if self.is_first else nullcontext():
            return self._learn()

    def _learn(self) -> Figures:
        board = None
        if self.is_first:
            self._greet()
            board = SummaryWriter(self.output / BOARD, purge_step=self.done)
        start = time.monotonic()
        begun = self.done
        for epoch in range(self.done, self.config.epochs):
            figures = self._epoch(epoch)
            self.history.append(figures)
            if board is None:
                continue
            # The checkpoint last: what is told of an epoch is never missing once it counts.
            for name, value in figures.items():
                if value is not None:
                    board.add_scalar(name.replace("_", "/", 1), value, epoch)
            shown = picture(self.learner, self._moved(self._shown))
            board.add_image("test", shown, epoch, dataformats="HWC")
            board.flush()
            with atomic_write(self.output / PICTURE) as file:
                Image.fromarray(shown).save(file, "PNG")
            with atomic_write(self.output / HISTORY) as file:
                file.writelines(json.dumps(of).encode() + b"\n" for of in self.history)
            self._save()
            each = (time.monotonic() - start) / (self.done - begun)
            left = each * (self.config.epochs - self.done)
            print(
                f"  epoch {self.done}/{self.config.epochs}: test {told(figures)}; "
                f"{figures['seconds']:.0f} s, {figures['waiting']:.0%} of it waiting for data, and "
                f"{figures['test_seconds']:.0f} s to test; {_duration(left)} left",
                file=sys.stderr,
                flush=True,
            )
        if board is not None:
            board.close()
        return self.history[-1]

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Keep builds out of the dataset, and other trainings out of this folder."""
        with hold_folder(self.train_views.dataset.folder) or nullcontext():
            self.output.mkdir(parents=True, exist_ok=True)
            with lock_folder(self.output):
                stands = self._found()
                if (len(stands.metrics) if stands else 0) != self.done:
                    raise CheckpointError(
                        f"{self.output}: another training went on here meanwhile; start again"
                    )
                yield

    def _greet(self) -> None:
        remove_temporary_files(self.output)
        weights = sum(p.numel() for p in self.learner.networks["generator"].parameters())
        print(
            f"{self.config.branch.name}: {len(self.train_views)} views of "
            f"{len(self.train_views.subjects)} subjects to learn from, {len(self.test_views)} of "
            f"{len(self.test_views.subjects)} to test; {weights:,} weights, "
            f"{processes.count()} x {self.device.type}, {self.config.precision}",
            file=sys.stderr,
        )
        if self.config.vgg is None:
            print("no vgg file: the VGG19 term (Eq. 9) is off", file=sys.stderr)
        if self.done:
            print(f"{self.done} of {self.config.epochs} epochs stand already", file=sys.stderr)

    def _epoch(self, epoch: int) -> Figures:
        start = time.monotonic()
        waiting, sums = 0.0, dict[str, torch.Tensor]()
        self.train_views.set_epoch(epoch)
        self._sampler.set_epoch(epoch)
        steps = len(self._train_loader)
        with tqdm(
            total=steps,
            desc=f"epoch {epoch + 1}/{self.config.epochs}",
            unit="batch",
            leave=False,
            disable=not self.is_first or not sys.stderr.isatty(),
        ) as bar:
            batches = iter(self._train_loader)
            for step in range(steps):
                asked = time.monotonic()
                batch = self._moved(next(batches))
                waiting += time.monotonic() - asked
                self.learner.set_rate(self._rate(epoch * steps + step, steps))
                for name, term in self.learner.step(batch).items():
                    sums[name] = sums.get(name, 0) + term
                bar.update()
        names = sorted(sums)
        means = processes.mean(torch.stack([sums[name] for name in names]) / steps).tolist()
        elapsed = time.monotonic() - start
        terms = {f"loss_{name}": mean for name, mean in zip(names, means, strict=True)}
        if not all(map(math.isfinite, terms.values())):
            raise DivergedError(
                f"{self.output}: in epoch {epoch + 1} a loss was not finite ({terms}); lower "
                "learning_rate, in a new folder"
            )
        known = self.history[-1] if self.history else None
        found = errors(self.learner, map(self._moved, self._test_loader), known)
        times = {
            "seconds": elapsed,
            "waiting": waiting / elapsed,
            "test_seconds": time.monotonic() - start - elapsed,
        }
        return {**terms, **found, **times}

    def _rate(self, step: int, steps_per_epoch: int) -> float:
        rate = self.config.learning_rate
        if self.config.decay == "none":
            return rate
        share = step / (steps_per_epoch * self.config.epochs)
        return rate * 0.5 * (1 + math.cos(math.pi * share))

    def _make_loaders(self) -> None:
        """The same order of views for any number of processes: each takes its part of a batch."""
        among = {"num_replicas": processes.count(), "rank": processes.rank()}
        # The sampler adds the epoch to its seed: neighbouring seeds would share their orders.
        order = int(seeds.generator(self.config.seed, "", "order").integers(2**31))
        self._sampler = DistributedSampler(self.train_views, seed=order, **among)
        common = {
            "batch_size": self.config.batch // processes.count(),
            "num_workers": self.workers,
            "persistent_workers": self.workers > 0,
            "worker_init_fn": _hush,
            "pin_memory": self.device.type == "cuda",
        }
        self._train_loader = DataLoader(self.train_views, sampler=self._sampler, **common)
        mine = range(processes.rank(), len(self.test_views), processes.count())
        self._test_loader = DataLoader(Subset(self.test_views, mine), **common)
        spread = torch.linspace(0, len(self.test_views) - 1, min(SHOWN, len(self.test_views)))
        shown = [self.test_views[int(index)] for index in spread]
        self._shown = Sample(*map(torch.stack, zip(*shown, strict=True)))

    def _moved(self, batch: Sample) -> Sample:
        return Sample(*(part.to(self.device, non_blocking=True) for part in batch))

    def _found(self) -> Checkpoint | None:
        """The checkpoint that stands, if there is one."""
        path = self.output / CHECKPOINT
        if not path.exists():
            others = set(self.output.iterdir()) if self.output.exists() else set()
            others -= {self.output / name for name in (BOARD, HISTORY, PICTURE, LOCK)}
            if not all(map(is_temporary, others)):
                raise ValueError(
                    f"{self.output} is not empty and holds no {CHECKPOINT}; choose a new folder"
                )
            return None
        found = checkpoint.load(path)
        # More epochs may follow, unless the rate's way down was laid out for a number of them.
        free = {"epochs"} if self.config.decay == "none" else set()
        there, here = (
            {key: value for key, value in config.items() if key not in free}
            for config in (found.config, self.record)
        )
        if there != here:
            raise CheckpointError(
                f"{path} is of another configuration ({differences(there, here)}); "
                "choose another folder"
            )
        if found.data != self.data:
            raise CheckpointError(f"{path} learned from another dataset; choose another folder")
        if len(found.metrics) > self.config.epochs:
            raise ValueError(
                f"epochs: {self.config.epochs}, but {path} has {len(found.metrics)} behind it; "
                "give as many or more, or choose another folder"
            )
        return found

    def _save(self) -> None:
        parts = self.record, self.learner.span, self.learner.state(), self.history, self.data
        checkpoint.save(self.output / CHECKPOINT, Checkpoint(*parts))


def _device(name: str) -> torch.device:
    """This process's device, met with the others; ValueError where there is no such device."""
    return processes.join(processes.usable(name))


def _hush(worker: int) -> None:
    """Let a loader's worker leave Ctrl-C, which a terminal sends to all, to its training, and end
    in silence when that has: nobody waits for its tensors."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if not issubclass(kind, ConnectionError | EOFError):
            sys.__excepthook__(kind, error, trace)

    sys.excepthook = tell


def _identity(*views: Views) -> dict[str, Any]:
    """What was learned from: the dataset's configuration, its subjects, a hash of their shards."""
    dataset = views[0].dataset
    subjects = [subject for split in views for subject in split.subjects]
    return {
        "config_sha256": dataset.description["config_sha256"],
        "shards_sha256": dataset.shards_sha256(subjects),
        "subjects": subjects,
    }


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
