"""Where the work runs: on this machine's processors, or on many machines'."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

from engine.scratch import scratch_folder, temporary_in
from engine.workers import WorkerLimits, cpu_count, run

Item = TypeVar("Item")


class Engine(Protocol):
    """Worker processes, for one stage after another.

    Attributes:
        workers: how many there are.
        threads: of the processor, that each may use.
    """

    workers: int
    threads: int

    def run(self, function: Callable[[Item], Any], items: list[Item]) -> Iterator[tuple[Item, Any]]:
        """As `engine.workers.run` does: (item, result or exception) as they end."""
        ...


@dataclass(frozen=True)
class Means:
    """What a build or a sweep is given to work with; nothing of it changes a byte of what is made.

    Attributes:
        engine: "local", or "dask" for the workers of a scheduler.
        scheduler: its address; None starts one with workers of its own on this machine.
        jobs: worker processes on this machine; None takes one for each processor.
        limits: of each of them.
    """

    engine: Literal["local", "dask"] = "local"
    scheduler: str | None = None
    jobs: int | None = None
    limits: WorkerLimits = field(default_factory=WorkerLimits)

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.engine != "dask":
            raise ValueError(f"scheduler: {self.scheduler} is for --engine dask; add it")
        if self.scheduler is not None and self.jobs is not None:
            raise ValueError(
                f"jobs: {self.jobs} is for this machine's workers; {self.scheduler} has its own"
            )

    @contextmanager
    def open(self, tasks: int, output: Path, shared: bool = True) -> Iterator[Engine]:
        """The engine for so many tasks, which write `output`.

        Args:
            shared: whether all machines have to see `output`.

        Raises:
            EngineError: there is no such scheduler.
        """
        workers, threads = processors(self.jobs, tasks)
        if self.engine == "dask":
            from engine.cluster import Cluster

            with Cluster(self.scheduler, workers, threads, self.limits, output, shared) as cluster:
                yield cluster
        else:
            with scratch_folder(output) as scratch:
                yield Local(workers, threads, self.limits, scratch)


def processors(jobs: int | None, tasks: int) -> tuple[int, int]:
    """How many workers take `tasks` tasks, and how many threads each of them.

    Args:
        jobs: worker processes; None takes one for each processor.
    """
    workers = max(1, min(jobs or cpu_count(), tasks))
    return workers, max(1, cpu_count() // workers)


@dataclass
class Local:
    """The processors of this machine.

    Attributes:
        workers, threads: as `Engine` has them.
        limits: of each worker.
        scratch: folder of their temporary files.
    """

    workers: int
    threads: int
    limits: WorkerLimits
    scratch: Path

    def run(self, function: Callable[[Item], Any], items: list[Item]) -> Iterator[tuple[Item, Any]]:
        """As `Engine.run`; each stage has fresh processes, so torch and Blender never meet."""
        places = temporary_in(self.scratch)
        workers = min(self.workers, len(items))
        return run(function, items, workers, self.limits, places)
