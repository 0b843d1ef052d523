"""One shard on disk: an npz whose members can be mapped into memory.

The file is an ordinary npz: `np.load(path)` reads it without pickle. Beyond numpy's own writer,
the data of every stored member start at a multiple of 64 bytes, bytes depend on the content
only, and the file appears whole or not at all.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import mmap
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np

from shards import schema
from storage.atomic import atomic_write
from storage.files import open_file

Compression = Literal["stored", "deflate"]

UNPACKED_LIMIT = 2**32
"""Bytes that the deflated members of a shard may unpack to, over 400 views of 424 x 512 pixels: a
file of megabytes can claim any number. Stored members are as large as their file says."""

META_LIMIT = 2**26
"""Bytes of `meta`, which every opening reads: thousands of views take one of them."""

_ALIGNMENT = 64
_LOCAL_HEADER = struct.Struct("<4s22xHH")  # signature, length of the name, length of the extra
_EXTRA_HEADER = struct.Struct("<HHH")  # id, size, alignment: the field that zipalign defined
_ALIGNMENT_ID = 0xD935
_ZIP64_EXTRA = 20  # bytes that zipfile appends to a local header that needs 64-bit sizes
_METHODS = {"stored": zipfile.ZIP_STORED, "deflate": zipfile.ZIP_DEFLATED}


class ShardError(ValueError):
    """A file that is no whole shard; one line that names the file."""


class Written(NamedTuple):
    """A shard that stands on disk, as the manifest tells of it.

    Attributes:
        bytes: the file's size.
        sha256: of the file, hex.
        views: V.
    """

    bytes: int
    sha256: str
    views: int


def write_shard(
    path: Path,
    arrays: Mapping[str, np.ndarray],
    meta: Mapping[str, Any],
    compression: Compression = "stored",
    base: Shard | None = None,
) -> Written:
    """Write one shard, whole or not at all.

    Args:
        path: the npz to make; its folder exists.
        arrays: every member but `meta`, as `schema.MEMBERS` has them.
        meta: JSON-ready, as `schema.check_meta` wants it.
        compression: "stored" to be mapped into memory, "deflate" to be passed on.
        base: the shard that `meta["base"]` names; members that are not given are its own.

    Raises:
        schema.SchemaError: if arrays or meta break the contract; nothing is written then.
    """
    if compression not in _METHODS:
        raise ValueError(f"compression {compression!r} is unknown; use {' or '.join(_METHODS)}")
    if (base is None) != ("base" not in meta):
        raise schema.SchemaError("meta.base and a base shard come together, but one is missing")
    size = schema.check_arrays(arrays if base is None else {**base.members, **arrays})
    try:
        text = json.dumps(meta, sort_keys=True, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise schema.SchemaError(f"meta cannot be written as JSON: {error}") from None
    schema.check_meta(json.loads(text), *size)
    members = {name: arrays[name] for name in schema.MEMBERS if name in arrays}
    members[schema.META] = np.array(text, dtype=f"<U{len(text)}")
    with atomic_write(Path(path)) as file:
        with zipfile.ZipFile(file, "w") as archive:
            for name, array in members.items():
                _write_member(archive, file, name, array, _METHODS[compression])
        length = file.tell()
        file.seek(0)
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Written(length, digest, size[0])


def _write_member(
    archive: zipfile.ZipFile, file: IO[bytes], name: str, array: np.ndarray, method: int
) -> None:
    info = zipfile.ZipInfo(f"{name}.npy")  # dated 1980: bytes must not depend on the clock
    info.create_system = 3
    info.external_attr = 0o644 << 16
    info.compress_type = method
    header = io.BytesIO()
    array = np.ascontiguousarray(array).reshape(array.shape)  # ascontiguousarray makes () into (1,)
    np.lib.format.write_array_header_1_0(header, np.lib.format.header_data_from_array_1_0(array))
    info.file_size = len(header.getvalue()) + array.nbytes
    zip64 = info.file_size * 1.05 > zipfile.ZIP64_LIMIT  # zipfile's own rule, made explicit
    if method == zipfile.ZIP_STORED:
        start = file.tell() + _LOCAL_HEADER.size + len(info.filename) + _EXTRA_HEADER.size
        padding = -(start + (_ZIP64_EXTRA if zip64 else 0)) % _ALIGNMENT
        info.extra = _EXTRA_HEADER.pack(_ALIGNMENT_ID, 2 + padding, _ALIGNMENT) + bytes(padding)
    with archive.open(info, "w", force_zip64=zip64) as member:
        member.write(header.getvalue())
        member.write(array.reshape(-1).view(np.uint8).data)


@dataclass(frozen=True)
class StoredMember:
    """Where one member lies in the file; it has a shape and a type without being read.

    Attributes:
        offset: first byte of the array in the file, or None where it is deflated.
        shape: the array's.
        dtype: the array's.
    """

    offset: int | None
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def count(self) -> int:
        """How many numbers it holds."""
        return math.prod(self.shape)

    @property
    def bytes(self) -> int:
        """How many bytes they take."""
        return self.count * self.dtype.itemsize


class Shard:
    """A shard to read: `shard["depth_front"]` is the member's array, `shard.view(i)` one view.

    Opening reads the directory and the meta data; no file stays open. `view` opens the file for
    its own time only, so shards can be pickled, forked and kept by the thousand. The first
    `shard[name]` maps the file, which holds one descriptor until `close`.

    A shard may name another as its base and hold only what differs, such as colours under another
    light: it reads as one shard with all members.

    Attributes:
        path: the file; of one with a base, DATASET/shards/SUBJECT.npz.
        members: name -> StoredMember, `meta` left out, in the file's order, the base's first.
        meta: the meta data.
        base: the shard that holds the members that this file does not, or None.
        contents: SHA-256 of what its directory lists: names, sizes and checksums (CRC-32) of all
            members, which no other shard shares; told without reading them.

    Args:
        path: the npz.
        alone: refuse a shard that has a base.

    Raises:
        ShardError: if the file is missing, torn, no npz, or holds Python objects, or if its base
            is, or is another than the one that it was made for.
    """

    def __init__(self, path: Path | str, *, alone: bool = False) -> None:
        self.path = Path(path)
        self._map: mmap.mmap | None = None
        with _errors_named(self.path), open_file(self.path) as file:
            self.members, self.contents = _read_directory(file)
            if schema.META not in self.members:
                raise ValueError("it has no member 'meta'")
            if self.members[schema.META].dtype.kind != "U":
                raise ValueError("member 'meta' is no text")
            if self.members[schema.META].bytes > META_LIMIT:
                raise ValueError(f"member 'meta' has over {META_LIMIT} bytes")
            text = str(_read_whole(file, schema.META))
            self.meta: dict[str, Any] = json.loads(text, parse_constant=_refuse_constant)
            if not isinstance(self.meta, dict):
                raise ValueError("member 'meta' is no JSON object")
        del self.members[schema.META]
        self.base: Shard | None = None
        self._own = frozenset(self.members)
        if "base" in self.meta:
            self.base = self._open_base(self.meta["base"], alone)
            self.members = {**self.base.members, **self.members}

    def _open_base(self, named: Any, alone: bool) -> Shard:
        try:
            schema.check_base(named)
        except schema.SchemaError as error:
            raise ShardError(f"{self.path}: {error}; build it again") from None
        if alone:
            raise ShardError(f"{self.path} has a base itself; take that one as the base")
        # Files that a shard names lie below the dataset that holds it.
        path = self.path.parent.parent / named["shard"]
        if not path.is_file():
            raise ShardError(
                f"{path} is missing, and {self.path} lacks what it holds; "
                "bring that dataset back, or link it there anew"
            )
        base = Shard(path, alone=True)
        if base.contents != named["contents"]:
            raise ShardError(
                f"{path} holds other maps than {self.path} was made for; run the sweep again"
            )
        return base

    def __repr__(self) -> str:
        return f"Shard({str(self.path)!r})"

    def __len__(self) -> int:
        """How many views V it holds."""
        return self._member("mask").shape[0]

    def __contains__(self, name: object) -> bool:
        return name in self.members

    @property
    def names(self) -> tuple[str, ...]:
        """The members it holds, `meta` left out."""
        return tuple(self.members)

    @property
    def lent(self) -> tuple[str, ...]:
        """The members among them that its base holds."""
        return tuple(name for name in self.members if name not in self._own)

    def __getitem__(self, name: str) -> np.ndarray:
        """The whole member, read-only: a memory map where stored, read where deflated."""
        member = self._member(name)
        if self.base is not None and name not in self._own:
            return self.base[name]
        with _errors_named(self.path):
            if member.offset is None:
                with open_file(self.path) as file:
                    array = _read_whole(file, name)
                array.flags.writeable = False
                return array
            if self._map is None:
                with open_file(self.path) as file:
                    self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            flat = np.frombuffer(self._map, member.dtype, member.count, member.offset)
            return flat.reshape(member.shape)

    def view(self, index: int, names: Iterable[str] | None = None) -> dict[str, np.ndarray]:
        """One view's arrays, copied out of the file.

        Args:
            index: 0 to V - 1.
            names: the members wanted; all by default.

        Returns:
            name -> array without the leading axis of views.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"{self.path}: view {index} is not among 0 to {len(self) - 1}")
        wanted = {name: self._member(name) for name in (self.names if names is None else names)}
        lent = {}
        if self.base is not None:
            lent = self.base.view(index, [name for name in wanted if name not in self._own])
        with _errors_named(self.path), self.path.open("rb", buffering=0) as file:
            own = {
                name: _read_whole(file, name)[index].copy()
                if member.offset is None
                else _read_view(file, member, index)
                for name, member in wanted.items()
                if name not in lent
            }
        return {name: lent[name] if name in lent else own[name] for name in wanted}

    def close(self) -> None:
        """Forget the map; arrays already handed out stay good."""
        self._map = None
        if self.base is not None:
            self.base.close()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_map": None}

    def _member(self, name: str) -> StoredMember:
        try:
            return self.members[name]
        except KeyError:
            known = ", ".join(self.members)
            raise KeyError(f"{self.path} has no member {name!r}; it has {known}") from None


