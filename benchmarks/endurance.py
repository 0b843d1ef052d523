"""Memory and seconds of one worker over many subjects: does either grow?

    python -m benchmarks.endurance [--subjects 60] [--views 2] [--faces 300000]

Draft humans are cut into so many faces and stand in the folder of scans again and again, under
other names. One worker takes all of them from the scan to the shard, as a build's do, but is never
replaced. Resident memory is measured after each subject. A fresh worker then takes ten of them
again: beside these, whose machine is that of the last ten, the last ten show what a worker's age
costs; beside the first ten they show how the machine's speed drifted as well.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import psutil
from tqdm import tqdm

from benchmarks.humans import write_humans
from engine.config import BuildConfig
from engine.tasks import Task, make_both
from engine.workers import cpu_count, run
from render.cycles import CyclesConfig
from render.views import ViewsConfig
from subjects.scans import Scans

MODELS = 2
"""Meshes that differ; each stands for every second subject."""

LARGEST_GROWTH = 1.10
"""Memory after the last subject over that after the tenth."""

MOST_MEGABYTES = 1500

SLOWEST = 1.1
"""A subject of the last ten over one of a fresh worker's; machines' noise is of this size."""

TEN = 10


def measured(task: Task) -> tuple[float, float, float]:
    """In the worker: seconds, and megabytes that it holds afterwards and held at most."""
    start = time.perf_counter()
    make_both(task)
    seconds = time.perf_counter() - start
    held = psutil.Process().memory_info().rss / 1e6
    return seconds, held, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> int:
    """Print the figures; 1 if a bound is broken, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--subjects", type=int, default=60)
    parser.add_argument("--views", type=int, default=2)
    parser.add_argument("--faces", type=int, default=300_000)
    options = parser.parse_args()
    if options.subjects < 2 * TEN:
        parser.error(f"--subjects {options.subjects}: give {2 * TEN} or more")
    with tempfile.TemporaryDirectory() as name:
        scans, data = Path(name) / "scans", Path(name) / "data"
        (data / "shards").mkdir(parents=True)
        meshes = write_humans(Path(name) / "made", MODELS, options.faces)
        for k in range(options.subjects):
            (scans / f"s{k:03d}").mkdir(parents=True)
            for file in meshes[k % MODELS].parent.iterdir():
                own = f"s{k:03d}.obj" if file == meshes[k % MODELS] else file.name
                (scans / f"s{k:03d}" / own).symlink_to(file)
        source = Scans(root=str(scans), licence="CC0-1.0", up="y", front="z", unit="m")
        config = BuildConfig(
            subjects=source, views=ViewsConfig(count=options.views), cycles=CyclesConfig()
        )
        ids = sorted(source.ids())
        tasks = [Task(s, data, data / "shards" / f"{s}.npz", config, cpu_count()) for s in ids]
        print(f"{len(tasks)} subjects of {options.faces} faces, {options.views} views", flush=True)
        rows = measure(tasks)
        for task in tasks[:TEN]:  # from the beginning
            shutil.rmtree(data / "subjects" / task.subject)
        fresh = median(row[0] for row in measure(tasks[:TEN]))
    seconds, held, most = zip(*rows, strict=True)
    growth = held[-1] / held[TEN - 1]
    first, last = median(seconds[:TEN]), median(seconds[-TEN:])
    print(f"memory after subject {TEN} {held[TEN - 1]:.0f} MB, after the last {held[-1]:.0f} MB")
    print(f"ratio {growth:.3f} (at most {LARGEST_GROWTH})")
    print(f"memory at most {most[-1]:.0f} MB (at most {MOST_MEGABYTES})")
    print(f"a subject of the first ten {first:.2f} s, of the last {last:.2f} s: {last / first:.2f}")
    print(f"last over a fresh worker's: {last / fresh:.2f} (at most {SLOWEST})")
    grown = growth > LARGEST_GROWTH or most[-1] > MOST_MEGABYTES
    return int(grown or last / fresh > SLOWEST)


def measure(tasks: list[Task]) -> list[tuple[float, float, float]]:
    """What `measured` says of each task, all in one worker."""
    rows = []
    for task, row in tqdm(run(measured, tasks, jobs=1), total=len(tasks)):
        if isinstance(row, BaseException):
            raise row
        rows.append(row)
        task.shard.unlink()
    return rows


if __name__ == "__main__":
    sys.exit(main())
