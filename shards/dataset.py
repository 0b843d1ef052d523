"""A dataset on disk: a folder of shards that knows what it holds."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Iterable, KeysView, Mapping
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from shards import schema
from shards.archive import Shard, ShardError, StoredMember
from shards.card import render_card
from shards.checksum import file_sha256
from shards.croissant import describe
from shards.lock import LOCK, lock_folder
from shards.manifest import (
    DatasetError,
    Entry,
    append_json_line,
    differences,
    read_json_lines,
    read_manifest,
    write_json_lines,
    write_manifest,
)
from shards.splits import SPLITS, Split, split_subjects
from shards.sweep import is_sweep
from storage.atomic import atomic_write, is_temporary, remove_temporary_files
from storage.files import open_file
from storage.mirror import Mirror
from storage.store import StoreError, is_url, local_path

DOCUMENT = "dataset.json"
MANIFEST = "manifest.jsonl"
FAILURES = "failures.jsonl"
CARD = "README.md"
BASE = "base"
"""Link to the dataset that holds what the shards of this one do not."""
SHARDS = "shards"
SUBJECTS = "subjects"

RECORD = "subject.json"
"""The last file that is made of a subject, in its folder: it has them all then."""

_LIST_EVERY = 20.0
"""Seconds between two lists of shards that a store is told, at least; and the next line."""
_LIST_SHARE = 50.0
"""Of the time that telling it takes."""

_BLOCK = "rectoverso"
_DESCRIPTION = (
    "Pixel-aligned front and back RGB-D images of clothed human surfaces: orthographic depth, "
    "normals and colour, a simulated depth sensor, and the parametric body in the same grid."
)
_FAILURE = {"subject", "stage", "reason"}


class DatasetWriter:
    """The dataset that a build fills: made if new, taken up again if it was interrupted.

    One process writes a dataset; workers only write shards to `shard_path`. The folder is locked
    until `close`, the end of a `with` block or the process's own. A shard counts from the moment
    `add` returns. Whatever else lies on the disk is ignored and made again, and so are shards
    made by other versions and those whose surface is missing or was changed since.

    Attributes:
        unplanned: subjects that the manifest listed and that are not to be made any more; their
            shards stay on the disk and belong to no dataset.

    In a store, the folder is a mirror of it. Workers put the shards there themselves; what this
    writes, it puts there too: the list of shards every now and then and at `close`, so that a
    process that is killed forgets the shards of its last seconds, which come again alike.

    Args:
        folder: the dataset's; made if missing.
        config: JSON-ready, all that the bytes of the shards depend on.
        planned: the ids of the subjects to make.
        seed: of the split.
        versions: what makes the shards, name -> version.
        base: the dataset whose shards those of this one refer to, subject by subject; the split
            is its own then. It is linked at `BASE`, and a shard whose base changed, or whose
            `meta.sweep` is not `config`, is made again.
        mirror: of the store that the dataset lies in; `folder` is its own then.

    Raises:
        DatasetError: if the folder holds a dataset of another configuration, or anything else,
            or another writer has it.
        schema.SchemaError: if a subject's id cannot name a file.
    """

    def __init__(
        self,
        folder: Path | str,
        config: Mapping[str, Any],
        planned: Iterable[str],
        seed: int,
        versions: Mapping[str, str],
        base: Dataset | None = None,
        mirror: Mirror | None = None,
    ) -> None:
        self.folder = Path(folder)
        self.base = base
        self.mirror = mirror
        self.config: dict[str, Any] = json.loads(json.dumps(config, allow_nan=False))
        self.versions = dict(versions)
        self.planned = sorted(schema.check_subject_id(subject) for subject in planned)
        for subject, count in Counter(self.planned).items():
            if count > 1:
                raise DatasetError(f"subject {subject!r} is planned {count} times; name each once")
        self.splits = (
            split_subjects(self.planned, seed)
            if base is None
            else {subject: base.manifest[subject].split for subject in self.planned}
        )
        self._seed = seed
        self._entries: dict[str, Entry] = {}
        self._failures: dict[str, dict[str, str]] = {}
        self._unlisted, self._listed_at, self._listing = False, time.monotonic(), 0.0
        self._stored: dict[str, int] | None = None
        self._lock = self._claim_folder()
        try:
            self._take_up()
        except BaseException:
            self._lock.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except StoreError:
            if error is None:  # what ended the block is told, and not what came of it
                raise

    def close(self) -> None:
        """Let other builds have the folder.

        Raises:
            StoreError: the store did not take the list of the last shards.
        """
        try:
            if self._unlisted:
                self._list()
        finally:
            self._lock.close()

    @property
    def place(self) -> str:
        """Where the dataset lies, for people: its folder, or its URL."""
        return str(self.folder) if self.mirror is None else self.mirror.store.url

    @property
    def finished(self) -> KeysView[str]:
        """The subjects whose shards are whole and in the manifest, as it stands at any time."""
        return self._entries.keys()

    def shard_path(self, subject: str) -> Path:
        """Where the subject's shard belongs; its folder exists."""
        return self.folder / self._shard_file(subject)

    def add(
        self,
        subject: str,
        bytes: int,
        sha256: str,
        views: int,
        seconds: float,
        licence: str,
    ) -> None:
        """Enter a finished shard: when this returns, the manifest on the disk has it.

        Args:
            subject: its id, one of those planned.
            bytes: the size, as `archive.write_shard` returned it.
            sha256: the checksum, likewise.
            views: how many it holds, likewise.
            seconds: what it took to make.
            licence: the subject's.
        """
        entry = Entry(
            file=self._shard_file(subject),
            bytes=bytes,
            sha256=sha256,
            views=views,
            subject=subject,
            split=self.splits[subject],
            licence=licence,
            seconds=round(seconds, 3),
            versions=self.versions,
        )
        append_json_line(self.folder / MANIFEST, asdict(entry))
        self._entries[subject] = entry
        self._failures.pop(subject, None)
        self._unlisted = True
        if time.monotonic() - self._listed_at > max(_LIST_EVERY, _LIST_SHARE * self._listing):
            self._list()

    def fail(self, subject: str, stage: str, reason: str) -> None:
        """Set a subject aside, planned or not: what failed, and why, in one line."""
        schema.check_subject_id(subject)
        failure = {"subject": subject, "stage": stage, "reason": reason}
        append_json_line(self.folder / FAILURES, failure)
        self._failures[subject] = failure
        self._unlisted = True

    def lay(self, name: str, data: bytes) -> None:
        """Make or replace a file of the dataset, whole or not at all: `name` is its path there."""
        with atomic_write(self.folder / name) as file:
            file.write(data)
        if self.mirror is not None:
            self.mirror.store.write(name, data)

    def finish(self) -> None:
        """Put everything in order: manifest, failures, dataset.json, the card; no leftovers."""
        write_manifest(self.folder / MANIFEST, self._entries)
        write_json_lines(
            self.folder / FAILURES, (self._failures[name] for name in sorted(self._failures))
        )
        self._list()
        self._write_descriptions()
        for folder in (self.folder, self.folder / SHARDS, self.folder / SUBJECTS):
            if folder.is_dir():
                remove_temporary_files(folder)

    def _list(self) -> None:
        """Tell the store which shards there are, and what failed."""
        if self.mirror is None:
            return
        start = time.monotonic()
        for name in (FAILURES, MANIFEST):
            if (self.folder / name).exists():
                self.mirror.store.put(self.folder / name, name)
        self._unlisted = False
        self._listed_at = time.monotonic()
        self._listing = self._listed_at - start

    def _shard_file(self, subject: str) -> str:
        if subject not in self.splits:
            raise DatasetError(f"subject {subject!r} is not planned")
        return f"{SHARDS}/{subject}.npz"

    def _is_whole(self, entry: Entry) -> bool:
        """Whether the shard, and all files that it was made from, stand as they were entered."""
        if entry.file != self._shard_file(entry.subject) or entry.versions != self.versions:
            return False
        if self._stored is not None:  # which has files whole, and nobody changes them there
            record = f"{SUBJECTS}/{entry.subject}/{RECORD}"
            return self._stored.get(entry.file) == entry.bytes and record in self._stored
        path = self.shard_path(entry.subject)
        try:
            if path.stat().st_size != entry.bytes:
                return False
            shard = Shard(path)
            meta = shard.meta
            schema.check_meta(meta, *schema.check_arrays(shard.members))
            if self.base is not None:
                # Whether that one is sound is for its own dataset to know.
                same = meta["base"]["sha256"] == self.base.manifest[entry.subject].sha256
                return bool(same and meta.get("sweep") == self.config)
            if meta["body"] is not None and not (self.folder / meta["body"]).is_file():
                return False
            files = {meta["mesh"]: meta["mesh_sha256"], **meta.get("files", {})}
            return all(file_sha256(self.folder / f) == sha256 for f, sha256 in files.items())
        except (OSError, ShardError, schema.SchemaError, KeyError):
            return False

    def _claim_folder(self) -> IO[bytes]:
        """The folder's lock; nothing is written into a folder of other things."""
        if self.folder.exists() and not self.folder.is_dir():
            raise DatasetError(f"{self.folder} is a file; choose a folder for the dataset")
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.mirror is not None:
            return self._claim_store(self.mirror)
        if not (self.folder / DOCUMENT).exists() and any(
            path.name != LOCK and not is_temporary(path) for path in self.folder.iterdir()
        ):
            raise DatasetError(
                f"{self.folder} is not empty and holds no {DOCUMENT}; choose a new or empty folder"
            )
        return lock_folder(self.folder)

    def _claim_store(self, mirror: Mirror) -> IO[bytes]:
        """The mirror's lock, and in it what the store's dataset tells of itself."""
        lock = lock_folder(self.folder)
        try:
            files = mirror.store.files()
            if files and DOCUMENT not in files:
                raise DatasetError(
                    f"{mirror.store.url} is not empty and holds no {DOCUMENT}; choose another URL"
                )
            mirror.renew((DOCUMENT, MANIFEST))
            self._stored = {name: stored.bytes for name, stored in files.items()}
        except BaseException:
            lock.close()
            raise
        return lock

    def _take_up(self) -> None:
        """Make the folder, or read what an earlier writer left in it."""
        document = self.folder / DOCUMENT
        started = document.exists() and bool(read_manifest(self.folder / MANIFEST))
        if started:
            self._refuse_other_config(_read_block(self.folder))
        else:
            # First of all files, so that a build killed at any later instant finds its own. One
            # that has no shard yet may still change its mind about the configuration.
            self._write_descriptions()
        (self.folder / SHARDS).mkdir(exist_ok=True)
        if self.base is None:
            (self.folder / SUBJECTS).mkdir(exist_ok=True)
        else:
            self._link_base(self.base)
        listed = read_manifest(self.folder / MANIFEST)
        self.unplanned = sorted(listed.keys() - self.splits.keys())
        self._entries = {
            subject: replace(entry, split=self.splits[subject])
            for subject, entry in listed.items()
            if subject in self.splits and self._is_whole(entry)
        }
        # Every planned subject that is not finished is tried again: its failures are of the past.
        write_json_lines(self.folder / FAILURES, ())
        # A torn last line must go before the next line is appended to it.
        write_manifest(self.folder / MANIFEST, self._entries)

    def _link_base(self, base: Dataset) -> None:
        """A relative link, so that both can be moved together."""
        link = self.folder / BASE
        target = os.path.relpath(base.folder.resolve(), self.folder.resolve())
        if link.is_symlink() and str(link.readlink()) != target:
            link.unlink()
        if not link.is_symlink():
            if link.exists():
                raise DatasetError(f"{link} is no link; move it away, {base.folder} goes there")
            link.symlink_to(target, target_is_directory=True)

    def _refuse_other_config(self, block: Mapping[str, Any]) -> None:
        if block["config_sha256"] == config_sha256(self.config):
            return
        differing = differences(block["config"], self.config)
        raise DatasetError(
            f"{self.folder} holds a dataset of another configuration ({differing}); "
            "choose another folder, restore the configuration, or delete the dataset"
        )

    def _write_descriptions(self) -> None:
        """dataset.json and README.md; they depend on config and shards, not on time or place."""
        members: dict[str, StoredMember] = {}
        lent: tuple[str, ...] = ()
        entries = [self._entries[subject] for subject in sorted(self._entries)]
        if entries:  # all shards of one configuration have the same members
            if self.mirror is not None:
                self.mirror.path(entries[0].file)
            shard = Shard(self.folder / entries[0].file)
            members, lent = shard.members, shard.lent
        splits: dict[Split, list[str]] = {
            name: [e.subject for e in entries if e.split == name] for name in SPLITS
        }
        sha256 = config_sha256(self.config)
        block = {
            "schema_version": schema.SCHEMA_VERSION,
            "config": self.config,
            "config_sha256": sha256,
            "seed": self._seed,
            "versions": self.versions,
            "licences": sorted({entry.licence for entry in entries}),
            "splits": splits,
            "counts": {
                "planned": len(self.planned),
                "subjects": len(entries),
                "failures": len(self._failures),
                "train": len(splits["train"]),
                "test": len(splits["test"]),
                "views": sum(entry.views for entry in entries),
            },
            "totals": {"bytes": sum(entry.bytes for entry in entries)},
        }
        name = f"rectoverso-{sha256[:8]}"
        document = {**describe(name, _DESCRIPTION, entries, members, lent), _BLOCK: block}
        licences = Counter(entry.licence for entry in entries)
        card = render_card(name, _DESCRIPTION, block, licences, members, lent)
        text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
        self.lay(DOCUMENT, text.encode(errors="backslashreplace") + b"\n")
        self.lay(CARD, card.encode(errors="backslashreplace"))


