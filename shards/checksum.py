"""SHA-256 of a file."""

from __future__ import annotations

import hashlib
from pathlib import Path

from storage.files import open_file


def file_sha256(path: Path) -> str:
    """SHA-256 of the file's bytes, 64 hex digits.

    Raises:
        OSError: if it cannot be read, or is no regular file.
    """
    with open_file(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
