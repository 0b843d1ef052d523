"""Many shards read at once, and what is told of those that cannot be."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from typing import TypeVar

from joblib import Parallel, delayed
from tqdm import tqdm

Given = TypeVar("Given")
Found = TypeVar("Found")


def each(function: Callable[[Given], Found], given: Iterable[Given], jobs: int) -> list[Found]:
    """What a function finds of each, in their order; the terminal shows how far it is.

    Args:
        jobs: processes.
    """
    given = list(given)
    work = Parallel(n_jobs=min(jobs, len(given) or 1), return_as="generator")(
        delayed(function)(one) for one in given
    )
    return list(tqdm(work, "report", len(given), leave=False, disable=not sys.stderr.isatty()))


def one_line(error: Exception) -> str:
    """What an error says."""
    return " ".join(str(error).split())
