"""The list of finished shards, one JSON line each."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from shards.schema import check_relative_path, check_subject_id
from shards.splits import SPLITS, Split
from storage.atomic import atomic_write
from storage.files import open_file

_SHOWN_DIFFERENCES = 4


class DatasetError(ValueError):
    """A folder that cannot be used as a dataset; one line: what, where, the cure."""


@dataclass(frozen=True)
class Entry:
    """One finished shard.

    Attributes:
        file: posix path below the dataset.
        bytes: the file's size.
        sha256: of the file, hex.
        views: that it holds.
        subject: its id.
        split: "train" or "test".
        licence: the subject's.
        seconds: what it took to make.
        versions: what made it, name -> version.
    """

    file: str
    bytes: int
    sha256: str
    views: int
    subject: str
    split: Split
    licence: str
    seconds: float
    versions: dict[str, str]

    def __post_init__(self) -> None:
        check_relative_path(self.file, "file")
        check_subject_id(self.subject)
        if self.split not in SPLITS:
            raise ValueError(f"split is {self.split!r}, not {' or '.join(SPLITS)}")
        for name in ("sha256", "licence"):
            if not isinstance(getattr(self, name), str):
                raise ValueError(f"{name} is {getattr(self, name)!r}, which is no text")
        for name, kind in (("bytes", int), ("views", int), ("seconds", (int, float))):
            value = getattr(self, name)
            if not isinstance(value, kind) or not 0 <= value < math.inf:
                raise ValueError(f"{name} is {value!r}, which is no such number")
        if not isinstance(self.versions, dict):
            raise ValueError(f"versions is {self.versions!r}, which is no object")


def read_manifest(path: Path) -> dict[str, Entry]:
    """Subject -> entry; the last line of a subject counts, a torn last line does not.

    Raises:
        DatasetError: at a line that is no entry, or that names a file outside the dataset.
    """
    entries = {}
    names = {field.name for field in fields(Entry)}
    for number, record in read_json_lines(path):
        try:
            if set(record) != names:
                raise ValueError(
                    f"its keys are {', '.join(record)}, not {', '.join(sorted(names))}"
                )
            entry = Entry(**record)
        except (TypeError, ValueError) as error:
            raise DatasetError(
                f"{path} line {number}: {error}; remove the line and build again"
            ) from None
        entries[entry.subject] = entry
    return entries


def read_json_lines(path: Path) -> list[tuple[int, dict[str, Any]]]:
    """(line number, object) of every whole line; none where the file is missing.

    A last line without its line feed was torn by a killed writer and is left out.

    Raises:
        DatasetError: at a whole line that is no JSON object, or where the file cannot be read.
    """
    try:
        with open_file(path) as file:
            lines = file.read().split(b"\n")[:-1]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DatasetError(
            f"{path} cannot be opened ({error.strerror}); check its rights"
        ) from None
    records = []
    for number, line in enumerate(lines, start=1):
        try:
            record = json.loads(line)
        except (ValueError, RecursionError):
            record = None
        if not isinstance(record, dict):
            raise DatasetError(
                f"{path} line {number} is no JSON object; remove the line and build again"
            )
        records.append((number, record))
    return records


def append_json_line(path: Path, record: dict[str, Any]) -> None:
    """Append one line; when this returns, the line is on the disk."""
    with path.open("ab") as file:
        file.write(_json_line(record))
        file.flush()
        os.fsync(file.fileno())


def write_json_lines(path: Path, records: Iterable[dict[str, Any]]) -> None:
    """Replace the whole file, or leave it as it was."""
    with atomic_write(path) as file:
        file.writelines(_json_line(record) for record in records)


def write_manifest(path: Path, entries: dict[str, Entry]) -> None:
    """Replace the manifest, in the order of the subjects' ids."""
    write_json_lines(path, (asdict(entries[subject]) for subject in sorted(entries)))


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """What two configurations differ in, for a person: the first few keys; "" of equal ones.

    Args:
        there: of a folder that stands, plain JSON values; may be nested.
        here: of the one who asks.
    """
    old, new = _flatten(there), _flatten(here)
    keys = sorted(k for k in old.keys() | new.keys() if old.get(k) != new.get(k))
    shown = [
        f"{key} is {json.dumps(old.get(key))} there and {json.dumps(new.get(key))} here"
        for key in keys[:_SHOWN_DIFFERENCES]
    ]
    if len(keys) > _SHOWN_DIFFERENCES:
        shown.append(f"and {len(keys) - _SHOWN_DIFFERENCES} more keys")
    return ", ".join(shown)


def _flatten(config: Any, prefix: str = "") -> dict[str, Any]:
    """{"a": {"b": 1}} -> {"a.b": 1}."""
    if not isinstance(config, dict) or not config:
        return {prefix: config}
    leaves = {}
    for key, value in config.items():
        leaves.update(_flatten(value, f"{prefix}.{key}" if prefix else str(key)))
    return leaves


def _json_line(record: dict[str, Any]) -> bytes:
    text = json.dumps(record, allow_nan=False, ensure_ascii=False)
    # A path may stand for bytes that are no text; their escapes are JSON.
    return text.encode(errors="backslashreplace") + b"\n"
