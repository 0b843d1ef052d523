"""Seconds and megabytes of a large dataset's report, and seconds until a browser shows it.

    python -m benchmarks.report DIR [--subjects 100] [--views 14]

DIR is a dataset; its shards are written again and again under other names until there are enough,
each a file of its own that is on the disk and no longer in memory; --views takes the first few
views, where the disk has no room for all of them. The browser is a headless Chromium; a first view
is the first subject's pictures on the screen.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from report.browser import browser
from shards.archive import write_shard
from shards.dataset import Dataset, DatasetWriter

ROOT = Path(__file__).parents[1]
MOST_SECONDS, MOST_MEGABYTES, MOST_FIRST_VIEW = 60.0, 40.0, 2.0
"""Of a hundred subjects."""


def write(dataset: Dataset, folder: Path, count: int, views: int | None) -> None:
    """A dataset of so many subjects, who look like those of `dataset`; None for all their views."""
    given = [dataset.shard(subject) for subject in dataset.subjects()]
    names = [f"person_{k:04d}" for k in range(count)]
    with DatasetWriter(folder, {}, names, 0, {}) as writer:
        for k, name in enumerate(names):
            shard = given[k % len(given)]
            arrays = {member: shard[member][:views] for member in shard.names}
            path = writer.shard_path(name)
            meta = shard.meta | {"subject": name}
            meta["dropped_pixels"] = meta["dropped_pixels"][:views]
            written = write_shard(path, arrays, meta)
            with path.open("rb") as file:
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
            writer.add(name, *written, 1.0, shard.meta["licence"])
            print(f"\r{k + 1}/{count}", end="", file=sys.stderr)
        writer.finish()
    print(file=sys.stderr)


def first_view(page: Path) -> float:
    """Seconds from asking for the page to the first subject's pictures."""
    with browser() as opened:
        tab = opened.new_page()
        start = time.perf_counter()
        tab.goto(page.as_uri(), wait_until="commit")
        tab.locator(".card img").first.evaluate("picture => picture.decode()")
        return time.perf_counter() - start


def main() -> int:
    """Print the figures; 1 if at most a hundred subjects break a bound, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--subjects", type=int, default=100)
    parser.add_argument("--views", type=int, help="of each subject (default: all)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.data.resolve().parent) as name:
        folder = Path(name) / "many"
        write(Dataset(options.data), folder, options.subjects, options.views)
        start = time.perf_counter()
        command = [sys.executable, "pipeline.py", "report", str(folder)]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        page = folder / "report.html"
        megabytes = page.stat().st_size / 1e6
        shown = first_view(page)
    found = {
        "seconds": (seconds, MOST_SECONDS),
        "megabytes": (megabytes, MOST_MEGABYTES),
        "seconds to the first view": (shown, MOST_FIRST_VIEW),
    }
    for what, (value, most) in found.items():
        print(f"{options.subjects} subjects: {value:.2f} {what} (at most {most:g} of a hundred)")
    return int(options.subjects <= 100 and any(value > most for value, most in found.values()))


if __name__ == "__main__":
    sys.exit(main())
