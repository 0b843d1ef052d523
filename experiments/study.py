"""A study: a folder in which data, trainings, meshes and scores are made once, for all experiments.

Every step is a command of `pipeline.py` in a process of its own, printed before it runs, so that
Blender and torch never meet and anyone can run it by hand. A step that was finished only finds that
it was; one that was interrupted goes on.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from experiments.config import ExperimentConfig
from shards.claim import claim
from shards.dataset import Dataset
from shards.manifest import DatasetError
from storage.atomic import atomic_write
from surface.mesh import ENDINGS

CHECKOUT = Path(__file__).resolve().parents[1]

RECORD = "study.json"

SIDE_BY_SIDE = 2
"""Trainings; each has one thread, on which a repetition ends in the same bits."""


@dataclass(frozen=True)
class Training:
    """A branch's training.

    Attributes:
        side: "front" or "back".
        change: the configuration that is laid over the branch's, or None.
        judged_front: whether a discriminator judges its front.
    """

    side: str
    change: str | None = None
    judged_front: bool = False


TRAININGS = {
    "front_unet": Training("front", "configs/ablations/front_unet.yaml"),
    "front_unet_ngan": Training("front", "configs/ablations/front_unet_ngan.yaml", True),
    "front_unet_ca": Training("front"),
    "back_ngan": Training("back", "configs/ablations/back_ngan.yaml"),
    "back_smpl_dgan": Training("back", "configs/ablations/back_dgan.yaml"),
    "back_smpl_ngan": Training("back"),
}


@dataclass(frozen=True)
class Method:
    """A way from a view to a surface.

    Attributes:
        front, back: a training's name, or what `reconstruct` takes in its place.
    """

    front: str
    back: str

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.front}+{self.back}"

    @property
    def trainings(self) -> list[str]:
        """That it needs."""
        return [side for side in (self.front, self.back) if side in TRAININGS]


OURS = Method("front_unet_ca", "back_smpl_ngan")
NORMALGAN = Method("front_unet_ngan", "back_ngan")
"""NormalGAN's way, trained here: a discriminator of normals in front, the back from the front."""
ORACLE = Method("true", "true")
GIVEN = Method("sensor", "body")


class StepFailedError(ValueError):
    """A command of a study that did not end well; one line."""


