"""The files of torch.save: a pickle, and beside it the elements of its tensors' storages."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from subjects.fits.pickles import tensors
from subjects.fits.pickles.content import EXPORT, exactly, line, member
from subjects.fits.pickles.program import Call
from subjects.fits.pickles.reader import Reader
from subjects.mesh import MeshError

MAGIC = 0x1950A86A20F9469CFC6C
"""The first pickle of the older format."""

_VERSION = 1001


class _Storage(NamedTuple):
    """A storage that a pickle names and that lies outside it."""

    kind: str
    key: str
    numel: int
    view: tuple | None

    @property
    def width(self) -> int:
        """Bytes per element."""
        return np.dtype(tensors.STORAGE_TYPES[self.kind]).itemsize

    def elements(self, data: bytes) -> np.ndarray:
        """What the pickle means of the storage's `data`."""
        elements = tensors.storage(self.kind, data, self.numel)
        if self.view is None:
            return elements
        _, offset, count = self.view
        return tensors.tensor(elements, offset, (count,), (1,))


def read_zip(data: bytes, reader: Reader) -> Any:
    """The value of torch's format: a zip of data.pkl and of each storage in data/KEY."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        content = partial(member, archive, budget=reader.budget)
        pickles = [name for name in archive.namelist() if f"/{name}".endswith("/data.pkl")]
        if len(pickles) != 1:
            raise MeshError("is a zip file, but none of torch.save; export it as npz or JSON")
        folder = pickles[0].removesuffix("data.pkl")
        order = f"{folder}byteorder"
        if order in archive.namelist() and content(order) != b"little":
            raise MeshError("was written on a big-endian machine; export it as npz or JSON")
        tree, outside = reader.parse(io.BytesIO(content(pickles[0])))
        storages = [_storage(call, reader) for call in outside]
        _fill(outside, storages, lambda key: content(f"{folder}data/{key}"), reader)
    return reader.value(tree)


def read_legacy(file: BinaryIO, reader: Reader, depth: int = 0) -> Any:
    """The value of torch's older format: five pickles, then the storages' elements."""
    magic, version, _machine = (reader.pickle(file, depth) for _ in range(3))
    if (magic, version) != (MAGIC, _VERSION):
        raise MeshError("has a torch tensor of an unknown format; export it as npz or JSON")
    tree, outside = reader.parse(file)
    storages = [_storage(call, reader, depth) for call in outside]
    width = {storage.key: storage.width for storage in storages}
    contents: dict[str, bytes] = {}
    for key in reader.pickle(file, depth):
        (numel,) = struct.unpack("<q", exactly(file, 8))
        contents[key] = exactly(file, numel * width[key])
    _fill(outside, storages, contents.__getitem__, reader)
    return reader.value(tree, depth)


def _storage(call: Call, reader: Reader, depth: int = 0) -> _Storage:
    what, kind, key, _device, numel, *view = reader.value(call.arguments, depth)
    if what != "storage" or kind not in tensors.STORAGE_TYPES:
        raise MeshError(f"asks for {line(f'{what} {kind}')}, which is no storage; {EXPORT}")
    return _Storage(kind, key, numel, view[0] if view else None)


def _fill(
    outside: list[Call],
    storages: list[_Storage],
    content: Callable[[str], bytes],
    reader: Reader,
) -> None:
    """Give each call the elements of its storage; tensors of one storage share them."""
    owned: dict[_Storage, np.ndarray] = {}
    for call, storage in zip(outside, storages, strict=True):
        if storage not in owned:
            owned[storage] = reader.own(storage.elements(content(storage.key)))
        call.value = owned[storage]
