"""Pickles of strangers: fitted parameters read, nothing in them run.

A pickle is a program for a stack machine, and two of its instructions call any function of any
module. Here no unpickler runs it. `_Reader._parse` reads its opcodes, by the table of the standard
library's `pickletools`, into lists, tuples and notes of what it wants called; a name that is not
in `_CALLS` or `_NAMES` ends that. `_Reader._value` then makes the values, by the functions in
`_CALLS`: all are this project's own or builtin constructors, and take plain values only.
"""

from __future__ import annotations

import bz2
import codecs
import io
import lzma
import pickletools
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy

from subjects.fits import tensors
from subjects.mesh import MeshError

LARGEST_MB = 512.0
"""Megabytes (2^20 bytes) that a file may hold and may unpack to; SMPL-X's arrays take about 220."""

MOST_OPCODES = 2_000_000
"""Steps of a pickle that are read; a tensor takes about sixty."""

DEEPEST = 64
"""Levels that containers may nest; also what ends one that holds itself."""

ITEM_BYTES = 256
"""What an item of a container counts for in memory."""

KEYS = (str, bytes, int, float, np.generic, type(None))
"""What a dict's keys and a set's items may be: what takes a moment to hash."""


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
    with _named(path, "pickle"):
        most = _bytes(largest_mb)
        data = _decompressed(_content(path, most), most)
        reader = _Reader(most)
        if data.startswith(b"PK\x03\x04"):
            return reader.torch_zip(data)
        return reader.pickle_or_torch(io.BytesIO(data))


def read_npz(path: Path, largest_mb: float = LARGEST_MB) -> dict[str, np.ndarray]:
    """The arrays of an npz file by name; objects in them as `read_pickle` reads them.

    Args:
        path: the file.
        largest_mb: most megabytes (2^20 bytes) that it may hold, and may unpack to.

    Raises:
        MeshError: as of `read_pickle`; the line names the array too.
    """
    with _named(path, "npz file"):
        most = _bytes(largest_mb)
        reader, arrays = _Reader(most), {}
        with zipfile.ZipFile(io.BytesIO(_content(path, most))) as archive:
            for name in archive.namelist():
                key = name.removesuffix(".npy")
                with _named(f"member '{_line(key)}'", "array"):
                    arrays[key] = reader.npy(reader.member(archive, name))
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
    with _named(path, "npy file"):
        most = _bytes(largest_mb)
        return _Reader(most).npy(_content(path, most))


class _Name(str):
    """The dotted name of a class or function. It is never looked up."""

    __slots__ = ()


@dataclass(eq=False, slots=True)
class _Call:
    """What a pickle wants made: noted, not made.

    Attributes:
        name: a key of `_CALLS`.
        arguments: what it is to be called with.
        state: what it is to be told afterwards.
        items: what is to be put into it afterwards.
        value: the array, once there is one.
    """

    name: str
    arguments: Any
    state: Any = None
    items: list[Any] = field(default_factory=list)
    value: np.ndarray | None = None


class _Stored(NamedTuple):
    """A torch storage that a pickle names and that lies outside it."""

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


