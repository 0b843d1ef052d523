"""Dask's workers: a real scheduler, real workers, really killed."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import distributed
import pytest

from engine.cluster import RESOURCE, Cluster, installed
from engine.config import BuildConfig
from engine.engines import Means
from engine.tasks import versions
from engine.workers import EngineError, WorkerDiedError, WorkerLimits
from shards.lock import LOCK
from subjects.open import OpenHumans
from subjects.scans import Scans

HERE = Path(__file__).parent


def double(item: int) -> int:
    if item == 3:
        raise ValueError("three is not wanted")
    return 2 * item


def die(folder: Path, item: str) -> str:
    """Kill the own process: "always" each time, "once" only the first."""
    mark = folder / item
    if item == "always" or (item == "once" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item.upper()


def take_the_workers_along(folder: Path, item: int) -> int:
    """The first time that item 1 runs, the Dask worker that has it is killed."""
    mark = folder / str(item)
    if item == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60)
    return 10 * item


def write_and_sleep(folder: Path, item: int) -> None:
    """Leave a temporary file behind, and tell in `folder` which."""
    with tempfile.NamedTemporaryFile(delete=False) as file:
        (folder / str(item)).write_text(file.name)
    time.sleep(120)


def sleep_long(folder: Path, item: int) -> None:
    (folder / str(os.getpid())).touch()
    time.sleep(120)


@pytest.fixture(scope="module")
def output(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("output")
    (folder / LOCK).touch()
    return folder


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    # Scheduler and workers find this file's functions as any project's: on their path.
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, [HERE.parents[1], HERE])))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, resources={RESOURCE: 1}, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address
    monkeypatch.undo()


@pytest.fixture
def cluster(scheduler, output) -> Iterator[Cluster]:
    with Cluster(scheduler, 1, 1, WorkerLimits(seconds=60), output) as cluster:
        yield cluster


def test_results_and_exceptions_come_as_from_workers_here(cluster):
    assert (cluster.workers, cluster.threads) == (2, 1)
    results = dict(cluster.run(double, list(range(9))))
    assert isinstance(results.pop(3), ValueError)
    assert results == {k: 2 * k for k in (0, 1, 2, 4, 5, 6, 7, 8)}


def test_a_task_that_kills_its_process_is_tried_once_more(cluster, tmp_path):
    results = dict(cluster.run(partial(die, tmp_path), ["a", "once", "always", "b"]))
    assert isinstance(results.pop("always"), WorkerDiedError)
    assert results == {"a": "A", "once": "ONCE", "b": "B"}


def test_a_task_whose_dask_worker_is_lost_runs_on_another(cluster, tmp_path):
    results = dict(cluster.run(partial(take_the_workers_along, tmp_path), [0, 1, 2, 3]))
    assert results == {0: 0, 1: 10, 2: 20, 3: 30}


def test_what_hangs_is_stopped(scheduler, output, tmp_path):
    with Cluster(scheduler, 1, 1, WorkerLimits(seconds=2), output) as cluster:
        ((_, result),) = cluster.run(partial(sleep_long, tmp_path), [0])
    assert isinstance(result, WorkerDiedError)
    assert "longer than 2 s" in str(result)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_whoever_goes_leaves_no_process(scheduler, output, tmp_path, end):
    code = (
        "import sys\nfrom functools import partial\nfrom pathlib import Path\n"
        "from engine.cluster import Cluster\nfrom engine.workers import WorkerLimits\n"
        "from test_cluster import sleep_long\n"
        "with Cluster(sys.argv[1], 1, 1, WorkerLimits(), Path(sys.argv[2])) as cluster:\n"
        "    list(cluster.run(partial(sleep_long, Path(sys.argv[3])), [0, 1]))"
    )
    given = [scheduler, str(output), str(tmp_path)]
    caller = subprocess.Popen(
        [sys.executable, "-c", code, *given],
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 90
    while len(list(tmp_path.iterdir())) < 2:
        assert caller.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.1)
    caller.send_signal(end)
    caller.wait(timeout=30)
    pids = [int(path.name) for path in tmp_path.iterdir()]
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_workers_that_do_not_see_the_output_are_named(scheduler, tmp_path):
    with (
        Cluster(scheduler, 1, 1, WorkerLimits(), tmp_path / "elsewhere") as cluster,
        pytest.raises(EngineError, match=r"does not see .*elsewhere; choose an output that all"),
    ):
        list(cluster.run(double, [1]))


SOURCES = [OpenHumans(count=1), Scans("nowhere", licence="CC0-1.0", up="y", front="z", unit="m")]


@pytest.mark.parametrize("source", SOURCES)
def test_all_that_a_shard_s_bytes_depend_on_is_compared(source):
    assert versions(BuildConfig(subjects=source)).keys() <= installed().keys()


def test_what_was_stopped_leaves_no_file(scheduler, output, tmp_path):
    with Cluster(scheduler, 1, 1, WorkerLimits(seconds=10), output) as cluster:
        ((_, result),) = cluster.run(partial(write_and_sleep, tmp_path), [0])
    assert isinstance(result, WorkerDiedError)
    (file,) = tmp_path.iterdir()
    assert not Path(file.read_text()).exists()


@pytest.mark.parametrize("pause", [0, 3])
def test_a_scheduler_that_goes_is_told(output, pause, monkeypatch):
    """While results are waited for, and while one is looked at."""
    monkeypatch.setattr("engine.cluster.PATIENCE", 10)
    alone = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, resources={RESOURCE: 1}, dashboard_address=None
    )

    def look() -> None:
        with Cluster(alone.scheduler_address, 1, 1, WorkerLimits(), output) as cluster:
            for item, _ in cluster.run(time.sleep, [0, 0.1, 0.2, 0.3, 1, 1, 1]):
                if item == 0.1:
                    alone.close()
                    time.sleep(pause)

    with pytest.raises(EngineError, match="run the same command again"):
        look()


def test_workers_without_the_resource_are_told(output):
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=None, processes=False
        ) as other,
        pytest.raises(EngineError, match="--resources blender=1"),
        Cluster(other.scheduler_address, 1, 1, WorkerLimits(), output),
    ):
        pass


def test_a_scheduler_that_is_none(output, monkeypatch):
    monkeypatch.setattr("engine.cluster.PATIENCE", 2)
    with (
        pytest.raises(EngineError, match=r"tcp://127.0.0.1:9 does not answer"),
        Cluster("tcp://127.0.0.1:9", 1, 1, WorkerLimits(), output),
    ):
        pass


def test_a_scheduler_without_dask():
    with pytest.raises(ValueError, match="for --engine dask"):
        Means(scheduler="tcp://127.0.0.1:8786")
