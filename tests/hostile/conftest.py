"""A small sound dataset to be damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from shards.archive import write_shard
from shards.dataset import DatasetWriter
from tests.shards.conftest import CONFIG, closed_form_arrays, closed_form_meta, write_surfaces


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """One shard of one view, the closed-form box's."""
    folder, meta = tmp_path / "dataset", closed_form_meta("box", 1)
    with DatasetWriter(folder, CONFIG, ["box"], 7, meta["versions"]) as writer:
        write_surfaces(folder)
        written = write_shard(writer.shard_path("box"), closed_form_arrays(1), meta)
        writer.add("box", *written, 1.25, meta["licence"])
        writer.finish()
    return folder
