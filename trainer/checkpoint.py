"""A training on disk: networks, optimisers and what they learned from, whole or not at all."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch

from storage.atomic import atomic_write
from trainer.views import DepthRange

SCHEMA = 3


@dataclass(frozen=True)
class Checkpoint:
    """Tensors, numbers, text, lists and dicts: nothing that reading would have to run."""

    config: dict[str, Any]
    """The training's configuration as JSON values, the file of VGG's weights by its SHA-256."""
    range: DepthRange
    """What -1 and 1 stand for."""
    state: dict[str, dict]
    """State dicts of networks and optimisers by name."""
    metrics: list[dict[str, float | None]]
    """Figures of every epoch."""
    data: dict[str, Any]
    """The dataset's configuration hash, its subjects, and a hash of their shards."""


class CheckpointError(ValueError):
    """A file that is no checkpoint of this program; one line: what, where, the cure."""


def save(path: Path, checkpoint: Checkpoint) -> None:
    """Replace the file, or leave it as it was."""
    parts = {field.name: getattr(checkpoint, field.name) for field in fields(Checkpoint)}
    # In memory first: Ctrl-C in the midst of a file's write makes torch's writer raise of its own.
    whole = io.BytesIO()
    torch.save({"schema": SCHEMA, **parts, "range": list(checkpoint.range)}, whole)
    with atomic_write(path) as file:
        file.write(whole.getbuffer())


def load(path: Path) -> Checkpoint:
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
    del found["schema"]
    kinds = {"config": dict, "range": list, "state": dict, "metrics": list, "data": dict}
    if set(found) != set(kinds):
        raise CheckpointError(f"{path} has not the parts of a checkpoint; train again")
    for name, kind in kinds.items():
        if not isinstance(found[name], kind):
            raise CheckpointError(f"{path} has a {name} that is no {kind.__name__}; train again")
    depths = found.pop("range")
    numbers = len(depths) == 2 and all(isinstance(value, float) for value in depths)
    if not numbers or not 0 <= depths[0] < depths[1] < math.inf:
        raise CheckpointError(f"{path} has {depths} for a range of depth; train again")
    return Checkpoint(range=DepthRange(*depths), **found)
