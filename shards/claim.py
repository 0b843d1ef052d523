"""A folder that belongs to one configuration."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from shards.manifest import differences
from storage.atomic import atomic_write


def claim(path: Path, record: Mapping[str, Any], what: str) -> None:
    """Make a folder one configuration's, or find that it is this one's.

    Args:
        path: of the record in the folder.
        record: the configuration, JSON-ready.
        what: is in the folder, for the message.

    Raises:
        ValueError: it is another one's, or the record is damaged.
    """
    if path.exists():
        try:
            stands = json.loads(path.read_text())
        except (ValueError, OSError):
            stands = None
        if not isinstance(stands, dict):
            raise ValueError(f"{path} is damaged; choose another folder")
        if stands != record:
            raise ValueError(
                f"{path.parent} holds {what} of another configuration "
                f"({differences(stands, record)}); choose another folder"
            )
        return
    with atomic_write(path) as file:
        file.write(json.dumps(record, indent=1).encode() + b"\n")
