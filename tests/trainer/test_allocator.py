"""Memory that is kept is not asked for again: counted in page faults, in a process of its own."""

import subprocess
import sys
from pathlib import Path

PROGRAM = """
import resource
import sys

import torch

from trainer import allocator

if sys.argv[1] == "keep":
    allocator.keep()
faults = []
for _ in range(6):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    torch.ones(64 << 20, dtype=torch.uint8).add_(1)
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
print(min(faults))
"""


def fewest_faults(how: str) -> int:
    """Of a round that makes and frees 64 MiB."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, how],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    return int(done.stdout)


def test_a_second_array_takes_the_place_of_the_first() -> None:
    assert fewest_faults("keep") < 10
    assert fewest_faults("leave") > 30  # or there would be nothing to gain
