"""A build that is killed over and over: real processes, real signals, real full disks."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml

from shards.lock import LOCK
from tests.lumpy import write_lumpy
from tests.store import s3_server

ROOT = Path(__file__).parents[1]
SUBJECTS = 6
KILLS = 25
DASK_KILLS = 3


def write_scans(folder: Path, count: int) -> Path:
    """Lumpy textured scans in folder/scans, and the configuration of two quick views of each."""
    (folder / "scans").mkdir(parents=True)
    for seed in range(count):
        write_lumpy(folder / "scans" / f"s{seed}.glb", seed, [0.25, 0.85, 0.2])
    placed = {"up": "y", "front": "z", "unit": "m", "licence": "CC0-1.0"}
    source = {"root": str(folder / "scans"), **placed}
    config = {
        "subjects": {"class_path": "Scans", "init_args": source},
        "views": {"count": 2},
        "cycles": {"samples": 2},
        "seed": 5,
    }
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


def start(config: Path, output: Path, *options: object) -> subprocess.Popen[str]:
    """A build in a session of its own; its temporary files lie beside the output."""
    command = [sys.executable, str(ROOT / "pipeline.py"), "build", "--config", str(config)]
    temporary = output.parent / "tmp"
    temporary.mkdir(parents=True, exist_ok=True)
    process = subprocess.Popen(
        [*command, "--output", str(output), *map(str, options)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )
    STARTED.append(process.pid)
    return process


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit status and what was said."""
    said, _ = process.communicate(timeout=300)
    return process.returncode, said


def members(session: int) -> list[psutil.Process]:
    """The living processes of a session."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (ProcessLookupError, psutil.Error):
            continue
    return found


def wait_until_gone(session: int) -> None:
    deadline = time.monotonic() + 60
    while members(session):
        assert time.monotonic() < deadline, [p.cmdline() for p in members(session)]
        time.sleep(0.05)


def contents(output: Path) -> dict[str, bytes]:
    """All files by name; but for what tells time: the manifest's seconds and a subject's cost."""
    found = {}
    for path in sorted(output.rglob("*")):
        if path.is_file() and path.name != "cost.json":
            found[path.relative_to(output).as_posix()] = path.read_bytes()
    lines = [json.loads(line) for line in found["manifest.jsonl"].splitlines()]
    found["manifest.jsonl"] = json.dumps([{**line, "seconds": 0} for line in lines]).encode()
    return found


STARTED: list[int] = []
"""The builds' own processes."""


