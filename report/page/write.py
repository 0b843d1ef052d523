"""The page of a folder, whatever it holds."""

from __future__ import annotations

import os
from pathlib import Path

from joblib import cpu_count

from report.page import dataset, experiment, sweep, training
from shards.dataset import DOCUMENT
from shards.sweep import is_sweep
from storage.atomic import atomic_write

NAME = "report.html"


def write(folder: Path, output: Path | None, view: int | None, jobs: int | None) -> Path:
    """Write the page of a dataset, a sweep, an experiment or a training.

    Args:
        folder: which.
        output: the file; None for `NAME` in the folder.
        view: of each subject, that is shown; None for the one turned least.
        jobs: processes that read; None for one per processor.

    Raises:
        ValueError: the folder holds none of these.
        OSError: the page cannot be written.
    """
    output = output or folder / NAME
    output.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(output.parent, os.W_OK):  # before an hour's work, and not after it
        raise ValueError(f"{output.parent} cannot be written; give another place with --output")
    jobs = jobs or cpu_count()
    if (folder / DOCUMENT).is_file():
        text = dataset.page(folder, view, jobs)
    elif is_sweep(folder):
        text = sweep.page(folder, view, jobs)
    elif training.is_training(folder):
        text = training.page(folder)
    elif experiment.is_experiment(folder):
        text = experiment.page(folder)
    else:
        raise ValueError(
            f"{folder} holds no dataset, sweep, training or experiment; give the folder of one"
        )
    with atomic_write(output) as file:
        file.write(text.encode(errors="backslashreplace"))
    return output
