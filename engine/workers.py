"""Worker processes: Blender and torch live in them, each in its own, and die there."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from joblib.externals.loky import ProcessPoolExecutor

Item = TypeVar("Item")

# A task that kills its worker this many times is given up.
MAX_DEATHS = 2


class WorkerDiedError(RuntimeError):
    """A task whose worker process died each time it was tried."""


def cpu_count() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run(
    function: Callable[[Item], Any], items: Iterable[Item], jobs: int, threads: int
) -> Iterator[tuple[Item, Any]]:
    """Call `function` on every item in `jobs` fresh processes; yield (item, result) as they end.

    An exception is a result too: it is yielded, not raised. No more than `jobs` items are under
    way at a time, so a worker that dies implicates few; those are tried once more, one by one,
    and an item that kills its worker twice yields WorkerDiedError. Leaving the iterator early kills
    the workers.

    Args:
        threads: threads that numerical libraries may use in each process.
    """
    waiting = deque(_Attempt(item) for item in items)
    suspects: deque[_Attempt] = deque()
    while waiting or suspects:
        alone = bool(suspects)
        source, places = (suspects, 1) if alone else (waiting, jobs)
        pool = _pool(places, threads)
        under_way: dict[Future, _Attempt] = {}
        try:
            broken = False
            while not broken:
                while source and len(under_way) < places:
                    try:
                        with _no_interrupt():
                            under_way[pool.submit(function, source[0].item)] = source[0]
                    except BrokenProcessPool:  # a worker died since the last look
                        broken = True
                        break
                    source.popleft()
                if not under_way:
                    break
                done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in done:
                    attempt = under_way.pop(future)
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        broken = True
                        attempt.deaths += 1
                        if attempt.deaths < MAX_DEATHS:
                            suspects.append(attempt)
                        else:
                            yield (
                                attempt.item,
                                WorkerDiedError(
                                    f"its worker process died {MAX_DEATHS} times "
                                    "(out of memory, killed, or a crash in native code)"
                                ),
                            )
                    else:
                        yield attempt.item, error if error is not None else future.result()
            # What a dead pool held is as suspect as what it reported.
            for attempt in under_way.values():
                attempt.deaths += 1
                suspects.append(attempt)
        finally:
            pool.shutdown(wait=True, kill_workers=True)


@dataclass
class _Attempt(Generic[Item]):
    item: Item
    deaths: int = 0


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Ctrl-C waits, and processes that are started never hear it: they are the parent's to end."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _pool(jobs: int, threads: int) -> ProcessPoolExecutor:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
    return ProcessPoolExecutor(
        max_workers=jobs,
        timeout=None,
        initializer=_start,
        env={name: str(threads) for name in names},
    )


def _start() -> None:
    """Keep a worker quiet and its parent's: no output, no Ctrl-C of its own, no life alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for descriptor in (1, 2):  # Blender writes to descriptor 1 from C
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
    threading.Thread(target=_die_with, args=(os.getppid(),), daemon=True).start()


def _die_with(parent: int) -> None:
    """End this process when its parent is gone, however that went."""
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(1)
