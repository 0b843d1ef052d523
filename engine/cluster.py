"""Workers on many machines, through Dask: the same tasks, and the same bytes."""

from __future__ import annotations

import logging
import multiprocessing
import platform
import shutil
import socket
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import dask
import distributed
from distributed.scheduler import KilledWorker

from engine.scratch import scratch_folder, temporary_in
from engine.workers import (
    MAX_DEATHS,
    EngineError,
    Worker,
    WorkerDiedError,
    WorkerLimits,
    death,
    no_interrupt,
)
from shards.lock import LOCK

Item = TypeVar("Item")

RESOURCE = "blender"
"""What a Dask worker has one of, so that it runs one task at a time."""

PATIENCE = 60
"""Seconds that a scheduler may take to answer."""

AHEAD = 2
"""Tasks that each worker is given, one of them to have when the other ends."""

_LOOK = 0.5
"""Seconds between two looks at whether a task is still wanted."""

_IDLE = 60
"""Seconds without a task after which the process of a Dask worker ends."""

_PACKAGES = (
    *("anny", "bpy", "libigl", "numpy", "openexr", "pillow", "rectoverso", "scipy", "smplx"),
    *("torch", "trimesh"),
)


class Cluster:
    """The workers of a Dask scheduler; or of one of our own, on this machine.

    Each Dask worker gives its tasks to a process of its own, as `engine.workers` has them, so that
    Blender may crash, hang and grow there as it may here, and torch and Blender never meet.

    Attributes:
        workers, threads: as `Engine` has them; of a scheduler, as many as it has at the moment, and
            the threads that the smallest of the first ones was started with.

    Args:
        scheduler: its address, such as tcp://10.0.0.1:8786; None starts one.
        workers, threads: of the one that is started.
        limits: of each process.
        output: folder that they write, under one path on all machines.
        shared: whether they do; else tasks put what they make into a store.
    """

    def __init__(
        self,
        scheduler: str | None,
        workers: int,
        threads: int,
        limits: WorkerLimits,
        output: Path,
        shared: bool = True,
    ) -> None:
        self.scheduler = scheduler
        self.workers, self.threads = workers, threads
        self._limits = limits
        self._output, self._shared = output.resolve(), shared
        self._open = ExitStack()

    def __enter__(self) -> Self:
        """Connect.

        Raises:
            EngineError: the scheduler does not answer, or has no worker that is one of ours.
        """
        # What becomes of workers and tasks is told by this program, in its own words.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            self._connect()
        except BaseException:
            self._open.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def _connect(self) -> None:
        address: Any = self.scheduler
        if address is None:
            scratch = self._open.enter_context(scratch_folder(self._output))
            self._open.enter_context(dask.config.set({"temporary-directory": str(scratch)}))
            with no_interrupt():  # nor ever in its workers, which a terminal's Ctrl-C goes to too
                address = self._open.enter_context(
                    distributed.LocalCluster(
                        n_workers=self.workers,
                        threads_per_worker=self.threads,
                        resources={RESOURCE: 1},
                        dashboard_address=None,
                        silence_logs=logging.CRITICAL,
                    )
                )
        try:
            self._client = self._open.enter_context(
                distributed.Client(address, timeout=PATIENCE, set_as_default=False)
            )
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, ValueError) as error:
            raise EngineError(
                f"scheduler: {self.scheduler} does not answer with a worker within {PATIENCE} s "
                f"({error}); see that it runs and has workers"
            ) from error
        ours = self._ours()
        if not ours:
            raise EngineError(
                f"scheduler: no worker of {self.scheduler} offers the resource it takes; start "
                f"them with --resources {RESOURCE}=1"
            )
        self.workers = len(ours)
        self.threads = min(worker["nthreads"] for worker in ours)

    def _ours(self) -> list[dict[str, Any]]:
        known = self._client.scheduler_info(n_workers=-1).get("workers")
        if known is None:
            raise EngineError("the scheduler is gone; start it and run the same command again")
        return [one for one in known.values() if one.get("resources", {}).get(RESOURCE)]

    def run(self, function: Callable[[Item], Any], items: list[Item]) -> Iterator[tuple[Item, Any]]:
        """As `Engine.run`. A task whose Dask worker is lost runs again on another one.

        Raises:
            EngineError: a worker has other packages, or does not see the output; the scheduler is
                gone.
        """
        left = deque(items)
        given: dict[distributed.Future, Item] = {}
        blamed: list[Item] = []
        seen = self._output if self._shared else None
        serve = Serve(function, self._limits, seen, installed())

        def submit(count: int) -> list[distributed.Future]:
            new = {
                self._client.submit(serve, item, pure=False, resources={RESOURCE: 1}): item
                for item in (left.popleft() for _ in range(min(count, len(left))))
            }
            given.update(new)
            return list(new)

        try:
            done = distributed.as_completed(submit(AHEAD * self.workers), loop=self._client.loop)
            for future in done:
                item = given.pop(future)
                result = _result(future)
                # Dask blames all that a lost worker was given, what only waited there as well.
                if isinstance(result, WorkersLostError) and blamed.count(item) < MAX_DEATHS - 1:
                    blamed.append(item)
                    left.append(item)
                else:
                    yield item, result
                self.workers = max(1, len(self._ours()))
                # Fewer than were given already, where a worker was lost.
                done.update(submit(max(0, AHEAD * self.workers - len(given))))
        finally:
            self._client.cancel(list(given), force=True)


