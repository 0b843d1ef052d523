"""What `verify` found, kept beside the dataset for whoever looks at it later."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shards.checksum import file_sha256
from shards.dataset import MANIFEST, Dataset
from shards.verify import Report
from storage.atomic import atomic_write
from storage.files import open_file

PROOF = "verify.json"
"""No part of the dataset: it says of which manifest it speaks, and of another it says nothing."""


@dataclass(frozen=True)
class Proof:
    """A proof that is under way.

    Attributes:
        folder: the dataset's.
        manifest_sha256: of what is proven: a build may add to it meanwhile. None of no manifest.
    """

    folder: Path
    manifest_sha256: str | None

    @classmethod
    def begin(cls, folder: Path) -> Proof:
        """Before anything is read."""
        return cls(folder, _manifest_sha256(folder))

    def end(self, report: Report) -> None:
        """Keep what was found in the dataset's folder; says so on stderr where it cannot."""
        record = {
            "manifest_sha256": self.manifest_sha256,
            "breaches": report.breaches,
            "figures": {
                # JSON has no number that is none.
                subject: {name: float(v) if math.isfinite(v) else None for name, v in of.items()}
                for subject, of in report.figures.items()
            },
        }
        try:
            with atomic_write(self.folder / PROOF) as file:
                file.write(json.dumps(record, indent=1, allow_nan=False).encode() + b"\n")
        except OSError as error:
            sys.stderr.write(
                f"{self.folder / PROOF} cannot be written ({error.strerror}): a report will not "
                "know of this proof\n"
            )


def _manifest_sha256(folder: Path) -> str | None:
    try:
        return file_sha256(folder / MANIFEST)
    except OSError:
        return None


def read_proof(dataset: Dataset) -> Report | None:
    """The report that was kept, if it is of the dataset as it stands."""
    try:
        with open_file(dataset.folder / PROOF) as file:
            record: Any = json.loads(file.read())
        if record["manifest_sha256"] != _manifest_sha256(dataset.folder):
            return None
        figures = {
            str(subject): {
                str(name): float("nan") if value is None else float(value)
                for name, value in of.items()
            }
            for subject, of in record["figures"].items()
        }
        breaches = record["breaches"]
        if not isinstance(breaches, list):
            return None
        return Report([str(line) for line in breaches], figures)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