def semaphores() -> list[Path]:
    """Of these builds' worker pools, named in the system."""
    return [path for pid in STARTED for path in Path("/dev/shm").glob(f"sem.loky-{pid}-*")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("survival")


@pytest.fixture(scope="module")
def config(folder) -> Path:
    return write_scans(folder, SUBJECTS)


@pytest.fixture(scope="module")
def undisturbed(folder, config) -> dict[str, bytes]:
    output = folder / "undisturbed" / "data"
    status, said = finish(start(config, output, "--jobs", 2))
    assert status == 0, said
    return contents(output)


@pytest.fixture
def output(tmp_path) -> Iterator[Path]:
    """Where a build is disturbed; nothing is left beside it at the end."""
    output = tmp_path / "disturbed" / "data"
    yield output
    assert list((output.parent / "tmp").iterdir()) == []
    assert semaphores() == []


def workers(session: int) -> list[psutil.Process]:
    """A build's worker processes."""
    return [p for p in members(session) if "popen_loky" in " ".join(p.cmdline())]


def kill(process: subprocess.Popen[str], victim: str, rng: np.random.Generator) -> bool:
    """SIGKILL to a build's parent, to one of its workers, or to all at once; whether there was one.

    Those that only begin to start count as well.
    """
    if victim == "all":
        os.killpg(process.pid, signal.SIGKILL)
    elif victim == "parent":
        process.kill()
    else:
        found = workers(process.pid)
        if not found:
            return False
        found[rng.integers(len(found))].kill()
    return True


def test_killed_25_times_it_ends_in_the_same_bytes(config, undisturbed, output):
    rng = np.random.default_rng(0)
    kills = 0
    while kills < KILLS:
        process = start(config, output, "--jobs", 2)
        victim = ""
        while victim not in ("parent", "all") and process.poll() is None and kills < KILLS:
            time.sleep(rng.uniform(0.2, 6))
            if process.poll() is not None:
                break
            victim = ("parent", "worker", "all")[kills % 3]
            kills += kill(process, victim, rng)
        # One whose workers alone were killed goes on, and sets aside what died twice.
        status, said = finish(process)
        wait_until_gone(process.pid)
        assert status in (0, 1, -signal.SIGKILL), said
        if status == 0 and kills < KILLS:  # it was too fast for the next kill: from the beginning
            assert contents(output) == undisturbed
            shutil.rmtree(output)
    status, said = finish(start(config, output, "--jobs", 2))
    assert status == 0, said
    assert contents(output) == undisturbed
    proof = [sys.executable, str(ROOT / "pipeline.py"), "verify", str(output)]
    assert subprocess.run(proof, check=False).returncode == 0


def test_on_dask_whose_workers_are_killed_it_ends_in_the_same_bytes(config, undisturbed, output):
    pytest.importorskip("distributed")
    process = start(config, output, "--engine", "dask", "--jobs", 2)
    killed = 0
    deadline = time.monotonic() + 240
    while killed < DASK_KILLS and process.poll() is None:
        assert time.monotonic() < deadline
        # A Dask worker is the parent of the process in which Blender runs.
        served = workers(process.pid)
        shards = len(list(output.glob("shards/*.npz")))
        if served and shards >= killed:
            try:
                served[0].parent().kill()
            except (psutil.Error, AttributeError):
                continue
            killed += 1
        time.sleep(0.2)
    status, said = finish(process)
    assert killed == DASK_KILLS, said
    assert status == 0, said
    wait_until_gone(process.pid)
    assert contents(output) == undisturbed


def test_ctrl_c_in_a_terminal_ends_dask_in_one_line(config, output):
    """There it goes to all processes at once, the scheduler's and the workers' too."""
    pytest.importorskip("distributed")
    process = start(config, output, "--engine", "dask", "--jobs", 2)
    deadline = time.monotonic() + 120
    while not workers(process.pid):
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.05)
    time.sleep(1)
    os.killpg(process.pid, signal.SIGINT)
    begun = time.monotonic()
    status, said = finish(process)
    assert status == 130, said
    assert "Traceback" not in said
    assert time.monotonic() - begun < 20
    wait_until_gone(process.pid)


def test_a_subject_that_takes_too_long_is_set_aside(config, output):
    status, said = finish(start(config, output, "--limits.seconds", 0.02))
    assert status == 1
    failures = (output / "failures.jsonl").read_text().splitlines()
    assert len(failures) == SUBJECTS
    assert all("longer than 0.02 s" in line for line in failures), said


def test_workers_that_are_replaced_make_the_same_bytes(config, undisturbed, output):
    options = ("--limits.subjects", 1, "--limits.megabytes", 1, "--jobs", 1)
    status, said = finish(start(config, output, *options))
    assert status == 0, said
    assert contents(output) == undisturbed


def test_of_two_builds_on_one_folder_the_second_says_so_and_stops(config, output):
    first = start(config, output)
    deadline = time.monotonic() + 60
    while not (output / "dataset.json").exists():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    status, said = finish(start(config, output))
    assert status == 2
    assert "is in use by another build" in said
    assert finish(first)[0] == 0


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A file system of its own with room for the subjects and a shard or two."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=45m", "none", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("this system lets nobody mount a small disk")
    try:
        yield disk
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


