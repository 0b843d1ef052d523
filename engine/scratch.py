"""Where a run's temporary files lie: in one folder that nothing outlives."""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from engine.workers import EngineError, remove_semaphores

OWNER = "owner"
"""File with the number of the process whose run it is."""


@contextmanager
def scratch_folder(output: Path) -> Iterator[Path]:
    """An empty folder for the temporary files of the run that writes `output`.

    It lies where the system keeps such files and is named after `output`, which one run at a time
    may write: what a run that was killed has left there, the next one removes.

    Raises:
        EngineError: somebody else has a folder of that name.
        OSError: none can be made.
    """
    name = hashlib.sha256(os.fsencode(output.resolve())).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"rectoverso-{name}"
    _remove(folder)
    folder.mkdir(mode=0o700)
    (folder / OWNER).write_text(str(os.getpid()))
    try:
        yield folder
    finally:
        _remove(folder)


def temporary_in(folder: Path) -> dict[str, str]:
    """Variables with which a process has its temporary files there, and Blender its own as well."""
    return {"TMPDIR": str(folder), "BLENDER_USER_RESOURCES": str(folder / "blender")}


def _remove(folder: Path) -> None:
    try:
        found = folder.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
        raise EngineError(f"{folder} is somebody else's; remove it, or set TMPDIR")
    owner = folder / OWNER
    if owner.is_file() and (number := owner.read_text()).isdecimal():
        remove_semaphores(int(number))
    shutil.rmtree(folder)
