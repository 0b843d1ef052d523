"""The pool of worker processes: real processes, really killed."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from engine.workers import WorkerDiedError, WorkerLimits, run


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


def note_pid_and_sleep(folder: Path, _item: int) -> None:
    (folder / str(os.getpid())).touch()
    time.sleep(60)


def wait_until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def hang_on_one(folder: Path, item: int) -> int:
    """Item 1 starts a process of its own and waits for it for a minute."""
    if item == 1:
        child = subprocess.Popen(["sleep", "60"])
        (folder / str(child.pid)).touch()
        child.wait()
    return os.getpid()


def die_beside(folder: Path, item: int) -> tuple[int, int]:
    """Item 0 dies once, as soon as item 1 is under way; that one sees it and goes on."""
    (folder / f"{item}-{os.getpid()}").touch()
    if item == 0 and len(list(folder.glob("0-*"))) == 1:
        wait_until(lambda: bool(list(folder.glob("1-*"))))
        os.kill(os.getpid(), signal.SIGKILL)
    if item == 1:
        time.sleep(3)
    return item, len(list(folder.glob(f"{item}-*")))


def alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


HELD: list[np.ndarray] = []


def hold(megabytes: int) -> int:
    """Keep so much more memory from now on."""
    HELD.append(np.ones((megabytes, 125_000)))
    return os.getpid()


def fail_holding(megabytes: int) -> None:
    """As `hold`, and raise where the process is told."""
    hold(megabytes)
    raise ValueError(os.getpid())


def want_too_much(folder: Path, item: str) -> str:
    """More memory than there is: "always" each time, "once" the first time."""
    mark = folder / item
    if item == "always" or (item == "once" and not mark.exists()):
        mark.touch()
        bytearray(1 << 60)
    return item.upper()


def variable(name: str) -> str | None:
    return os.environ.get(name)


def chatter(_item: int) -> int:
    os.write(1, b"blender says hello\n")
    os.write(2, b"blender warns\n")
    return 1


def test_items_run_in_other_processes_side_by_side():
    pids = {result for _, result in run(pid, range(4), jobs=2)}
    assert os.getpid() not in pids
    assert len(pids) == 2


def test_an_exception_is_a_result_and_the_others_go_on():
    results = dict(run(fail_on_two, range(4), jobs=2))
    assert {k: v for k, v in results.items() if k != 2} == {0: 0, 1: 10, 3: 30}
    assert isinstance(results[2], ValueError)


def test_a_killed_worker_costs_its_item_one_retry_and_twice_sets_it_aside(tmp_path):
    items = ["a", "once", "never", "b", "c"]
    results = dict(run(partial(die, tmp_path, "never"), items, jobs=2))
    assert isinstance(results.pop("never"), WorkerDiedError)
    assert results == {"a": "A", "once": "ONCE", "b": "B", "c": "C"}


def test_a_worker_that_dies_while_a_result_is_looked_at_loses_nothing(tmp_path):
    """The pool breaks while nobody waits for it: the next submission finds out."""
    results = {}
    for item, result in run(partial(die, tmp_path, "never"), ["a", "once", "b"], jobs=2):
        results[item] = result
        time.sleep(1.5)
    assert results == {"a": "A", "once": "ONCE", "b": "B"}


def test_workers_do_not_outlive_a_parent_that_is_killed(tmp_path):
    code = (
        "import sys; sys.path[:0] = sys.argv[1:3]\n"
        "from pathlib import Path; from test_workers import note_pid_and_sleep\n"
        "from functools import partial; from engine.workers import run\n"
        "list(run(partial(note_pid_and_sleep, Path(sys.argv[3])), [1, 2], 2))"
    )
    here = Path(__file__).parent
    command = [sys.executable, "-c", code, str(here.parents[1]), str(here), str(tmp_path)]
    parent = subprocess.Popen(
        command, env={**os.environ, "PYTHONPATH": os.pathsep.join(command[3:5])}
    )
    wait_until(lambda: len(list(tmp_path.iterdir())) == 2)
    parent.kill()
    parent.wait()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    wait_until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))


def test_what_workers_print_reaches_nobody(capfd):
    assert [r for _, r in run(chatter, [1], jobs=1)] == [1]
    assert "blender" not in "".join(capfd.readouterr())


def test_leaving_early_ends_the_workers():
    results = run(pid, range(100), jobs=2)
    _, worker = next(results)
    results.close()
    wait_until(lambda: not Path(f"/proc/{worker}").exists())


def test_a_worker_that_dies_takes_no_other_along(tmp_path):
    tries = dict(result for _, result in run(partial(die_beside, tmp_path), [0, 1], jobs=2))
    assert tries == {0: 2, 1: 1}


def test_what_hangs_is_stopped_with_all_it_started_and_the_others_go_on(tmp_path):
    items = range(4)
    start = time.monotonic()
    results = dict(run(partial(hang_on_one, tmp_path), items, 2, WorkerLimits(seconds=3)))
    assert time.monotonic() - start < 40
    assert isinstance(results[1], WorkerDiedError)
    assert "longer than 3 s" in str(results[1])
    assert all(isinstance(results[k], int) for k in (0, 2, 3))
    (child,) = tmp_path.iterdir()
    wait_until(lambda: not alive(int(child.name)))


def test_a_worker_is_replaced_after_so_many_items():
    pids = [result for _, result in run(pid, range(5), 1, WorkerLimits(subjects=2))]
    assert pids[0] == pids[1] != pids[2] == pids[3] != pids[4]


def test_a_worker_that_holds_too_much_memory_is_replaced():
    pids = [r for _, r in run(hold, [1, 1, 600, 1], 1, WorkerLimits(megabytes=500))]
    assert pids[0] == pids[1] == pids[2] != pids[3]


def test_a_worker_that_holds_too_much_after_a_failure_is_replaced_too():
    limits = WorkerLimits(megabytes=500)
    results = [result for _, result in run(fail_holding, [600, 600, 1, 1], 1, limits)]
    assert all(isinstance(result, ValueError) for result in results)
    assert len({str(result) for result in results}) == 3
    assert "in fail_holding" in str(results[0].__cause__)


def test_what_has_not_the_memory_is_tried_once_more(tmp_path):
    items = ["a", "always", "once", "b"]
    results = dict(run(partial(want_too_much, tmp_path), items, 2))
    assert isinstance(results.pop("always"), WorkerDiedError)
    assert results == {"a": "A", "once": "ONCE", "b": "B"}


def test_workers_have_the_variables_that_are_given():
    (result,) = run(variable, ["RECTOVERSO_TEST"], 1, environment={"RECTOVERSO_TEST": "so"})
    assert result == ("RECTOVERSO_TEST", "so")


def test_sums_have_one_thread_whatever_the_caller_has(monkeypatch):
    """So what a worker makes is the same beside any number of others."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert dict(run(variable, ["OPENBLAS_NUM_THREADS"], 1)) == {"OPENBLAS_NUM_THREADS": "1"}


@pytest.mark.parametrize("wrong", [{"seconds": 0}, {"subjects": 0}, {"megabytes": -1}])
def test_limits_that_are_none(wrong):
    with pytest.raises(ValueError, match=f"limits.{next(iter(wrong))}: .*give"):
        WorkerLimits(**wrong)