class _Reader:
    """Reads the pickles of one file, within bounds that they share.

    Args:
        most: bytes that all their values together may take.
    """

    def __init__(self, most: int) -> None:
        self._bytes_left = most
        self._opcodes_left = MOST_OPCODES

    def pickle_or_torch(self, file: BinaryIO) -> Any:
        """The value of a pickle, of joblib's, or of torch's older format."""
        value = self._pickle(file)
        if type(value) is int and value == _TORCH_MAGIC:
            file.seek(0)
            return self._torch_legacy(file)
        return value

    def torch_zip(self, data: bytes) -> Any:
        """The value of torch's format: a zip of data.pkl and of each storage in data/KEY."""
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            pickles = [name for name in archive.namelist() if f"/{name}".endswith("/data.pkl")]
            if len(pickles) != 1:
                raise MeshError("is a zip file, but none of torch.save; export it as npz or JSON")
            folder = pickles[0].removesuffix("data.pkl")
            order = f"{folder}byteorder"
            if order in archive.namelist() and self.member(archive, order) != b"little":
                raise MeshError("was written on a big-endian machine; export it as npz or JSON")
            tree, outside = self._parse(io.BytesIO(self.member(archive, pickles[0])))
            named = [(call, self._stored(call)) for call in outside]
            self._fill(named, lambda key: self.member(archive, f"{folder}data/{key}"))
        return self._value(tree)

    def npy(self, data: bytes) -> np.ndarray:
        """The array of an npy file."""
        file = io.BytesIO(data)
        version = npy.read_magic(file)
        headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
        shape, fortran, dtype = headers[version](file)
        if not dtype.hasobject:
            return self._own(tensors.array(file.read(), dtype.str, shape, "F" if fortran else "C"))
        value = self._pickle(file)
        if not isinstance(value, np.ndarray) or value.shape != shape:
            raise MeshError("holds another array than it claims; export it again")
        return value

    def member(self, archive: zipfile.ZipFile, name: str) -> bytes:
        """The content of a zip file's member."""
        info = archive.getinfo(name)
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise MeshError("is compressed otherwise than by deflate; export it again")
        if info.file_size > self._bytes_left:
            raise _too_large()
        with archive.open(info) as file:
            return _exactly(file, info.file_size)

    def _pickle(self, file: BinaryIO, depth: int = 0) -> Any:
        """The value of the pickle that starts where `file` is; it is left behind its end."""
        tree, outside = self._parse(file)
        if outside:
            key = outside[0].arguments
            told = f" '{_line(key)}'" if isinstance(key, str) else ""
            raise MeshError(f"asks for an object outside itself (persistent id{told}); {_EXPORT}")
        return self._value(tree, depth)

    def _torch_legacy(self, file: BinaryIO, depth: int = 0) -> Any:
        """The value of torch's older format: five pickles, then the storages' elements."""
        magic, version, _machine = (self._pickle(file, depth) for _ in range(3))
        if (magic, version) != (_TORCH_MAGIC, _TORCH_VERSION):
            raise MeshError("has a torch tensor of an unknown format; export it as npz or JSON")
        tree, outside = self._parse(file)
        named = [(call, self._stored(call, depth)) for call in outside]
        width = {stored.key: stored.width for _, stored in named}
        contents: dict[str, bytes] = {}
        for key in self._pickle(file, depth):
            (numel,) = struct.unpack("<q", _exactly(file, 8))
            contents[key] = _exactly(file, numel * width[key])
        self._fill(named, contents.__getitem__)
        return self._value(tree, depth)

    def _stored(self, call: _Call, depth: int = 0) -> _Stored:
        what, kind, key, _device, numel, *view = self._value(call.arguments, depth)
        if what != "storage" or kind not in tensors.STORAGE_TYPES:
            raise MeshError(f"asks for {_line(f'{what} {kind}')}, which is no storage; {_EXPORT}")
        return _Stored(kind, key, numel, view[0] if view else None)

    def _fill(self, named: list[tuple[_Call, _Stored]], content: Callable[[str], bytes]) -> None:
        """Give each call the elements of its storage; tensors of one storage share them."""
        owned: dict[_Stored, np.ndarray] = {}
        for call, stored in named:
            if stored not in owned:
                owned[stored] = self._own(stored.elements(content(stored.key)))
            call.value = owned[stored]

    def _joblib_array(self, file: BinaryIO, wrapper: dict[str, Any]) -> np.ndarray:
        """An array whose bytes joblib has put into the midst of the pickle, after `wrapper`."""
        code, shape = wrapper["dtype"], wrapper["shape"]
        if tensors.is_object(code):
            return self._pickle(file)
        if wrapper.get("numpy_array_alignment_bytes") is not None:
            _exactly(file, _exactly(file, 1)[0])
        data = _exactly(file, tensors.byte_count(code, shape))
        return self._own(tensors.array(data, code, shape, wrapper["order"]))

    def _parse(self, file: BinaryIO) -> tuple[Any, list[_Call]]:
        """What the pickle at `file` describes, and what of it has a persistent id. Calls nothing.

        The tree is made of lists, tuples, `_Call`s, `_Name`s and immutable values; it may hold
        itself.
        """
        stack: list[Any] = []
        marks: list[int] = []
        memo: dict[int, Any] = {}
        outside: list[_Call] = []

        def popped() -> list[Any]:
            """The items above the last mark."""
            start = marks.pop()
            items = stack[start:]
            del stack[start:]
            return items

        while True:
            opcode, argument = self._opcode(file)
            match opcode:
                case "PROTO" | "FRAME":
                    pass
                case "STOP":
                    return stack.pop(), outside

                case "MARK":
                    marks.append(len(stack))
                case "POP":
                    stack.pop()
                case "POP_MARK":
                    popped()
                case "DUP":
                    stack.append(stack[-1])
                case "MEMOIZE":
                    memo[len(memo)] = stack[-1]
                case "PUT" | "BINPUT" | "LONG_BINPUT":
                    memo[argument] = stack[-1]
                case "GET" | "BINGET" | "LONG_BINGET":
                    stack.append(memo[argument])

                case "NONE" | "NEWTRUE" | "NEWFALSE":
                    stack.append({"NEWTRUE": True, "NEWFALSE": False}.get(opcode))
                case "EMPTY_TUPLE":
                    stack.append(())
                case "EMPTY_LIST":
                    stack.append([])
                case "EMPTY_DICT":
                    stack.append(_Call("builtins.dict", ()))
                case "EMPTY_SET":
                    stack.append(_Call("builtins.set", ()))
                case "TUPLE1" | "TUPLE2" | "TUPLE3":
                    marks.append(len(stack) - int(opcode[-1]))
                    stack.append(tuple(popped()))
                case "TUPLE":
                    stack.append(tuple(popped()))
                case "LIST":
                    stack.append(popped())
                case "DICT":
                    stack.append(_Call("builtins.dict", (), items=popped()))
                case "FROZENSET":
                    stack.append(_Call("builtins.set", (), items=popped()))

                case "APPEND" | "APPENDS":
                    items = popped() if opcode == "APPENDS" else [stack.pop()]
                    _expected(stack[-1], list).extend(items)
                case "SETITEM" | "SETITEMS" | "ADDITEMS":
                    if opcode == "SETITEM":
                        marks.append(len(stack) - 2)
                    items = popped()
                    _expected(stack[-1], _Call).items.extend(items)

                case "GLOBAL" | "INST" | "STACK_GLOBAL":
                    if opcode == "STACK_GLOBAL":
                        name, module = (_expected(stack.pop(), str) for _ in range(2))
                        argument = f"{module}.{name}"
                    stack.append(_admitted(argument.replace(" ", ".")))
                    if opcode == "INST":
                        stack.append(_call(stack.pop(), tuple(popped())))
                case "REDUCE" | "NEWOBJ":
                    arguments = stack.pop()
                    stack.append(_call(stack.pop(), arguments))
                case "OBJ":
                    name, *arguments = popped()
                    stack.append(_call(name, tuple(arguments)))
                case "BUILD":
                    state = stack.pop()
                    call = _expected(stack[-1], _Call)
                    call.state = state
                    if call.name == _JOBLIB_ARRAY:
                        call.value = self._joblib_array(file, self._value(state))
                case "PERSID" | "BINPERSID":
                    outside.append(_Call("", argument or stack.pop()))
                    stack.append(outside[-1])

                case _ if opcode in _VALUES:
                    stack.append(bytes(argument) if opcode == "BYTEARRAY8" else argument)
                case _:
                    raise MeshError(f"uses the opcode {opcode}, which no array needs; {_EXPORT}")

    def _opcode(self, file: BinaryIO) -> tuple[str, Any]:
        """The next opcode's name and argument."""
        self._opcodes_left -= 1
        if self._opcodes_left < 0:
            raise MeshError(f"takes over {MOST_OPCODES} steps to read; export it as arrays")
        opcode = _OPCODES[_exactly(file, 1)]
        if opcode.name == "STRING":  # Python 2's, of bytes that need not be ASCII
            quoted = pickletools.read_stringnl(file, decode=False)
            return "STRING", codecs.escape_decode(quoted)[0].decode("latin-1")
        return opcode.name, opcode.arg and opcode.arg.reader(file)

    def _value(self, tree: Any, depth: int = 0) -> Any:
        """The plain value that a tree of `_parse` describes."""
        if depth > DEEPEST:
            raise MeshError(f"nests over {DEEPEST} levels deep or holds itself; export it flat")
        if isinstance(tree, list | tuple):
            self._spend(ITEM_BYTES * (1 + len(tree)))
            return type(tree)([self._value(item, depth + 1) for item in tree])
        if not isinstance(tree, _Call):
            return str(tree) if isinstance(tree, _Name) else tree
        if tree.value is not None:
            return tree.value
        value = self._called(tree, depth + 1)
        if isinstance(value, np.ndarray):
            value = tree.value = self._own(value)
        else:
            is_text = isinstance(value, bytes | str)
            self._spend(len(value) if is_text else getattr(value, "nbytes", 0))
        return value

    def _called(self, call: _Call, depth: int) -> Any:
        arguments = self._value(call.arguments, depth)
        if call.name == _TORCH_BYTES:
            (data,) = arguments
            return self._torch_legacy(io.BytesIO(_expected(data, bytes)), depth)
        told = {"state": call.state} if call.state is not None else {}
        told |= {"items": call.items} if call.items else {}
        told = {name: self._value(tree, depth) for name, tree in told.items()}
        return _CALLS[call.name](*arguments, **told)

    def _own(self, view: np.ndarray) -> np.ndarray:
        """A copy that may be written to, in native byte order."""
        self._spend(view.nbytes)
        return view.astype(view.dtype.newbyteorder("="), order="C")

    def _spend(self, count: int) -> None:
        if count > self._bytes_left:
            raise _too_large()
        self._bytes_left -= count


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """_codecs.encode, by which protocols below 3 write bytes."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1", "utf-8", "utf8"):
        raise MeshError(f"asks for _codecs.encode otherwise than to bytes; {_EXPORT}")
    return text.encode(encoding)


def _to_bytes(data: bytes | str = b"", *encoding: str) -> bytes:
    """bytes and bytearray, of bytes or text alone."""
    return _encode(data, *encoding) if isinstance(data, str) else _expected(data, bytes)


def _dict(pairs: Any = (), *, items: Any = ()) -> dict:
    """dict and OrderedDict.

    Args:
        pairs: keys with values.
        items: keys and values in turn.
    """
    items = [part for key, value in _tuple(pairs) for part in (key, value)] + list(items)
    keys, values = (_expected(key, KEYS) for key in items[::2]), items[1::2]
    return dict(zip(keys, values, strict=True))


def _set(members: Any = (), *, items: Any = ()) -> set:
    """set and frozenset."""
    return {_expected(item, KEYS) for item in (*_tuple(members), *items)}


def _tuple(members: Any) -> tuple:
    """torch.Size; never of an array or of bytes, whose items take more memory one by one."""
    return tuple(_expected(members, (list, tuple)))


_JOBLIB_ARRAY = "joblib.numpy_pickle.NumpyArrayWrapper"
_TORCH_BYTES = "torch.storage._load_from_bytes"
_TORCH_MAGIC = 0x1950A86A20F9469CFC6C
_TORCH_VERSION = 1001

# What a pickle may have made, by names as `_admitted` writes them. These functions are all that
# is ever called for it.
_CALLS: dict[str, Callable[..., Any]] = {
    "_codecs.encode": _encode,
    "builtins.bytes": _to_bytes,
    "builtins.bytearray": _to_bytes,
    "builtins.complex": complex,
    "builtins.dict": _dict,
    "builtins.set": _set,
    "builtins.frozenset": _set,
    "collections.OrderedDict": _dict,
    "numpy.dtype": tensors.element_type,
    "numpy.core.multiarray._reconstruct": tensors.reconstruct,
    "numpy.core.multiarray.scalar": tensors.scalar,
    "numpy.core.numeric._frombuffer": tensors.array,
    "torch._utils._rebuild_tensor": tensors.tensor,
    "torch._utils._rebuild_tensor_v2": tensors.tensor,
    "torch._utils._rebuild_parameter": tensors.parameter,
    "torch.Size": _tuple,
    "torch.device": tensors.device,
}

# What a pickle may name besides: classes, which stay names, and what `_Reader` itself makes.
_NAMES = tensors.ARRAY_TYPES | tensors.TENSOR_TYPES | set(tensors.STORAGE_TYPES)
_MADE_HERE = frozenset([_JOBLIB_ARRAY, _TORCH_BYTES])

_OPCODES = {opcode.code.encode("latin-1"): opcode for opcode in pickletools.opcodes}
_VALUES = frozenset(
    [
        *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
        *("STRING", "BINSTRING", "SHORT_BINSTRING"),
        *("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
        *("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
    ]
)
_EXPORT = "nothing in it was run. Export the parameters again as npz or JSON"


def _admitted(name: str) -> _Name:
    """`name` as Python 3 and NumPy 1 have it; MeshError where it has no business in a fit."""
    same = name.replace("__builtin__.", "builtins.").replace("numpy._core.", "numpy.core.")
    if same not in _CALLS and same not in _NAMES and same not in _MADE_HERE:
        raise MeshError(f"asks for {_line(name)}, which is no array or plain container; {_EXPORT}")
    return _Name(same)


def _call(name: Any, arguments: Any) -> _Call:
    if not isinstance(name, _Name) or (name not in _CALLS and name not in _MADE_HERE):
        told = _line(name) if isinstance(name, str) else f"a {type(name).__name__}"
        raise MeshError(f"calls {told}, which is no function of an array; {_EXPORT}")
    return _Call(str(name), _expected(arguments, tuple))


def _expected(value: Any, kind: Any) -> Any:
    if not isinstance(value, kind):
        raise MeshError(f"has a {type(value).__name__} where there can be none; export it again")
    return value


def _exactly(file: Any, size: int) -> bytes:
    """The next `size` bytes of `file`."""
    data = file.read(size)
    if len(data) != size:
        raise MeshError(f"is truncated or no pickle ({len(data)} of {size} bytes); copy it again")
    return data


_COMPRESSIONS: dict[bytes, Callable[[], Any]] = {
    b"\x78": lambda: zlib.decompressobj(wbits=47),
    b"\x1f\x8b": lambda: zlib.decompressobj(wbits=47),
    b"BZh": bz2.BZ2Decompressor,
    b"\xfd7zXZ": lambda: lzma.LZMADecompressor(memlimit=2**27),
    b"\x5d\x00\x00": lambda: lzma.LZMADecompressor(memlimit=2**27),
}
_UNREADABLE = {
    b"\x04\x22\x4d\x18": "is compressed with LZ4",
    b"ZF": "was written by joblib before 0.10",
}


def _decompressed(data: bytes, most: int) -> bytes:
    """`data` as it was before it was compressed, if it was."""
    for start, fault in _UNREADABLE.items():
        if data.startswith(start):
            raise MeshError(f"{fault}; export the parameters again as npz or JSON")
    for start, make in _COMPRESSIONS.items():
        if data.startswith(start):
            decompressor = make()
            content = decompressor.decompress(data, most + 1)
            if len(content) > most:
                raise _too_large()
            if not decompressor.eof:
                raise MeshError("is truncated; copy it again")
            return content
    return data


def _bytes(megabytes: float) -> int:
    return int(megabytes * 2**20)


def _content(path: Path, most: int) -> bytes:
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise OSError("it is no file")
        if path.stat().st_size > most:
            raise _too_large()
        return path.read_bytes()
    except OSError as error:
        raise MeshError(
            f"cannot be opened ({error.strerror or error}); check the path and its rights"
        ) from None


def _too_large() -> MeshError:
    return MeshError(
        "holds or unpacks to more than it may; split it, or raise largest_mb if you trust it"
    )


@contextmanager
def _named(what: object, kind: str) -> Iterator[None]:
    """Within, every error becomes a MeshError that names `what`; odd bytes warn of nothing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MeshError as error:
        raise MeshError(f"{what}: {error}") from None
    except Exception as error:  # damage shows in too many ways to list
        reason = _line(str(error)) or type(error).__name__
        raise MeshError(
            f"{what}: is truncated or no {kind} ({reason}); copy or export it again"
        ) from error


def _line(text: str) -> str:
    """A stranger's text, short and printable."""
    return ascii(" ".join(text[:200].split()))[1:-1][:120]
