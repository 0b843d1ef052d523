"""Files of a dataset, which may be a stranger's, opened to be read."""

from __future__ import annotations

import io
import stat
from pathlib import Path


def open_file(path: Path) -> io.BufferedReader:
    """A regular file, opened to be read: a pipe nobody may write to, a device may have no end.

    Raises:
        OSError: if it cannot be opened, or is no regular file.
    """
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # opening a folder tells what it is
        raise OSError(0, "no regular file", str(path))
    return path.open("rb")
