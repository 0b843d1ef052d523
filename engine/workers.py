"""Worker processes: Blender and torch live in them, each in its own, and die there."""

from __future__ import annotations

import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

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
    waiting = deque(items)
    suspects: deque[Item] = deque()
    deaths: Counter[Item] = Counter()
    while waiting or suspects:
        alone = bool(suspects)
        pool = _pool(1 if alone else jobs, threads)
        try:
            under_way: dict[Future, Item] = {}
            broken = False
            while not broken:
                source = suspects if alone else waiting
                while source and len(under_way) < (1 if alone else jobs):
                    item = source.popleft()
                    under_way[pool.submit(function, item)] = item
                if not under_way:
                    break
                done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in done:
                    item = under_way.pop(future)
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        broken = True
                        deaths[item] += 1
                        if deaths[item] < MAX_DEATHS:
                            suspects.append(item)
                        else:
                            yield (
                                item,
                                WorkerDiedError(
                                    f"its worker process died {MAX_DEATHS} times "
                                    "(out of memory, killed, or a crash in native code)"
                                ),
                            )
                    else:
                        yield item, error if error is not None else future.result()
            # What the dead pool held is as suspect as what it reported.
            for item in under_way.values():
                deaths[item] += 1
                suspects.append(item)
        finally:
            pool.shutdown(wait=True, kill_workers=True)


def _pool(jobs: int, threads: int) -> ProcessPoolExecutor:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
    return ProcessPoolExecutor(
        max_workers=jobs,
        timeout=None,
        initializer=_start,
        env={name: str(threads) for name in names},
    )


def _start() -> None:
    """Keep a worker quiet: its output goes nowhere, and Ctrl-C is its parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for descriptor in (1, 2):  # Blender writes to descriptor 1 from C
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
