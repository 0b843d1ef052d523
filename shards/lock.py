"""One build at a time in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import IO

from shards.manifest import DatasetError

LOCK = ".lock"


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
            f"another build is writing {folder}; wait for it or choose another folder"
        ) from None
    return file
