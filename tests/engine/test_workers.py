"""The pool of worker processes: real processes, really killed."""

import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from engine.workers import WorkerDiedError, run


def pid(_item: int) -> int:
    time.sleep(0.2)
    return os.getpid()


def fail_on_two(item: int) -> int:
    if item == 2:
        raise ValueError("two is not wanted")
    return item * 10


def die(folder: Path, always: str, item: str) -> str:
    """Kill the own process: `always` each time, "once" only when it runs first."""
    mark = folder / item
    if item == always or (item == "once" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item.upper()


def chatter(_item: int) -> int:
    os.write(1, b"blender says hello\n")
    os.write(2, b"blender warns\n")
    return 1


def test_items_run_in_other_processes_side_by_side():
    pids = {result for _, result in run(pid, range(4), jobs=2, threads=1)}
    assert os.getpid() not in pids
    assert len(pids) == 2


def test_an_exception_is_a_result_and_the_others_go_on():
    results = dict(run(fail_on_two, range(4), jobs=2, threads=1))
    assert {k: v for k, v in results.items() if k != 2} == {0: 0, 1: 10, 3: 30}
    assert isinstance(results[2], ValueError)


def test_a_killed_worker_costs_its_item_one_retry_and_twice_sets_it_aside(tmp_path):
    items = ["a", "once", "never", "b", "c"]
    results = dict(run(partial(die, tmp_path, "never"), items, jobs=2, threads=1))
    assert isinstance(results.pop("never"), WorkerDiedError)
    assert results == {"a": "A", "once": "ONCE", "b": "B", "c": "C"}


def test_what_workers_print_reaches_nobody(capfd):
    assert [r for _, r in run(chatter, [1], jobs=1, threads=1)] == [1]
    assert "blender" not in "".join(capfd.readouterr())


def test_leaving_early_ends_the_workers():
    results = run(pid, range(100), jobs=2, threads=1)
    _, worker = next(results)
    results.close()
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("the worker still runs")
