"""How fast the trainer's loader brings cropped views: samples per second, warm.

    python -m benchmarks.views DIR [--workers 2] [--batch 8] [--rounds 5]

DIR is a dataset. Every row reads all its training views `rounds` times through workers that stay
from round to round, after one round that warms the files, and shows the median round.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from statistics import median

from torch.utils.data import DataLoader

from trainer import allocator
from trainer.views import Views, ViewsConfig

TARGET = 300
SIZES = ((416, 256), (208, 128))


def measure(views: Views, batch: int, workers: int, rounds: int) -> float:
    """Samples per second of the median round."""
    loader = DataLoader(
        views, batch_size=batch, shuffle=True, num_workers=workers, persistent_workers=workers > 0
    )
    rates = []
    for epoch in range(rounds + 1):
        views.set_epoch(epoch)
        start = time.perf_counter()
        seen = sum(len(found.index) for found in loader)
        rates.append(seen / (time.perf_counter() - start))
    return median(rates[1:])


def main() -> int:
    """Measure and print; 1 if whole people come too slowly, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of the dataset")
    parser.add_argument("--workers", type=int, default=2, help="processes that read (2)")
    parser.add_argument("--batch", type=int, default=8, help="views in a batch (8)")
    parser.add_argument("--rounds", type=int, default=5, help="timed passes over the views (5)")
    options = parser.parse_args()
    allocator.keep()  # as a training does
    print(f"{'crop':>10}{'noise':>10}{'samples/s':>11}")
    rates = {}
    for size in SIZES:
        for noise in ("redrawn", "stored"):
            views = Views(options.data, "train", ViewsConfig(size, noise), varied=True)
            rates[size, noise] = measure(views, options.batch, options.workers, options.rounds)
            name = f"{size[0]} x {size[1]}"
            print(f"{name:>10}{noise:>10}{rates[size, noise]:11.0f}", flush=True)
    slowest = min(rates.values())
    print(f"at least {slowest:.0f} (target {TARGET}) from {options.workers} workers")
    return 0 if slowest >= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
