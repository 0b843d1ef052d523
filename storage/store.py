"""A folder of an object store, by its URL: whatever `fsspec` knows, from s3:// to memory://."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from storage.atomic import NO_ROOM, atomic_write


class StoreError(OSError):
    """A store that cannot be reached or does not let us; one line: which, why, the cure."""


@dataclass(frozen=True)
class Stored:
    """What a store tells of one file.

    Attributes:
        bytes: its size.
        token: what changes when the file does: a checksum or a time, as the store has it.
    """

    bytes: int
    token: str


def is_url(place: object) -> bool:
    """Whether `place` names a store, and no folder of this machine."""
    return re.match(r"(?!file:)[A-Za-z][A-Za-z0-9+.-]*://", str(place)) is not None


def local_path(place: Path | str) -> Path:
    """The folder that `place` names, which is no store; file:///a/b is one too."""
    text = str(place)
    return Path(unquote(urlsplit(text).path)) if text.startswith("file://") else Path(place)


class Store:
    """The files below a URL. Names are posix paths below it, and any that leads out of it is a
    StoreError; a file appears there whole.

    Instances can be pickled, and used in a process that was forked.

    Args:
        url: of the folder, such as s3://bucket/people. Keys, endpoints and regions are where the
            store's own tools have them (for S3 `AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT_URL`, ...).

    Raises:
        StoreError: nothing that is installed knows such a URL.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self._open: tuple[int, Any, str] | None = None
        self._place()

    def __repr__(self) -> str:
        return f"Store({self.url!r})"

    def __getstate__(self) -> dict[str, Any]:
        return {"url": self.url, "_open": None}

    def read(self, name: str) -> bytes:
        """A file's bytes.

        Raises:
            FileNotFoundError: there is no such file.
            StoreError: it cannot be read.
        """
        with self._errors(name) as (system, path):
            data: bytes = system.cat_file(path)
            return data

    def write(self, name: str, data: bytes) -> None:
        """Make or replace a file.

        Raises:
            StoreError: it cannot be written.
        """
        with self._errors(name) as (system, path):
            system.pipe_file(path, data)

    def put(self, file: Path, name: str) -> None:
        """Make or replace a file from one of this machine.

        Raises:
            StoreError: it cannot be written.
        """
        with self._errors(name) as (system, path):
            system.put_file(str(file), path)

    def fetch(self, name: str, file: Path) -> None:
        """Copy a file to this machine, whole or not at all; its folder is made.

        Raises:
            FileNotFoundError: there is no such file.
            StoreError: it cannot be read.
        """
        with self._errors(name) as (system, path):
            file.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(file) as target:
                system.get_file(path, target.name)

    def stat(self, name: str) -> Stored:
        """What the store tells of a file.

        Raises:
            FileNotFoundError: there is no such file.
            StoreError: it cannot be asked.
        """
        with self._errors(name) as (system, path):
            info = system.info(path)
            if info["type"] != "file":
                raise FileNotFoundError(f"{self.url}/{name}")
            return _stored(info)

    def files(self, below: str = "") -> dict[str, Stored]:
        """All files, or those of one folder: name -> what the store tells of it; may be none.

        Raises:
            StoreError: the store cannot be listed.
        """
        found = {}
        with self._errors(below) as (system, path):
            root = self._place()[1].rstrip("/")
            for full, info in system.find(path, detail=True).items():
                name = str(full).removeprefix(root).removeprefix("/")
                # Some stores have a file of no bytes for a folder: "scans/".
                if name and info["type"] == "file" and not name.endswith("/"):
                    found[self._below(name)] = _stored(info)
        return dict(sorted(found.items()))

    def _place(self) -> tuple[Any, str]:
        """The file system and the folder's path in it; anew after a fork."""
        if self._open is None or self._open[0] != os.getpid():
            try:
                import fsspec
            except ModuleNotFoundError:
                raise StoreError(
                    f"{self.url}: stores need fsspec; pip install 'rectoverso[stores]'"
                ) from None
            try:
                system, root = fsspec.core.url_to_fs(self.url)
            except Exception as error:  # every store brings exceptions of its own
                raise StoreError(f"{self.url}: {_line(error)}") from error
            self._open = os.getpid(), system, root
        return self._open[1:]

    @contextmanager
    def _errors(self, name: str) -> Iterator[tuple[Any, str]]:
        """The file system and a file's path in it, whose errors become a StoreError."""
        system, root = self._place()
        try:
            system.invalidate_cache()  # what others did meanwhile counts
            yield system, f"{root.rstrip('/')}/{self._below(name)}" if name else root
        except (FileNotFoundError, StoreError):
            raise
        except OSError as error:
            if error.errno in NO_ROOM:
                raise
            raise StoreError(self._told(name, error)) from error
        except Exception as error:  # every store brings exceptions of its own
            raise StoreError(self._told(name, error)) from error

    def _below(self, name: str) -> str:
        """`name`, which must not lead out of the folder, here or there: a store may hold any key.

        Raises:
            StoreError: it does.
        """
        if "\\" in name or "\0" in name or {"", ".", ".."} & set(name.split("/")):
            raise StoreError(
                f"{self.url}: {name!r} is no file's name below the folder; rename it there"
            )
        return name

    def _told(self, name: str, error: Exception) -> str:
        where = f"{self.url}/{name}" if name else self.url
        return f"{where}: {_line(error)}; see that the store is there and your keys are right"


def _stored(info: dict[str, Any]) -> Stored:
    known = ("ETag", "etag", "md5Hash", "sha256", "LastModified", "mtime", "created")
    token = next((f"{key} {info[key]}" for key in known if info.get(key)), "")
    return Stored(int(info["size"] or 0), token)


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
