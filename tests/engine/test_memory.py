"""Peak memory: what this process holds and what a child holds beside it, at one moment."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

from engine.memory import PeakMemory

HOLD = "import time; held = b'x' * 300_000_000; time.sleep(1)"


def test_what_a_child_held_counts_though_it_has_ended() -> None:
    with PeakMemory() as nothing:
        pass
    with PeakMemory() as peak:
        subprocess.run([sys.executable, "-c", HOLD], check=True)
    assert 300 < peak.megabytes - nothing.megabytes < 400


def test_what_is_held_together_counts_together_and_in_turn_once() -> None:
    with PeakMemory() as nothing:
        pass
    with PeakMemory() as together:
        held = np.ones(25_000_000)
        subprocess.run([sys.executable, "-c", HOLD], check=True)
    assert held.nbytes == 200_000_000
    assert 500 < together.megabytes - nothing.megabytes < 600
    del held
    with PeakMemory() as in_turn:
        np.ones(25_000_000).sum()
        subprocess.run([sys.executable, "-c", HOLD], check=True)
    assert in_turn.megabytes - nothing.megabytes < 400


def test_a_child_that_has_not_begun_its_program_holds_nothing_of_its_own() -> None:
    held = np.ones(25_000_000)
    with PeakMemory() as nothing:
        pass
    with PeakMemory() as peak:
        subprocess.run(["true"], check=True, preexec_fn=lambda: time.sleep(0.7))
    assert held.nbytes == 200_000_000
    assert peak.megabytes - nothing.megabytes < 100