_BROKEN = (
    *(ValueError, KeyError, EOFError, OSError, NotImplementedError, OverflowError, RecursionError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
    # numpy parses a header as Python text, and allocates what it says
    *(TypeError, SyntaxError, tokenize.TokenError, MemoryError),
)
"""What zipfile, zlib, json and numpy raise at torn or foreign bytes."""


@contextmanager
def _errors_named(path: Path) -> Iterator[None]:
    """Turn whatever a broken file provokes into one ShardError that names the file."""
    try:
        yield
    except FileNotFoundError:
        raise ShardError(f"{path} is missing; run the build again") from None
    except _BROKEN as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ShardError(f"{path} is no whole shard: {reason}; build it again") from None


def _refuse_constant(name: str) -> None:
    raise ValueError(f"member 'meta' holds {name}, which is no finite number")


def _read_directory(file: IO[bytes]) -> tuple[dict[str, StoredMember], str]:
    """Where the members lie, and the hash of what the directory says of their contents."""
    contents = hashlib.sha256()
    end = file.seek(0, io.SEEK_END)
    members: dict[str, StoredMember] = {}
    unpacked = 0
    with zipfile.ZipFile(file) as archive:
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            if name == info.filename or name in members:
                raise ValueError(f"{info.filename!r} does not belong into an npz")
            with archive.open(info) as stream:
                shape, dtype = _read_array_header(name, stream)
                header = stream.tell()
            member = StoredMember(None, shape, dtype)
            if header + member.bytes != info.file_size or min(shape, default=0) < 0:
                raise ValueError(f"member {name!r} is {info.file_size} bytes, its header says else")
            if info.compress_type == zipfile.ZIP_STORED:
                file.seek(info.header_offset)
                _, name_length, extra_length = _LOCAL_HEADER.unpack(file.read(_LOCAL_HEADER.size))
                # The directory's own extra field may differ in length: only this one counts.
                offset = file.tell() + name_length + extra_length + header
                if offset + member.bytes > end:
                    raise ValueError(f"member {name!r} reaches past the file's end")
                member = replace(member, offset=offset)
            else:
                unpacked += member.bytes
                if unpacked > UNPACKED_LIMIT:
                    raise ValueError(f"its members unpack to over {UNPACKED_LIMIT} bytes")
            members[name] = member
            contents.update(f"{name} {info.file_size} {info.CRC}\n".encode())
    return members, contents.hexdigest()


def _read_array_header(name: str, stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, fortran, dtype = np.lib.format.read_array_header_2_0(stream)
    else:
        raise ValueError(f"member {name!r} is of npy version {version}")
    if dtype.hasobject:
        raise ValueError(f"member {name!r} holds Python objects, which are never read")
    if fortran:
        raise ValueError(f"member {name!r} is in Fortran order")
    return shape, dtype


def _read_view(file: io.RawIOBase, member: StoredMember, index: int) -> np.ndarray:
    view = np.empty(member.shape[1:], member.dtype)
    file.seek((member.offset or 0) + index * view.nbytes)
    # Straight into the array: as fast as copying out of a map, and a file that was cut short
    # meanwhile is an error here, where a map would end the process.
    rest = view.reshape(-1).view(np.uint8).data
    while rest:
        count = file.readinto(rest)
        if not count:
            raise EOFError("it ends too early")
        rest = rest[count:]
    return view


def _read_whole(file: IO[bytes] | io.RawIOBase, name: str) -> np.ndarray:
    with zipfile.ZipFile(file) as archive, archive.open(f"{name}.npy") as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)
