"""The folder of a run's temporary files."""

import subprocess
import sys
from pathlib import Path

import pytest

from engine.scratch import scratch_folder
from engine.workers import EngineError, remove_semaphores


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_it_is_empty_and_gone_at_the_end(tmp_path, temporary):
    with scratch_folder(tmp_path / "data") as folder:
        assert folder.parent == temporary
        (folder / "below").mkdir()
        (folder / "below" / "view.exr").touch()
    assert list(temporary.iterdir()) == []


def test_what_a_killed_run_left_is_removed_and_another_output_has_its_own(tmp_path, temporary):
    left = scratch_folder(tmp_path / "data")
    with left as folder:
        (folder / "view.exr").touch()
        kept = folder.rename(temporary / "kept")
    kept.rename(folder)
    with scratch_folder(tmp_path / "other"):
        assert (folder / "view.exr").exists()
    with scratch_folder(tmp_path / "data") as again:
        assert again == folder
        assert not (folder / "view.exr").exists()


def test_a_link_in_its_place_is_not_followed(tmp_path, temporary):
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").touch()
    with scratch_folder(tmp_path / "data") as folder:
        pass
    folder.symlink_to(precious)
    with (
        pytest.raises(EngineError, match="is somebody else's; remove it"),
        scratch_folder(tmp_path / "data"),
    ):
        pass
    assert (precious / "file").exists()


def test_semaphores_go_with_the_process_that_made_them():
    code = "import time; print(flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    left = Path("/dev/shm") / f"sem.loky-{process.pid}-test"
    try:
        left.touch()
        remove_semaphores(process.pid)
        assert left.exists()
        process.kill()
        process.wait()
        remove_semaphores(process.pid)
        assert not left.exists()
    finally:
        process.kill()
        left.unlink(missing_ok=True)
