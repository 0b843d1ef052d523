"""Seconds and memory to make subjects of THuman2.0-like scans, one after the other.

    python -m benchmarks.scans [--scans 12] [--models FOLDER]

Each scan has 400,000 faces, a 4096 x 4096 texture and a fit with a posed body. One process on one
core makes them all; its memory after the last has to be what it was after the first few. With
SMPL-X's models at hand, `--models` times posing parameters too, by a process of its own.
"""

from __future__ import annotations

import argparse
import os
import pickle  # noqa: TID251 - written here, as the release's fits are
import re
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.meshfile import write_obj
from subjects.fits.fits import Fits
from subjects.fits.model import posed
from subjects.fits.parameters import parameters_from
from subjects.scans import Scans


def write_set(root: Path, count: int) -> Scans:
    """A folder of `count` scans, links to one, and of their fits."""
    (root / "one").mkdir()
    files = (write_obj(root / "one", normals=False).parent).iterdir()
    body = trimesh.creation.cylinder(radius=0.29, segment=[[0, 0.02, 0], [0, 1.78, 0]], sections=99)
    for _ in range(4):
        body = body.subdivide()
    values = {"betas": np.zeros((1, 10)), "body_pose": np.zeros((1, 63)), "scale": 1.0}
    names = {path: path.name for path in files}
    for k in range(count):
        scan, fit = root / "scans" / f"{k:04d}", root / "smplx" / f"{k:04d}"
        scan.mkdir(parents=True)
        fit.mkdir(parents=True)
        for path, name in names.items():
            (scan / name.replace("scan", scan.name)).symlink_to(path)
        body.export(fit / "mesh_smplx.obj")
        (fit / "smplx_param.pkl").write_bytes(pickle.dumps(values))
    return Scans(
        root=str(root / "scans"),
        up="y",
        front="body",
        unit="body",
        max_body_to_scan=0.05,  # the tube has no lids, its body has
        fits=Fits(
            root=str(root / "smplx"),
            mesh=["{folder}/mesh_smplx.obj"],
            parameters=["{folder}/smplx_param.pkl"],
        ),
    )


def memory_gb(key: str) -> float:
    """Of this process: "VmRSS" now, "VmHWM" at its peak."""
    (kilobytes,) = re.findall(rf"{key}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return int(kilobytes) * 1024 / 1e9


def in_its_own_process(work: Callable[[], None]) -> None:
    """On one core; what went before does not count in its memory."""
    pid = os.fork()
    if pid:
        os.waitpid(pid, 0)
        return
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    Path("/proc/self/clear_refs").write_text("5")
    work()
    sys.stdout.flush()
    os._exit(0)


def timed(what: str, work: Callable[[], object]) -> None:
    start = time.perf_counter()
    work()
    print(
        f"{what}  {time.perf_counter() - start:5.2f} s, now {memory_gb('VmRSS'):.2f} GB, peak "
        f"{memory_gb('VmHWM'):.2f} GB"
    )


def make_all(source: Scans, folder: Path) -> None:
    """Every scan with its posed body."""
    for subject in source.ids():
        timed(subject, lambda name=subject: source.make(name, 0, folder / name))


def pose_parameters(models: Path, count: int) -> None:
    """The first has the model read; the others are posing alone."""
    values = {"betas": np.zeros((1, 10)), "body_pose": np.zeros((1, 63))}
    parameters = parameters_from(values, Path("made"))
    for k in range(count):
        timed(f"pose {k}", lambda: posed(Path("made"), str(models), "male", parameters))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=12)
    parser.add_argument("--models", type=Path, help="folder of SMPL-X's files")
    given = parser.parse_args()
    count = given.scans
    if given.models is not None:
        in_its_own_process(lambda: pose_parameters(given.models, count))
    with tempfile.TemporaryDirectory() as folder:
        source = write_set(Path(folder), count)
        in_its_own_process(lambda: make_all(source, Path(folder) / "made"))


if __name__ == "__main__":
    main()
