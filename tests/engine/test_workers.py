"""The pool of worker processes: real processes, really killed."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

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


def note_pid_and_sleep(folder: Path, _item: int) -> None:
    (folder / str(os.getpid())).touch()
    time.sleep(60)


def wait_until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


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


def test_a_worker_that_dies_while_a_result_is_looked_at_loses_nothing(tmp_path):
    """The pool breaks while nobody waits for it: the next submission finds out."""
    results = {}
    for item, result in run(partial(die, tmp_path, "never"), ["a", "once", "b"], 2, threads=1):
        results[item] = result
        time.sleep(1.5)
    assert results == {"a": "A", "once": "ONCE", "b": "B"}


def test_workers_do_not_outlive_a_parent_that_is_killed(tmp_path):
    code = (
        "import sys; sys.path[:0] = sys.argv[1:3]\n"
        "from pathlib import Path; from test_workers import note_pid_and_sleep\n"
        "from functools import partial; from engine.workers import run\n"
        "list(run(partial(note_pid_and_sleep, Path(sys.argv[3])), [1, 2], 2, 1))"
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
    assert [r for _, r in run(chatter, [1], jobs=1, threads=1)] == [1]
    assert "blender" not in "".join(capfd.readouterr())


def test_leaving_early_ends_the_workers():
    results = run(pid, range(100), jobs=2, threads=1)
    _, worker = next(results)
    results.close()
    wait_until(lambda: not Path(f"/proc/{worker}").exists())
