"""Which of a subject's views a report shows."""

from __future__ import annotations

import argparse

import numpy as np

from shards.archive import Shard

WORDS = "which view (default: of each subject the one turned least)"


def add_option(parser: argparse.ArgumentParser) -> None:
    """--view, None if it is left out."""
    parser.add_argument("--view", type=int, help=WORDS)


def chosen(shard: Shard, view: int | None) -> int:
    """The view asked for or, of None, the one turned least: that of the smallest |yaw|.

    Raises:
        ValueError: the shard has no such view.
    """
    if view is None:
        return int(np.abs(shard["yaw_deg"]).argmin())
    if not 0 <= view < len(shard):
        subject = shard.meta["subject"]
        raise ValueError(f"{subject} has views 0 to {len(shard) - 1}, not {view}; set --view")
    return view


def described(view: int | None, yaw_deg: list[float]) -> str:
    """In words what `chosen` chose, with the turn of each subject, degrees."""
    what = "the view turned least" if view is None else f"view {view}"
    low, high = min(yaw_deg), max(yaw_deg)
    turn = f"{low:.1f}°" if low == high else f"{low:.1f}° to {high:.1f}°"
    return f"{what}, yaw {turn}"