def remount(disk: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", str(disk)], check=True)


def test_a_full_disk_stops_it_and_room_lets_it_go_on(config, undisturbed, small_disk, tmp_path):
    output = tmp_path / "disk" / "data"
    status, said = finish(start(config, output, "--jobs", 2))
    assert status == 1, said
    assert "No space left" in said
    assert "make room, and run the same command again" in said
    assert "Traceback" not in said
    assert 0 < len(list(output.glob("shards/*.npz"))) < SUBJECTS
    remount(small_disk, "size=400m")
    status, said = finish(start(config, output, "--jobs", 2))
    assert status == 0, said
    assert contents(output) == undisturbed


def test_a_full_disk_of_temporary_files_stops_it_too(config, small_disk, tmp_path):
    remount(small_disk, "size=300k")
    output = tmp_path / "beside" / "data"
    output.parent.mkdir()
    (output.parent / "tmp").symlink_to(small_disk)
    status, said = finish(start(config, output, "--jobs", 2))
    assert status == 1, said
    assert "No space left" in said
    assert "Traceback" not in said
    assert not (output / "failures.jsonl").read_text()


def test_a_disk_that_cannot_be_written_is_one_line(config, small_disk):
    output = small_disk / "data"
    output.mkdir()
    (small_disk / "tmp").mkdir()
    remount(small_disk, "ro")
    status, said = finish(start(config, output))
    assert status in (1, 2)
    assert len(said.splitlines()) == 1
    assert "Read-only file system" in said


@pytest.fixture
def bucket(tmp_path, monkeypatch):
    """URL of an empty folder of an S3 server on this machine, which every process may reach."""
    with s3_server() as variables:
        for name, value in (variables | {"XDG_CACHE_HOME": str(tmp_path / "cache")}).items():
            monkeypatch.setenv(name, value)
        yield "s3://bucket"


def test_a_store_is_as_good_as_a_folder(bucket, tmp_path):
    """Scans and dataset in S3, a killed build, a new machine: the bytes of a build in a folder."""
    from shards.verify import verify, verify_sweep
    from storage.store import Store

    config = write_scans(tmp_path, 3)
    folder = tmp_path / "folder"
    assert finish(start(config, folder))[0] == 0
    expected = contents(folder)
    scans = Store(f"{bucket}/scans")
    for scan in (tmp_path / "scans").iterdir():
        scans.put(scan, scan.name)
    shutil.rmtree(tmp_path / "scans")

    def build(*options: str) -> subprocess.Popen[str]:
        command = [sys.executable, str(ROOT / "pipeline.py"), "build", "--config", str(config)]
        command += ["--output", f"{bucket}/data", "--subjects.root", f"{bucket}/scans"]
        process = subprocess.Popen(
            [*command, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        STARTED.append(process.pid)
        return process

    store = Store(f"{bucket}/data")
    killed = build("--jobs", "1")
    while killed.poll() is None and "shards/s0.npz" not in store.files():
        time.sleep(0.1)
    os.killpg(killed.pid, signal.SIGKILL)
    finish(killed)
    wait_until_gone(killed.pid)
    shutil.rmtree(tmp_path / "cache")  # what follows may be another machine
    status, said = finish(build("--engine", "dask", "--jobs", "2"))
    assert status == 0, said

    there = store.files()
    own = {LOCK} | {name for name in there if name.endswith("cost.json")}
    assert there.keys() - own == expected.keys() - own
    # Other files name the scans' folder or the time.
    for name in (name for name in expected if name.endswith((".npz", ".glb"))):
        assert store.read(name) == expected[name], name
    report = verify(f"{bucket}/data")
    assert report.ok, report.breaches
    status, said = finish(build())
    assert status == 0, said
    assert "3 of 3 shards stand already" in said
    sweep = [sys.executable, str(ROOT / "pipeline.py"), "sweep", "--data", f"{bucket}/data"]
    sweep += ["--powers", "[100]", "--output", str(tmp_path / "sweep")]
    subprocess.run(sweep, check=True, capture_output=True)
    assert all(report.ok for report in verify_sweep(tmp_path / "sweep").values())
