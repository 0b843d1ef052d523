"""Pickles of strangers: fitted parameters read, nothing in them run.

A pickle is a program for a stack machine, and two of its instructions call any function of any
module. Here no unpickler runs it. `program` reads its opcodes, by the table of the standard
library's `pickletools`, into lists, tuples and notes of what it wants called; a name that is not
in `calls` ends that. `reader` then makes the values, by the functions in `calls`: all are this
project's own or builtin constructors, and take plain values only.
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from subjects.fits.pickles import tensors, torch_file
from subjects.fits.pickles.content import (
    LARGEST_MB,
    Budget,
    decompressed,
    line,
    member,
    named,
    read_bytes,
)
from subjects.fits.pickles.reader import Reader
from subjects.mesh import MeshError

__all__ = ["LARGEST_MB", "read_json", "read_npy", "read_npz", "read_pickle"]

JSON_VALUES = 1_000_000
"""Most values in a JSON file: each takes up to a hundred times its bytes, a fit a few hundred."""


def read_pickle(path: Path, largest_mb: float = LARGEST_MB) -> Any:
    """The value in a pickle, a joblib file or a torch.save file, whichever `path` holds.

    It is made of None, bool, int, float, complex, str, bytes, list, tuple, dict, set, NumPy
    scalars and arrays alone. Arrays are writable, C-ordered, of native byte order and of class
    np.ndarray: torch tensors too, from whatever device, bfloat16 as float32, and trimesh's
    TrackedArray. An array of objects holds such values. A torch.dtype, torch.device or class
    comes as its name. Python 2's strings are read as Latin-1. A container that is named twice
    comes twice, an array once.

    Args:
        path: the file; what it is, and whether it is compressed by zlib, gzip, bz2 or lzma, is
            told by its content.
        largest_mb: most megabytes (2^20 bytes) that it may hold, and may unpack to.

    Raises:
        MeshError: the file cannot be opened, is damaged, too large or too deep, or asks for
            anything else; one line that names the file and, of a class or function, its name.
    """
    with named(path, "pickle"):
        budget = Budget(largest_mb)
        data = decompressed(read_bytes(path, budget), budget)
        reader = _reader(budget)
        if data.startswith(b"PK\x03\x04"):
            return torch_file.read_zip(data, reader)
        file = io.BytesIO(data)
        value = reader.pickle(file)
        if type(value) is int and value == torch_file.MAGIC:
            file.seek(0)
            return torch_file.read_legacy(file, reader)
        return value


def read_npz(path: Path, largest_mb: float = LARGEST_MB) -> dict[str, np.ndarray]:
    """The arrays of an npz file by name; objects in them as `read_pickle` reads them.

    Args:
        path: the file.
        largest_mb: most megabytes (2^20 bytes) that it may hold, and may unpack to.

    Raises:
        MeshError: as of `read_pickle`; the line names the array too.
    """
    with named(path, "npz file"):
        budget = Budget(largest_mb)
        reader, arrays = _reader(budget), {}
        with zipfile.ZipFile(io.BytesIO(read_bytes(path, budget))) as archive:
            for name in archive.namelist():
                key = name.removesuffix(".npy")
                with named(f"member '{line(key)}'", "array"):
                    arrays[key] = _array(member(archive, name, budget), reader)
        return arrays


def read_npy(path: Path, largest_mb: float = LARGEST_MB) -> np.ndarray:
    """The array of an npy file; objects in it as `read_pickle` reads them.

    A dict that was saved with np.save is the one object of an array of shape ().

    Args:
        path: the file.
        largest_mb: most megabytes (2^20 bytes) that it may hold, and may unpack to.

    Raises:
        MeshError: as of `read_pickle`.
    """
    with named(path, "npy file"):
        budget = Budget(largest_mb)
        return _array(read_bytes(path, budget), _reader(budget))


def read_json(path: Path, largest_mb: float = LARGEST_MB) -> Any:
    """The value in a JSON file.

    Args:
        path: the file.
        largest_mb: most megabytes (2^20 bytes) that it may hold.

    Raises:
        MeshError: the file cannot be opened, is damaged, too large or has over `JSON_VALUES`.
    """
    with named(path, "JSON"):
        data = read_bytes(path, Budget(largest_mb))
        values = sum(data.count(mark) for mark in (b",", b"[", b"{"))
        if values > JSON_VALUES:
            raise MeshError(f"has {values} values, more than {JSON_VALUES}; export it as npz")
        return json.loads(data)


def _reader(budget: Budget) -> Reader:
    return Reader(budget, torch_file.read_legacy)


def _array(data: bytes, reader: Reader) -> np.ndarray:
    """The array of an npy file."""
    file = io.BytesIO(data)
    version = npy.read_magic(file)
    headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    shape, fortran, dtype = headers[version](file)
    if not dtype.hasobject:
        return reader.own(tensors.array(file.read(), dtype.str, shape, "F" if fortran else "C"))
    value = reader.pickle(file)
    if not isinstance(value, np.ndarray) or value.shape != shape:
        raise MeshError("holds another array than it claims; export it again")
    return value