class Dataset:
    """A dataset to read: the shards that its manifest lists.

    Attributes:
        folder: the dataset's.
        manifest: subject -> Entry, in the order of the ids.

    Args:
        folder: where a build wrote it; or its URL in a store, of which a mirror is made, with the
            files that are asked for.

    Raises:
        DatasetError: if the folder holds no dataset, or one of another schema.
        StoreError: if the store cannot be read.
    """

    def __init__(self, folder: Path | str) -> None:
        self._mirror = Mirror(str(folder)) if is_url(folder) else Mirror.of(local_path(folder))
        self.folder = local_path(folder) if self._mirror is None else self._mirror.folder
        if self._mirror is not None:
            self._mirror.renew((DOCUMENT, MANIFEST, FAILURES))
        try:
            self._block = _read_block(self.folder)
        except DatasetError as error:
            if self._mirror is None:
                raise
            url = self._mirror.store.url
            raise DatasetError(str(error).replace(str(self.folder), url)) from None
        entries = read_manifest(self.folder / MANIFEST)
        self.manifest: dict[str, Entry] = {name: entries[name] for name in sorted(entries)}

    def __repr__(self) -> str:
        return f"Dataset({str(self.folder)!r})"

    def __len__(self) -> int:
        """How many subjects it holds."""
        return len(self.manifest)

    @cached_property
    def base(self) -> Dataset:
        """The dataset that holds what the shards of this one do not.

        Raises:
            DatasetError: there is none, or it cannot be read.
        """
        return Dataset(self.folder / BASE)

    @property
    def place(self) -> str:
        """Where it lies, for people: its folder, or its URL."""
        return self.url or str(self.folder)

    @property
    def url(self) -> str | None:
        """Where it lies, if that is a store."""
        return None if self._mirror is None else self._mirror.store.url

    @property
    def config(self) -> dict[str, Any]:
        """What it was built from."""
        config: dict[str, Any] = self._block["config"]
        return config

    @property
    def description(self) -> dict[str, Any]:
        """Schema version, config and its hash, seed, versions, licences, splits, counts, totals."""
        return self._block

    @property
    def failures(self) -> list[dict[str, str]]:
        """The subjects that could not be made: subject, stage, reason.

        Raises:
            DatasetError: at a line that is none of these.
        """
        path = self.folder / FAILURES
        records = read_json_lines(path)
        for number, record in records:
            if set(record) != _FAILURE or not all(isinstance(v, str) for v in record.values()):
                raise DatasetError(
                    f"{path} line {number} is no record of subject, stage and reason; "
                    "remove the line and build again"
                )
        return [record for _, record in records]

    def subjects(self, split: Split | None = None) -> list[str]:
        """The ids, sorted; of one split if named."""
        if split is not None and split not in SPLITS:
            raise DatasetError(f"split {split!r} is unknown; use {' or '.join(SPLITS)}")
        return [name for name, entry in self.manifest.items() if split in (None, entry.split)]

    def shard(self, subject: str) -> Shard:
        """The subject's shard, opened anew.

        Raises:
            DatasetError: if the manifest has no such subject.
            ShardError: if the file is missing or torn.
        """
        return Shard(self.shard_path(subject))

    def shard_path(self, subject: str) -> Path:
        """The subject's file."""
        if subject not in self.manifest:
            raise DatasetError(f"{self.folder} has no finished subject {subject!r}")
        return self._here(self.manifest[subject].file)

    def shards_sha256(self, subjects: Iterable[str]) -> str:
        """SHA-256 in hex of what the manifest says of these subjects' shards, in their order."""
        digest = hashlib.sha256()
        for subject in subjects:
            digest.update(f"{subject} {self.manifest[subject].sha256}\n".encode())
        return digest.hexdigest()

    def path(self, relative: str) -> Path:
        """A file named by the dataset's own files, such as `meta["mesh"]`.

        Raises:
            schema.SchemaError: if the name leads out of the folder.
        """
        return self._here(schema.check_relative_path(relative, str(self.folder)))

    def _here(self, name: str) -> Path:
        """The file; of a store, brought here. Where it is missing, opening it will say so."""
        if self._mirror is not None:
            try:
                return self._mirror.path(name)
            except FileNotFoundError:
                pass
        return self.folder / name


