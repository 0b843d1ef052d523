"""One writer at a time in a folder, and none while it is read from."""

from __future__ import annotations

from pathlib import Path
from typing import IO

from shards.manifest import DatasetError

LOCK = ".lock"


def hold_folder(folder: Path) -> IO[bytes] | None:
    """Keep writers out of a folder, other readers not, until the file returned is closed.

    None where no writer ever locked it, as in a copy, or where the folder cannot be locked.

    Raises:
        DatasetError: if a writer has it.
    """
    import fcntl  # no system but a builder's needs it

    try:
        file = (folder / LOCK).open("rb")
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise DatasetError(f"a build is writing {folder}; wait for it to end") from None
    return file


def lock_folder(folder: Path) -> IO[bytes]:
    """The folder's lock, held until the file returned is closed or its process ends.

    The file itself stays: removing it would let two builds hold locks on two files of one name.

    Raises:
        DatasetError: if it is held already.
    """
    import fcntl  # no system but a builder's needs it

    file = (folder / LOCK).open("ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise DatasetError(
            f"{folder} is in use by another build, sweep or training; wait for it or choose "
            "another folder"
        ) from None
    return file
