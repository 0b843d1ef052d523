"""A file's bytes, unpacked, within bounds; and what is wrong with them, in one line."""

from __future__ import annotations

import bz2
import lzma
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from subjects.mesh import MeshError

LARGEST_MB = 512.0
"""Megabytes (2^20 bytes) that a file may hold and may unpack to; SMPL-X's arrays take about 220."""

MOST_OPCODES = 2_000_000
"""Steps of a pickle that are read; a tensor takes about sixty."""

EXPORT = "nothing in it was run. Export the parameters again as npz or JSON"

_DECOMPRESSORS: dict[tuple[bytes, ...], Callable[[], Any]] = {
    (b"\x78", b"\x1f\x8b"): lambda: zlib.decompressobj(wbits=47),
    (b"BZh",): bz2.BZ2Decompressor,
    (b"\xfd7zXZ", b"\x5d\x00\x00"): lambda: lzma.LZMADecompressor(memlimit=2**27),
}
_UNREADABLE = {
    b"\x04\x22\x4d\x18": "is compressed with LZ4",
    b"ZF": "was written by joblib before 0.10",
}


class Budget:
    """What reading one file, with all the pickles in it, may still take.

    Args:
        megabytes: of 2^20 bytes, that the file may hold, and all its values together may take.
    """

    def __init__(self, megabytes: float) -> None:
        self.bytes_left = int(megabytes * 2**20)
        self._opcodes_left = MOST_OPCODES

    def check(self, count: int) -> None:
        """MeshError where `count` bytes are more than are left."""
        if count > self.bytes_left:
            raise MeshError(
                "holds or unpacks to more than it may; "
                "split it, or raise subjects.limits.fit_mb if you trust it"
            )

    def spend(self, count: int) -> None:
        """Take `count` bytes."""
        self.check(count)
        self.bytes_left -= count

    def step(self) -> None:
        """Take an opcode."""
        self._opcodes_left -= 1
        if self._opcodes_left < 0:
            raise MeshError(f"takes over {MOST_OPCODES} steps to read; export it as arrays")


def read_bytes(path: Path, budget: Budget) -> bytes:
    """The content of a file."""
    try:
        if path.exists() and not path.is_file():
            raise OSError("it is no file")
        budget.check(path.stat().st_size)
        return path.read_bytes()
    except OSError as error:
        raise MeshError(
            f"cannot be opened ({error.strerror or error}); check the path and its rights"
        ) from None


def decompressed(data: bytes, budget: Budget) -> bytes:
    """`data` as it was before it was compressed, if it was."""
    for start, fault in _UNREADABLE.items():
        if data.startswith(start):
            raise MeshError(f"{fault}; export the parameters again as npz or JSON")
    for starts, make in _DECOMPRESSORS.items():
        if data.startswith(starts):
            decompressor = make()
            content = decompressor.decompress(data, budget.bytes_left + 1)
            budget.check(len(content))
            if not decompressor.eof:
                raise MeshError("is truncated; copy it again")
            return content
    return data


def member(archive: zipfile.ZipFile, name: str, budget: Budget) -> bytes:
    """The content of a zip file's member."""
    info = archive.getinfo(name)
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise MeshError("is compressed otherwise than by deflate; export it again")
    budget.check(info.file_size)
    with archive.open(info) as file:
        return exactly(file, info.file_size)


def exactly(file: Any, size: int) -> bytes:
    """The next `size` bytes of `file`."""
    data = file.read(size)
    if len(data) != size:
        raise MeshError(f"is truncated or no pickle ({len(data)} of {size} bytes); copy it again")
    return data


def expected(value: Any, kind: Any) -> Any:
    """`value`; MeshError where it is no instance of `kind`."""
    if not isinstance(value, kind):
        raise MeshError(f"has a {type(value).__name__} where there can be none; export it again")
    return value


@contextmanager
def named(what: object, kind: str) -> Iterator[None]:
    """Within, every error becomes a MeshError that names `what`; odd bytes warn of nothing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MeshError as error:
        raise MeshError(f"{what}: {error}") from None
    except Exception as error:  # damage shows in too many ways to list
        reason = line(str(error)) or type(error).__name__
        raise MeshError(
            f"{what}: is truncated or no {kind} ({reason}); copy or export it again"
        ) from error


def line(text: str) -> str:
    """A stranger's text, short and printable."""
    return ascii(" ".join(text[:200].split()))[1:-1][:120]
