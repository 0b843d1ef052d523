"""Worker processes: Blender and torch live in them, each in its own, and die there."""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Generic, TypeVar

import psutil
from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.backend import resource_tracker as loky_resource_tracker

Item = TypeVar("Item")

# A task that kills its worker this many times is given up.
MAX_DEATHS = 2


class EngineError(ValueError):
    """Workers that cannot be had; one line: what, where, the cure."""


class WorkerDiedError(RuntimeError):
    """A task whose worker process died each time it was tried, or had to be stopped."""


def death(where: str = "") -> WorkerDiedError:
    """Of a task that killed its worker each time it was tried; `where` is in the middle of it."""
    return WorkerDiedError(
        f"its worker process died {MAX_DEATHS} times {where}"
        "(out of memory, killed, or a crash in native code)"
    )


@dataclass(frozen=True)
class WorkerLimits:
    """What a worker process may take before it is stopped, or replaced by a fresh one."""

    seconds: float | None = 3600
    """Longest that a stage may take over one subject; its worker is stopped then, and the subject
    set aside. null: for ever."""
    subjects: int | None = 100
    """A worker is replaced after so many subjects; null: never."""
    megabytes: int | None = 3000
    """A worker that holds more memory than this after a subject is replaced; null: never."""

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < threading.TIMEOUT_MAX:
            raise ValueError(f"limits.seconds: {self.seconds}; give seconds, such as 3600, or null")
        for name in ("subjects", "megabytes"):
            given = getattr(self, name)
            if given is not None and given < 1:
                raise ValueError(f"limits.{name}: {given}; give 1 or more, or null")


NO_LIMITS = WorkerLimits(None, None, None)


_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
"""For numerical libraries: the last bit of their sums depends on how many threads share them, and
so would the shards on the number of workers. Blender has threads of its own."""


def cpu_count() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run(
    function: Callable[[Item], Any],
    items: Iterable[Item],
    jobs: int,
    limits: WorkerLimits = NO_LIMITS,
    environment: Mapping[str, str] | None = None,
) -> Iterator[tuple[Item, Any]]:
    """Call `function` on every item in `jobs` fresh processes; yield (item, result) as they end.

    An exception is a result too: it is yielded, not raised. An item whose worker dies, or for which
    it has not the memory, is tried once
    more, after all others and alone, for it may have been the memory of both that was too much; one
    that kills its worker twice, or takes too long, yields WorkerDiedError. No worker's end touches
    what the others are at. Leaving the iterator early kills the workers.

    Args:
        limits: of each process.
        environment: variables that the processes have besides.
    """
    waiting = deque(_Attempt(item) for item in items)
    again: deque[_Attempt[Item]] = deque()
    places: list[Worker[Item]] = [Worker(function, limits, environment) for _ in range(jobs)]
    under_way: dict[Future[Any], tuple[Worker[Item], _Attempt[Item]]] = {}
    try:
        while waiting or again or under_way:
            for place in places:
                if waiting and not place.busy:
                    attempt = waiting.popleft()
                elif again and not under_way:
                    attempt = again.popleft()
                else:
                    continue
                under_way[place.submit(attempt.item)] = place, attempt
            left = [place.seconds_left for place, _ in under_way.values()]
            wait(under_way, timeout=max(0, min(left)), return_when=FIRST_COMPLETED)
            for future, (place, attempt) in list(under_way.items()):
                if not (future.done() or place.seconds_left <= 0):
                    continue
                del under_way[future]
                try:
                    yield attempt.item, place.result()
                except BrokenProcessPool:
                    attempt.deaths += 1
                    if attempt.deaths < MAX_DEATHS:
                        again.append(attempt)
                        continue
                    yield attempt.item, death()
    finally:
        for place in places:
            place.end()


@dataclass
class _Attempt(Generic[Item]):
    item: Item
    deaths: int = 0