class Study:
    """A folder and what is in it; it belongs to one configuration, on whatever device.

    Args:
        folder: of the study; it exists and nobody else is at work there.
        config: its size.

    Raises:
        ValueError: the folder is of another configuration.
    """

    def __init__(self, folder: Path, config: ExperimentConfig) -> None:
        self.folder, self.config = folder.resolve(), config
        record = {name: value for name, value in asdict(config).items() if name != "device"}
        claim(self.folder / RECORD, json.loads(json.dumps(record)), "a study")

    @cached_property
    def data(self) -> Path:
        """The dataset, finished."""
        if self.config.data is not None:
            return Path(self.config.data).resolve()
        folder = self.folder / "data"
        if _is_finished(folder):
            return folder
        # Kept light makes a light sweep a matter of seconds.
        options = ["--shards.radiance", "true", "--output", str(folder)]
        self._run(["build", "--config", _file(self.config.build), *options], allowed=(0, 1))
        return folder

    @cached_property
    def dataset(self) -> Dataset:
        """It, to be read."""
        return Dataset(self.data)

    @cached_property
    def subjects(self) -> list[str]:
        """Its test subjects.

        Raises:
            StepFailedError: there are none, or one lacks a view that is asked for.
        """
        found = self.dataset.subjects("test")
        if not found:
            raise StepFailedError(f"{self.data} has no test subject; build more subjects")
        for key in ("views", "sweep_views"):
            most = max(getattr(self.config, key) or [0])
            for subject in found:
                count = len(self.dataset.shard(subject))
                if most >= count:
                    raise StepFailedError(
                        f"{key}: {subject} has views 0 to {count - 1}, not {most}"
                    )
        return found

    def wanted(self) -> list[tuple[str, int]]:
        """Subject and view of all that a table is of."""
        return [
            (subject, view)
            for subject in self.subjects
            for view in self.config.views or range(len(self.dataset.shard(subject)))
        ]

    def train(self, names: Iterable[str], seeds: Iterable[int] | None = None) -> None:
        """Trainings with these seeds or all, finished; two learn side by side."""
        chosen = self.config.seeds if seeds is None else seeds
        each = list(dict.fromkeys(names))
        wanted = [(name, seed) for seed in chosen for name in each]
        data = str(self.data)
        commands = {
            f"{name} seed {seed}": [
                "train",
                *self._training_options(name, seed),
                *("--data", data, "--output", str(self._training(name, seed))),
                *("--device", self.config.device, "--workers", "1"),
            ]
            for name, seed in wanted
        }
        self._run_side_by_side(commands)

    def checkpoint(self, side: str, seed: int) -> str:
        """What `reconstruct` is given for a side."""
        if side not in TRAININGS:
            return side
        return str(self._training(side, seed) / "checkpoint.pt")

    def meshes(
        self,
        method: Method,
        seed: int,
        views: list[int] | None,
        data: Path | None = None,
        step: float | None = None,
        under: str = "meshes",
        subjects: list[str] | None = None,
    ) -> Path:
        """The folder of a method's meshes.

        Args:
            views: of each subject; None takes all.
            data: the dataset, if not the study's own.
            step: as `reconstruct` has it.
            under: the folder's name in the study.
            subjects: of whom; None takes all test subjects.
        """
        folder = self.folder / under / self.label(method, seed)
        self._run(
            [
                *("reconstruct", "--data", str(data or self.data), "--output", str(folder)),
                *("--front", self.checkpoint(method.front, seed)),
                *("--back", self.checkpoint(method.back, seed)),
                *("--step", json.dumps(step), "--device", self.config.device),
                *([] if views is None else ["--views", json.dumps(views)]),
                *([] if subjects is None else ["--subjects", json.dumps(subjects)]),
            ],
            allowed=(0, 1),
        )
        return folder

    def scores(
        self, meshes: Path, name: str, under: str = "scores", data: Path | None = None
    ) -> dict[str, Any]:
        """What `evaluate` found of a folder of meshes."""
        folder = self.folder / under / meshes.name
        self._run(
            [
                *("evaluate", "--data", str(data or self.data), "--meshes", str(meshes)),
                *("--name", name, "--output", str(folder)),
                *("--samples", str(self.config.samples)),
                *("--subjects", json.dumps(self.subjects)),
            ],
            allowed=(0, 1),
        )
        found: dict[str, Any] = json.loads((folder / f"{name}.json").read_text())
        return found

    def sweep(self) -> Path:
        """The light sweep of the test subjects."""
        folder = self.folder / "sweep"
        options = ["--data", str(self.data), "--output", str(folder), "--split", "test"]
        self._run(["sweep", "--config", _file(self.config.sweep), *options])
        return folder

    def others(self) -> dict[str, Path]:
        """Meshes of other methods, name -> folder: those that lie in the study's `others`."""
        folder = self.folder / "others"
        if not folder.is_dir():
            return {}
        return {
            path.name: path
            for path in sorted(folder.iterdir())
            if path.is_dir() and any(file.suffix.lower() in ENDINGS for file in path.rglob("*"))
        }

    def write(self, name: str, data: Mapping[str, Any] | str) -> None:
        """A result, in the study's `results`: as JSON, or text as it is."""
        if not isinstance(data, str):
            data = json.dumps(data, indent=1, allow_nan=False) + "\n"
        with atomic_write(self.results / name) as file:
            file.write(data.encode())

    @property
    def results(self) -> Path:
        """The folder of tables and figures."""
        folder = self.folder / "results"
        folder.mkdir(exist_ok=True)
        return folder

    def provenance(self) -> dict[str, Any]:
        """What all results here are of, JSON-ready."""
        description = self.dataset.description
        return {
            "data_config_sha256": description["config_sha256"],
            "data_counts": description["counts"],
            "licences": description["licences"],
            "test_subjects": self.subjects,
            "config": asdict(self.config),
        }

    @staticmethod
    def label(method: Method, seed: int) -> str:
        """Of a method's folder; the seed counts only where something was trained."""
        return f"{method.name}_seed{seed}" if method.trainings else method.name

    def _training(self, name: str, seed: int) -> Path:
        return self.folder / "trainings" / f"{name}_seed{seed}"

    def _training_options(self, name: str, seed: int) -> list[str]:
        training = TRAININGS[name]
        base = {"front": self.config.front, "back": self.config.back}[training.side]
        epochs = {"front": self.config.front_epochs, "back": self.config.back_epochs}[training.side]
        options = ["--config", _file(base)]
        if training.change is not None:
            options += ["--config", _file(training.change)]
        if epochs is not None:
            options += ["--epochs", str(epochs)]
        if training.judged_front and self.config.normal_gan_width is not None:
            options += ["--branch.normal_gan.width", str(self.config.normal_gan_width)]
        return [*options, "--seed", str(seed)]

    def _run(self, arguments: list[str], allowed: tuple[int, ...] = (0,)) -> None:
        print(f"$ python pipeline.py {shlex.join(arguments)}", flush=True)
        status = subprocess.run(_command(arguments), check=False).returncode
        if status == 130:
            raise KeyboardInterrupt
        if status not in allowed:
            raise StepFailedError(f"`pipeline.py {arguments[0]}` ended with status {status}")

    def _run_side_by_side(self, commands: Mapping[str, list[str]]) -> None:
        """Commands of which some run at a time, each with a log of its own beside its output."""
        waiting = dict(commands)
        running: dict[str, tuple[subprocess.Popen[bytes], Path, float]] = {}
        threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "MKL", "OPENBLAS")}
        with ExitStack() as stack:
            try:
                while waiting or running:
                    while waiting and len(running) < SIDE_BY_SIDE:
                        label = next(iter(waiting))
                        arguments = waiting.pop(label)
                        print(f"$ python pipeline.py {shlex.join(arguments)}", flush=True)
                        folder = Path(arguments[arguments.index("--output") + 1])
                        folder.parent.mkdir(parents=True, exist_ok=True)
                        path = folder.parent / f"{folder.name}.log"
                        log = stack.enter_context(path.open("ab"))
                        process = subprocess.Popen(
                            _command(arguments),
                            env=os.environ | threads,
                            stdout=log,
                            stderr=log,
                            start_new_session=True,
                        )
                        running[label] = (process, path, time.monotonic())
                    _reap(running)
                    time.sleep(0.5)
            finally:
                for process, *_ in running.values():
                    process.terminate()
                for process, *_ in running.values():
                    process.wait()


def _reap(running: dict[str, tuple[subprocess.Popen[bytes], Path, float]]) -> None:
    """Take out what has ended.

    Raises:
        StepFailedError: it did not end well.
    """
    for label, (process, log, begun) in list(running.items()):
        status = process.poll()
        if status is None:
            continue
        del running[label]
        if status:
            raise StepFailedError(f"{label} ended with status {status}; see {log}")
        print(f"  {label} done after {(time.monotonic() - begun) / 60:.1f} min", flush=True)


def _is_finished(folder: Path) -> bool:
    """Whether a build has come to its end there; subjects that it set aside stay so."""
    try:
        counts = Dataset(folder).description["counts"]
    except DatasetError:
        return False
    return bool(counts["planned"] == counts["subjects"] + counts["failures"])


def _command(arguments: list[str]) -> list[str]:
    return [sys.executable, str(CHECKOUT / "pipeline.py"), *arguments]


def _file(name: str) -> str:
    """A configuration as it is named, or that of the checkout."""
    return name if Path(name).exists() else str(CHECKOUT / name)
