"""A training on disk: networks, optimisers and what they learned from, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from shards.atomic import atomic_write

SCHEMA = 2

KEYS = {"schema", "config", "range", "state", "metrics", "data"}
"""Of a checkpoint: the configuration as JSON values, the file of VGG's weights by its SHA-256; near
and far of the depth range in metres; state dicts by name; figures of every epoch; the dataset's
configuration hash, subjects, and a hash of their shards."""


class CheckpointError(ValueError):
    """A file that is no checkpoint of this program; one line: what, where, the cure."""


def save(path: Path, checkpoint: dict[str, Any]) -> None:
    """Replace the file, or leave it as it was.

    Args:
        checkpoint: `KEYS` but for the schema: tensors, numbers, text, lists and dicts alone.
    """
    with atomic_write(path) as file:
        torch.save({"schema": SCHEMA, **checkpoint}, file)


def load(path: Path) -> dict[str, Any]:
    """What `save` wrote, on the CPU. Nothing but tensors and plain values is read.

    Raises:
        CheckpointError: the file is missing, torn, or no checkpoint of this schema.
    """
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise CheckpointError(f"{path} is missing; train first") from None
    except Exception:  # foreign bytes provoke every kind of error in torch's reader
        raise CheckpointError(f"{path} is no checkpoint, or a torn one; train again") from None
    schema = found.get("schema") if isinstance(found, dict) else None
    if schema != SCHEMA:
        raise CheckpointError(
            f"{path} has schema {schema}, this program reads {SCHEMA}; train again, or use the "
            "program that wrote it"
        )
    if set(found) != KEYS:
        raise CheckpointError(f"{path} has not the keys of a checkpoint; train again")
    return found