def config_sha256(config: Mapping[str, Any]) -> str:
    """SHA-256 in hex of a configuration, whatever the order of its keys."""
    text = json.dumps(config, sort_keys=True, allow_nan=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _read_block(folder: Path) -> dict[str, Any]:
    path = folder / DOCUMENT
    try:
        with open_file(path) as file:
            block = json.loads(file.read())[_BLOCK]
        version = block["schema_version"]
        missing = [key for key in ("seed", "splits", "counts", "totals") if key not in block]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        if config_sha256(block["config"]) != block["config_sha256"]:
            raise ValueError("its config and config_sha256 disagree")
        if not isinstance(block["config"], dict):
            raise ValueError("its config is no object")
        if not isinstance(block["counts"]["planned"], int):
            raise ValueError("its counts.planned is no number")
        names = [name for split in SPLITS for name in block["splits"][split]]
        if len(block["splits"]) != len(SPLITS) or not all(isinstance(n, str) for n in names):
            raise ValueError("its splits are not train and test")
    except (FileNotFoundError, NotADirectoryError):
        if is_sweep(folder):
            raise DatasetError(
                f"{folder} is a light sweep, a dataset for each power; name one of them"
            ) from None
        raise DatasetError(
            f"{folder} holds no {DOCUMENT}; name a folder that a build has made"
        ) from None
    except OSError as error:
        raise DatasetError(
            f"{path} cannot be opened ({error.strerror}); check its rights"
        ) from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DatasetError(f"{path} is no dataset's ({error}); build the dataset again") from None
    if version != schema.SCHEMA_VERSION:
        raise DatasetError(
            f"{path} has schema {version}, this program reads {schema.SCHEMA_VERSION}; "
            "build the dataset anew or use the program that wrote it"
        )
    result: dict[str, Any] = block
    return result
