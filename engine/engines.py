"""Where the work runs: on this machine's processors, or on many machines'."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, Self, TypeVar

from engine.scratch import scratch_folder, temporary_in
from engine.workers import Limits, cpu_count, run

Item = TypeVar("Item")


class Engine(Protocol):
    """Worker processes, for one stage after another.

    Attributes:
        workers: how many there are.
        threads: of the processor, that each may use.
    """

    workers: int
    threads: int

    def run(
        self, function: Callable[[Item], Any], items: list[Item], threads: int
    ) -> Iterator[tuple[Item, Any]]:
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
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.engine != "dask":
            raise ValueError(f"scheduler: {self.scheduler} is for --engine dask; add it")

    def open(self, tasks: int, output: Path) -> AbstractContextManager[Engine]:
        """The engine for so many tasks, which write `output`.

        Raises:
            EngineError: there is no such scheduler.
        """
        if self.engine == "dask":
            from engine.cluster import Cluster

            return Cluster(self.scheduler, *processors(self.jobs, tasks), self.limits, output)
        return Local(*processors(self.jobs, tasks), self.limits, output)


def processors(jobs: int | None, tasks: int) -> tuple[int, int]:
    """How many workers take `tasks` tasks, and how many threads each of them.

    Args:
        jobs: worker processes; None takes one for each processor.
    """
    workers = max(1, min(jobs or cpu_count(), tasks))
    return workers, max(1, cpu_count() // workers)


class Local:
    """The processors of this machine.

    Args:
        workers, threads: as `Engine` has them.
        limits: of each worker.
        output: what they write; it has one writer at a time.
    """

    def __init__(self, workers: int, threads: int, limits: Limits, output: Path) -> None:
        self.workers, self.threads = workers, threads
        self._limits = limits
        self._scratch = scratch_folder(output)

    def __enter__(self) -> Self:
        self._folder = self._scratch.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._scratch.__exit__(kind, error, trace)

    def run(
        self, function: Callable[[Item], Any], items: list[Item], threads: int
    ) -> Iterator[tuple[Item, Any]]:
        """As `Engine.run`; each stage has fresh processes, so torch and Blender never meet."""
        places = temporary_in(self._folder)
        workers = min(self.workers, len(items))
        return run(function, items, workers, threads, self._limits, places)
