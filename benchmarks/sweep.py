"""Twenty light powers against one, whole commands on the same subjects in one run.

    python -m benchmarks.sweep DIR

DIR is a dataset. Where it kept no radiance, both commands render it once, and twenty powers are to
cost little more than the one; where it did, nothing is rendered. Both write their shards.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from shards.dataset import Dataset

ROOT = Path(__file__).parents[1]
AIM = 1.5


def seconds(data: Path, subjects: list[str], powers: list[float]) -> tuple[float, int]:
    """Of one sweep into a fresh folder, and the bytes that it wrote."""
    with tempfile.TemporaryDirectory(dir=data.parent) as folder:
        command = [sys.executable, str(ROOT / "pipeline.py"), "sweep", "--data", str(data)]
        command += ["--output", f"{folder}/sweep", "--powers", str(powers)]
        command += ["--subjects", str(subjects)]
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
        elapsed = time.perf_counter() - start
        written = sum(path.stat().st_size for path in Path(folder).glob("sweep/*W/shards/*"))
    return elapsed, written


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of the dataset")
    parser.add_argument("--subjects", type=int, default=2, help="how many")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    dataset = Dataset(given.data)
    subjects = dataset.subjects()[: given.subjects]
    shard = dataset.shard(subjects[0])
    light = "kept in the shards" if "radiance_front" in shard else "rendered once"
    twenty = [2000.0 - 100 * k for k in range(20)]
    ones, alls = [], []
    for _ in range(given.repeats):  # in turn, as a machine's speed changes
        ones.append(seconds(given.data, subjects, twenty[:1]))
        alls.append(seconds(given.data, subjects, twenty))
    one, every = (float(np.median([s for s, _ in runs])) for runs in (ones, alls))
    print(f"{len(subjects)} subjects of {len(shard)} views, radiance {light}")
    print(f"one power      {one:7.2f} s   {ones[0][1] / 1e6:7.1f} MB")
    print(f"twenty powers  {every:7.2f} s   {alls[0][1] / 1e6:7.1f} MB")
    ratios = [every[0] / one[0] for one, every in zip(ones, alls, strict=True)]
    shown = ", ".join(f"{ratio:.2f}" for ratio in ratios)
    aim = "" if "radiance_front" in shard else f"aim {AIM}; "
    print(f"ratio          {np.median(ratios):7.2f}     ({aim}runs: {shown})")


if __name__ == "__main__":
    main()
