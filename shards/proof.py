"""What `verify` found, kept beside the dataset for whoever looks at it later."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from shards.checksum import file_sha256
from shards.dataset import MANIFEST, Dataset
from shards.verify import Report
from storage.atomic import atomic_write
from storage.files import open_file

PROOF = "verify.json"
"""No part of the dataset: it says of which manifest it speaks, and of another it says nothing."""


def write_proof(dataset: Dataset, report: Report, manifest_sha256: str) -> Path | None:
    """Keep a report in the dataset's folder; None where that cannot be written.

    Args:
        manifest_sha256: as it was before the proof began: a build may add to it meanwhile.
    """
    record = {
        "manifest_sha256": manifest_sha256,
        "breaches": report.breaches,
        "figures": {
            # JSON has no number that is none.
            subject: {
                name: float(value) if math.isfinite(value) else None for name, value in of.items()
            }
            for subject, of in report.figures.items()
        },
    }
    path = dataset.folder / PROOF
    try:
        with atomic_write(path) as file:
            file.write(json.dumps(record, indent=1, allow_nan=False).encode() + b"\n")
    except OSError:
        return None
    return path


def manifest_sha256(dataset: Dataset) -> str:
    """What a proof of the dataset is of."""
    return file_sha256(dataset.folder / MANIFEST)


def read_proof(dataset: Dataset) -> Report | None:
    """The report that was kept, if it is of the dataset as it stands."""
    try:
        with open_file(dataset.folder / PROOF) as file:
            record: Any = json.loads(file.read())
        if record["manifest_sha256"] != manifest_sha256(dataset):
            return None
        figures = {
            str(subject): {
                str(name): float("nan") if value is None else float(value)
                for name, value in of.items()
            }
            for subject, of in record["figures"].items()
        }
        return Report([str(line) for line in record["breaches"]], figures)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
