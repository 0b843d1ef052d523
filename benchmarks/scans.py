"""Seconds and memory to make subjects of THuman2.0-like scans, one after the other.

    python -m benchmarks.scans [--scans 12]

Each scan has 400,000 faces, a 4096 x 4096 texture and a fit with a posed body. One process on one
core makes them all; its memory after the last has to be what it was after the first few.
"""

from __future__ import annotations

import argparse
import os
import pickle  # noqa: TID251 - written here, as the release's fits are
import re
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.meshfile import write_obj
from subjects.fits.fits import Fits
from subjects.scans import Scans

SCALE, SHIFT = 1.0, np.zeros(3)


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=12)
    count = parser.parse_args().scans
    with tempfile.TemporaryDirectory() as folder:
        source = write_set(Path(folder), count)
        pid = os.fork()  # what writing took is not the reading's
        if pid:
            os.waitpid(pid, 0)
            return
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        Path("/proc/self/clear_refs").write_text("5")
        for subject in source.ids():
            start = time.perf_counter()
            made = source.make(subject, 0, Path(folder) / "made" / subject)
            seconds = time.perf_counter() - start
            print(
                f"{subject}  {seconds:5.2f} s, now {memory_gb('VmRSS'):.2f} GB, peak "
                f"{memory_gb('VmHWM'):.2f} GB; {made.body_parameters['scan_to_body_mm']} mm"
            )
        os._exit(0)


if __name__ == "__main__":
    main()