@dataclass
class Worker(Generic[Item]):
    """One process that calls a function on one item at a time, and a fresh one in its place where
    it died, was stopped, or has served its time.

    Args:
        function: of the item, pickled.
        limits: of the process.
        environment: variables that it has besides.
        idle: seconds without an item after which it ends by itself; None: never.
    """

    function: Callable[[Item], Any]
    limits: WorkerLimits = NO_LIMITS
    environment: Mapping[str, str] | None = None
    idle: int | None = None
    _pool: ProcessPoolExecutor | None = field(default=None, init=False)
    _future: Future[Any] | None = field(default=None, init=False)
    _begun: float = field(default=0.0, init=False)
    _served: int = field(default=0, init=False)

    @property
    def busy(self) -> bool:
        """Whether an item is under way, or its result has not been taken."""
        return self._future is not None

    @property
    def seconds_left(self) -> float:
        """Until the item that is under way has taken too long."""
        if self.limits.seconds is None:
            return float(threading.TIMEOUT_MAX)
        return self._begun + self.limits.seconds - time.monotonic()

    def submit(self, item: Item) -> Future[Any]:
        """Begin with an item; the future says when, and no more: `result` is to be asked."""
        assert self._future is None
        with no_interrupt():
            try:
                self._future = self._started().submit(_serve, self.function, item)
            except BrokenProcessPool:  # it died while it had nothing to do
                self.end()
                self._future = self._started().submit(_serve, self.function, item)
        self._begun = time.monotonic()
        return self._future

    def result(self) -> Any:
        """What became of the item that is under way; its time is over, or it is done.

        Returns:
            What the function returned or raised, or WorkerDiedError where it took too long.

        Raises:
            BrokenProcessPool: the process died, or had not the memory.
        """
        assert self._future is not None
        future, self._future = self._future, None
        if not future.done():
            self.end()
            return WorkerDiedError(
                f"it took longer than {self.limits.seconds:g} s and was stopped; "
                "see limits.seconds if it is to have more time"
            )
        error = future.exception()
        if isinstance(error, BrokenProcessPool):
            self.end()
            raise error
        self._served += 1
        served = _Served(error, "", 0.0) if error is not None else future.result()
        if isinstance(served.result, MemoryError):
            self.end()
            raise BrokenProcessPool from served.result
        if served.trace:
            served.result.__cause__ = _RemoteError(f"\n{served.trace}")
        if (self.limits.subjects is not None and self._served >= self.limits.subjects) or (
            self.limits.megabytes is not None and served.megabytes > self.limits.megabytes
        ):
            self.end()
        return served.result

    def end(self) -> None:
        """Kill the process and all that it started."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, kill_workers=True)
        self._pool, self._future, self._served = None, None, 0

    def _started(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                max_workers=1,
                timeout=self.idle,
                initializer=_start,
                initargs=(os.getpid(),),
                env={**_ONE_THREAD, **(self.environment or {})},
            )
        return self._pool


class _RemoteError(Exception):
    """Where in a worker an exception came from, as text: tracebacks stay in their process."""


@dataclass(frozen=True)
class _Served:
    """What a worker tells of an item: what came of it, whence if it was raised, and the megabytes
    that the process holds now."""

    result: Any
    trace: str
    megabytes: float


def _serve(function: Callable[[Item], Any], item: Item) -> _Served:
    """In the worker."""
    trace = ""
    try:
        result = function(item)
    except Exception as error:
        result, trace = error, traceback.format_exc()
    return _Served(result, trace, psutil.Process().memory_info().rss / 1e6)


def remove_semaphores(process: int) -> None:
    """Remove what the pools of a process that was killed left named in the system (Linux)."""
    if psutil.pid_exists(process):
        return
    for path in Path("/dev/shm").glob(f"sem.loky-{process}-*"):
        path.unlink(missing_ok=True)


@contextmanager
def no_interrupt() -> Iterator[None]:
    """Ctrl-C waits, and processes that are started never hear it: they are the parent's to end."""
    # Whoever starts one of these lets signals through again.
    for tracker in (resource_tracker, loky_resource_tracker):
        tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start(parent: int) -> None:
    """Keep a worker quiet and its parent's: no output, no Ctrl-C of its own, no life alone.

    Args:
        parent: its process, told by itself: it may be gone before anybody asks here.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for descriptor in (1, 2):  # Blender writes to descriptor 1 from C
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
    threading.Thread(target=_die_with, args=(parent,), daemon=True).start()


def _die_with(parent: int) -> None:
    """End this process when its parent is gone, however that went."""
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(1)
