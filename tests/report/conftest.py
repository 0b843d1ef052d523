"""Finished datasets of the closed-form box, with maps and files of a test's own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shards.archive import write_shard
from shards.dataset import DatasetWriter
from tests.shards.conftest import CONFIG, closed_form_arrays, closed_form_meta

Build = Callable[..., Path]


@pytest.fixture
def build(tmp_path: Path) -> Build:
    """build(subjects): the folder of a finished dataset.

    subjects: id -> {"maps": name -> (H, W) or (H, W, 3) in place of the box's, in every view,
    "yaw_deg": of each view (default: one, not turned), "body": the body's parameters,
    "parameters" and "cost": what parameters.json and cost.json hold, "surface" and "texture":
    bytes, "seconds": what the shard took, "failed": why it was set aside}; all of it optional.
    """

    def build(subjects: dict[str, dict[str, Any]]) -> Path:
        folder = tmp_path / "dataset"
        with DatasetWriter(folder, CONFIG, list(subjects), 7, {"numpy": np.__version__}) as writer:
            for subject, given in subjects.items():
                if "failed" in given:
                    writer.fail(subject, "subjects", given["failed"])
                    continue
                home = folder / "subjects" / subject
                home.mkdir()
                (home / f"{subject}.obj").write_bytes(given.get("surface", subject.encode()))
                (home / "material0.jpeg").write_bytes(given.get("texture", subject.encode()))
                if "parameters" in given:
                    (home / "parameters.json").write_text(json.dumps(given["parameters"]))
                    cost = given.get("cost", {"seconds": 31.5, "peak_memory_mb": 1900})
                    (home / "cost.json").write_text(json.dumps(cost))
                yaw_deg = np.array(given.get("yaw_deg", [0.0]), dtype="<f4")
                views = len(yaw_deg)
                arrays = closed_form_arrays(views) | {"yaw_deg": yaw_deg}
                for name, array in given.get("maps", {}).items():
                    arrays[name] = np.stack([array.astype(arrays[name].dtype)] * views)
                meta = closed_form_meta(subject, views)
                meta["mesh"] = f"subjects/{subject}/{subject}.obj"
                meta["body_parameters"] = given.get("body", {})
                written = write_shard(writer.shard_path(subject), arrays, meta)
                writer.add(subject, *written, given.get("seconds", 1.0), "CC0-1.0")
            writer.finish()
        return folder

    return build
