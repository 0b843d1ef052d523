"""The folder of a light sweep: a dataset for each power of the lamp, and the index of them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from shards.atomic import atomic_write, is_temporary
from shards.manifest import DatasetError

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
        DatasetError: the folder holds no sweep.
    """
    return folder / _read(folder)["data"]


def read_index(folder: Path) -> dict[float, Path]:
    """The powers of a sweep in watts and their datasets, strongest first.

    Raises:
        DatasetError: the folder holds no sweep.
    """
    return {power: folder / power_folder(power) for power in _powers(_read(folder))}


def write_index(
    folder: Path, data: Path, shared: Mapping[str, Any], powers: Iterable[float]
) -> None:
    """Enter powers into the index of a sweep; those of earlier runs stay.

    Args:
        folder: of the sweep; it exists.
        data: folder of the dataset that was photographed.
        shared: JSON-ready, what is the same for every power.
        powers: watts.

    Raises:
        DatasetError: the folder holds a sweep that shares other values, or other things.
        OSError: it cannot be written.
    """
    every = {float(power) for power in powers}
    if (folder / INDEX).exists():
        known = _read(folder)
        there: dict[str, Any] = known["shared"]
        here = json.loads(json.dumps(shared))
        differing = sorted(k for k in there.keys() | here.keys() if there.get(k) != here.get(k))
        if differing:
            found = ", ".join(
                f"{key} is {json.dumps(there.get(key))} there and {json.dumps(here.get(key))} here"
                for key in differing
            )
            raise DatasetError(
                f"{folder} holds a sweep of another configuration ({found}); "
                "choose another folder or delete the sweep"
            )
        every |= set(_powers(known))
    elif not all(is_temporary(path) for path in folder.iterdir()):
        raise DatasetError(
            f"{folder} is not empty and holds no {INDEX}; choose a new or empty folder"
        )
    index = {
        "data": os.path.relpath(data.resolve(), folder.resolve()),
        "shared": shared,
        "powers": [
            {"power": power, "folder": power_folder(power)} for power in sorted(every, reverse=True)
        ],
    }
    with atomic_write(folder / INDEX) as file:
        file.write(json.dumps(index, indent=1).encode() + b"\n")


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
