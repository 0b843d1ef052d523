"""The folder of a light sweep: a dataset for each power of the lamp, and the index of them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

from shards.lock import LOCK, lock_folder
from shards.manifest import DatasetError
from storage.atomic import atomic_write, is_temporary

INDEX = "sweep.json"
"""Where the sweep's data lie, what its powers share, and each power's folder."""


def power_folder(power: float) -> str:
    """The name of a power's dataset: "0100W" of 100, "0012.5W" of 12.5."""
    whole, dot, part = repr(float(power)).removesuffix(".0").partition(".")
    return f"{whole.zfill(4)}{dot}{part}W"


def is_sweep(folder: Path) -> bool:
    """Whether the folder is a sweep's."""
    return (folder / INDEX).is_file()


def base_folder(folder: Path) -> Path:
    """The dataset that a sweep photographed.

    Raises:
        DatasetError: the folder holds no sweep, or the dataset is not where it says.
    """
    base: Path = folder / _read(folder)["data"]
    if not base.is_dir():
        raise DatasetError(
            f"{folder} is of the dataset {os.path.normpath(base)}, which is not there; "
            "bring it back, or run the sweep again with --data where it lies now"
        )
    return base


def read_index(folder: Path) -> dict[float, Path]:
    """The powers of a sweep in watts and their datasets, strongest first.

    Raises:
        DatasetError: the folder holds no sweep, or one without a power yet.
    """
    powers = _powers(_read(folder))
    if not powers:
        raise DatasetError(f"{folder} holds no power yet; run the sweep again")
    return {power: folder / power_folder(power) for power in powers}


def read_shared(folder: Path) -> tuple[dict[str, Any], list[float]]:
    """What all powers of a sweep share, and the powers, strongest first; there may be none yet.

    Raises:
        DatasetError: the folder holds no sweep.
    """
    index = _read(folder)
    return dict(index["shared"]), _powers(index)


def write_index(
    folder: Path, data: Path, shared: Mapping[str, Any], powers: Iterable[float]
) -> None:
    """Replace the index of a sweep, or leave it as it was.

    Args:
        folder: of the sweep; it exists.
        data: folder of the dataset that was photographed.
        shared: JSON-ready, what is the same for every power.
        powers: watts.
    """
    index = {
        "data": os.path.relpath(data.resolve(), folder.resolve()),
        "shared": shared,
        "powers": [
            {"power": float(power), "folder": power_folder(power)}
            for power in sorted(powers, reverse=True)
        ],
    }
    with atomic_write(folder / INDEX) as file:
        file.write(json.dumps(index, indent=1).encode() + b"\n")


def lock_sweep(folder: Path) -> IO[bytes]:
    """Claim a folder for a sweep until the file returned is closed; made if missing.

    Raises:
        DatasetError: it holds other things, or another sweep is writing it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if not is_sweep(folder) and not all(
        path.name == LOCK or is_temporary(path) for path in folder.iterdir()
    ):
        raise DatasetError(
            f"{folder} is not empty and holds no {INDEX}; choose a new or empty folder"
        )
    return lock_folder(folder)


def _powers(index: dict[str, Any]) -> list[float]:
    """Watts, strongest first."""
    return sorted((float(entry["power"]) for entry in index["powers"]), reverse=True)


def _read(folder: Path) -> dict[str, Any]:
    """The index, whose powers are numbers above 0."""
    path = folder / INDEX
    try:
        index: dict[str, Any] = json.loads(path.read_text())
        sound = all(0 < power < math.inf for power in _powers(index))
        sound = sound and isinstance(index["data"], str) and isinstance(index["shared"], dict)
    except FileNotFoundError:
        raise DatasetError(f"{folder} holds no {INDEX}; name a folder of a sweep") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        sound = False
    if not sound:
        raise DatasetError(f"{path} is no index of a sweep; delete it and run the sweep again")
    return index
