"""Files that appear whole or not at all, whenever the process dies."""

from __future__ import annotations

import errno
import io
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SUFFIX = ".tmp"

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS})
"""Errors of a disk that takes no more, whatever is to be written."""


@contextmanager
def atomic_write(path: Path) -> Iterator[io.BufferedRandom]:
    """A binary file to write and read back that takes the name `path` when the block ends.

    The bytes go to a hidden temporary file in the same folder, reach the disk, and only then take
    the name. If the block raises, the temporary file is removed and `path` stays as it was; if
    the process is killed, the temporary file is left for `remove_temporary_files`.
    """
    # Host and process tell writers on a shared folder apart, without a random number.
    temporary = path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}{_SUFFIX}")
    try:
        with temporary.open("w+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def is_temporary(path: Path) -> bool:
    """Whether `path` is what an interrupted `atomic_write` left behind."""
    return path.name.startswith(".") and path.name.endswith(_SUFFIX)


def remove_temporary_files(folder: Path) -> None:
    """Remove what interrupted writers left directly in `folder`."""
    for path in folder.iterdir():
        if is_temporary(path):
            path.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Make the names in `folder` survive a power cut, where the system can."""
    if os.name == "nt":  # Windows cannot open a folder, and needs no such call
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
