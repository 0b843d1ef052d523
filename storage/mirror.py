"""Files of a store on this machine: fetched when they are wanted, and again when they change."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from tqdm import tqdm

from storage.atomic import atomic_write, is_temporary
from storage.cache import cache_folder
from storage.files import open_file
from storage.store import Store, Stored, StoreError, is_url, local_path

URL = ".url"
"""File of a mirror that says what it mirrors."""

FETCHED = ".fetched"
"""File of a mirror with a JSON line for each file: its name and the store's token for it."""


def mirrors() -> Path:
    """The folder that holds the mirrors of those who read."""
    return cache_folder() / "stores"


def builds() -> Path:
    """The folder that holds the mirrors of those who write, which no reader touches."""
    return cache_folder() / "builds"


class Mirror:
    """A folder of this machine that stands for one in a store.

    It may be deleted at any time: what is wanted of it comes again.

    Attributes:
        store: what is mirrored.
        folder: where; the same for every process of a user that mirrors this URL there.

    Args:
        url: as `Store` takes it.
        place: the folder that it lies in; None for that of `mirrors`.

    Raises:
        StoreError: nothing that is installed knows such a URL.
    """

    def __init__(self, url: str, place: Path | None = None) -> None:
        self.store = Store(url)
        name = re.sub(r"[^A-Za-z0-9]+", "-", self.store.url)[-60:].strip("-")
        digest = hashlib.sha256(self.store.url.encode()).hexdigest()[:12]
        self.folder = (place or mirrors()) / f"{name}-{digest}"
        self.folder.mkdir(parents=True, exist_ok=True)
        if not (self.folder / URL).is_file():
            with atomic_write(self.folder / URL) as file:
                file.write(self.store.url.encode())
        self._known: dict[str, str] | None = None
        self._sure: set[str] = set()

    @classmethod
    def of(cls, folder: Path) -> Mirror | None:
        """The mirror that lies in `folder`, or None for any other folder.

        Only those are believed that lie where mirrors do: a stranger's dataset may hold any file.
        """
        if folder.resolve().parent != mirrors().resolve() or not (folder / URL).is_file():
            return None
        return cls((folder / URL).read_text())

    def path(self, name: str) -> Path:
        """A file of the store, brought here if it is not, or not as it is there now.

        In one process a file is asked for once.

        Raises:
            FileNotFoundError: the store has no such file; none is here then.
            StoreError: it cannot be fetched.
        """
        file = self._here(name)
        if name not in self._sure or not file.is_file():
            try:
                self._bring(name, self.store.stat(name))
            except FileNotFoundError:
                file.unlink(missing_ok=True)
                raise
            self._sure.add(name)
        return file

    def renew(self, names: Iterable[str]) -> None:
        """Bring these files as they are in the store now; what it has not is not here either."""
        for name in names:
            self._sure.discard(name)
            try:
                self.path(name)
            except FileNotFoundError:
                continue

    def bring(self, below: str = "") -> Path:
        """All files of the store, or of one folder in it; what went from there, goes here.

        Args:
            below: the folder's name.

        Returns:
            the folder here.

        Raises:
            FileNotFoundError: there is none.
            StoreError: the store cannot be read.
        """
        wanted = self.store.files(below)
        if not wanted:
            raise FileNotFoundError(f"{self.store.url}/{below}".rstrip("/"))
        folder = self.folder / below if below else self.folder
        if folder.is_dir():
            for file in [file for file in folder.rglob("*") if not file.is_dir()]:
                name = file.relative_to(self.folder).as_posix()
                # What is temporary may be on its way here in another process.
                if name not in wanted and name not in (URL, FETCHED) and not is_temporary(file):
                    file.unlink(missing_ok=True)
        total = sum(stored.bytes for stored in wanted.values())
        with tqdm(
            desc=f"{self.store.url}/{below}".rstrip("/"),
            total=total,
            unit="B",
            unit_scale=True,
            delay=1,
            leave=False,
            disable=not sys.stderr.isatty(),
        ) as bar:
            for name, stored in wanted.items():
                self._bring(name, stored)
                self._sure.add(name)
                bar.update(stored.bytes)
        return folder

    def _here(self, name: str) -> Path:
        if name in (URL, FETCHED):
            raise StoreError(f"{name!r} is a name that mirrors keep to themselves; rename it")
        return self.folder / name

    def _bring(self, name: str, stored: Stored) -> None:
        file = self._here(name)
        if self._known is None:
            self._known = self._fetched()
        same = stored.token and self._known.get(name) == stored.token and file.is_file()
        if same and file.stat().st_size == stored.bytes:
            return
        self.store.fetch(name, file)
        self._known[name] = stored.token
        with (self.folder / FETCHED).open("ab") as journal:
            journal.write(json.dumps([name, stored.token]).encode() + b"\n")

    def _fetched(self) -> dict[str, str]:
        """What was fetched, the last time; a torn line was not."""
        try:
            with open_file(self.folder / FETCHED) as file:
                lines = file.read().split(b"\n")[:-1]
        except FileNotFoundError:
            return {}
        tokens = {}
        for line in lines:
            try:
                name, token = json.loads(line)
            except (ValueError, TypeError):
                continue
            tokens[name] = token
        return tokens


def local_folder(place: str) -> Path:
    """A folder to read from: of this machine, or one of a store, all of which is brought here.

    Raises:
        FileNotFoundError: there is no such folder in the store.
        StoreError: the store cannot be read.
    """
    return _brought(place) if is_url(place) else local_path(place).expanduser()


@lru_cache
def _brought(url: str) -> Path:
    """The store is read once by every process."""
    return Mirror(url).bring()