class WorkersLostError(WorkerDiedError):
    """A task that had several Dask workers, each of which was lost."""


def _result(future: distributed.Future) -> Any:
    """What a task returned; what it raised, it did as one of Dask's."""
    try:
        return future.result()
    except KilledWorker as error:
        return WorkersLostError(f"its Dask workers were lost, one after the other ({error})")
    except CancelledError as error:
        raise EngineError(
            "the scheduler forgot what it was given, as one that is started anew does; "
            "run the same command again"
        ) from error


@cache
def installed() -> dict[str, str | None]:
    """What bytes depend on, as it is here: name -> version, None where it is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


class Serve:
    """A task as a Dask worker runs it: in a process of its own, which the next task takes over.

    Args:
        function: of the item.
        limits: of the process.
        output: folder that has to be seen here, if one has.
        packages: versions that have to be installed here.
    """

    _held: tuple[Any, Worker[Any]] | None = None
    """Of this Dask worker: what the process was started for, and the process."""

    def __init__(
        self,
        function: Callable[[Any], Any],
        limits: WorkerLimits,
        output: Path | None,
        packages: dict[str, str | None],
    ) -> None:
        self.function, self.limits = function, limits
        self.output, self.packages = output, packages

    def __call__(self, item: Any) -> Any:
        """The function's result or its exception.

        Raises:
            EngineError: this machine cannot take the task.
        """
        self._check()
        worker = self._worker()
        for _ in range(MAX_DEATHS):
            future = worker.submit(item)
            while not future.done() and worker.seconds_left > 0:
                wait([future], timeout=min(_LOOK, worker.seconds_left))
                if not _wanted():
                    worker.end()
                    self._clear()
                    return None
            try:
                result = worker.result()
            except BrokenProcessPool:
                self._clear()
                continue
            if isinstance(result, WorkerDiedError):  # it took too long
                self._clear()
            return result
        return death(f"on {socket.gethostname()} ")

    def _check(self) -> None:
        host = socket.gethostname()
        if self.output is not None and not (self.output / LOCK).exists():
            raise EngineError(
                f"{host} does not see {self.output}; choose an output that all machines share, "
                "or a store"
            )
        here = installed()
        other = sorted(name for name in here if here[name] != self.packages[name])
        if other:
            raise EngineError(
                f"{host} has other packages: "
                + ", ".join(f"{name} {here[name]}, not {self.packages[name]}" for name in other)
                + "; install the same ones on all machines (constraints.txt)"
            )

    def _worker(self) -> Worker[Any]:
        """The process that stands, or a fresh one for another stage."""
        key = (self.function, self.limits)
        if Serve._held is None or Serve._held[0] != key:
            if Serve._held is not None:
                Serve._held[1].end()
            # A Dask worker is a daemon, which may have no children: they could outlive it. Ours
            # watch their parent and do not.
            multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
            place = self._place()
            place.mkdir(exist_ok=True)
            places = temporary_in(place)
            Serve._held = key, Worker(self.function, self.limits, places, _IDLE)
        return Serve._held[1]

    def _clear(self) -> None:
        """Remove what a process that was killed left behind."""
        shutil.rmtree(self._place(), ignore_errors=True)
        self._place().mkdir(exist_ok=True)

    @staticmethod
    def _place() -> Path:
        """Where the process has its temporary files."""
        return Path(distributed.get_worker().local_directory) / "rectoverso"


def _wanted() -> bool:
    """Whether whoever gave this task still waits for it."""
    worker = distributed.get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    return task is not None and task.state == "executing"
