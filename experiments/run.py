"""The experiments by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from experiments.config import ExperimentConfig
from experiments.figures import figure2, figure9, figure15
from experiments.light import figure13, figure14
from experiments.study import Study
from experiments.tables import TABLES
from shards.lock import lock_folder

EXPERIMENTS: dict[str, Callable[[Study], str]] = {
    "fig2": figure2,
    **TABLES,
    "fig9": figure9,
    "fig13": figure13,
    "fig14": figure14,
    "fig15": figure15,
}


def experiment(name: str, folder: Path, config: ExperimentConfig) -> str:
    """Run an experiment in a study's folder; what it found, in words.

    Its table or figure and the JSON behind it are in the folder's `results`. Experiments of one
    folder share data, trainings and meshes; it belongs to one configuration.

    Raises:
        ValueError: a step failed, or another experiment is at work there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with lock_folder(folder):
        study = Study(folder, config)
        if name != "fig2":
            _ = study.subjects  # what cannot be is said before anything is learned
        return EXPERIMENTS[name](study)
