"""What a pickle may name, and the functions that are all that is ever called for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from subjects.fits.pickles import tensors
from subjects.fits.pickles.content import EXPORT, expected
from subjects.mesh import MeshError

KEYS = (str, bytes, int, float, np.generic, type(None))
"""What a dict's keys and a set's items may be: what takes a moment to hash."""


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """_codecs.encode, by which protocols below 3 write bytes."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1", "utf-8", "utf8"):
        raise MeshError(f"asks for _codecs.encode otherwise than to bytes; {EXPORT}")
    return text.encode(encoding)


def _to_bytes(data: bytes | str = b"", *encoding: str) -> bytes:
    """bytes and bytearray, of bytes or text alone."""
    return _encode(data, *encoding) if isinstance(data, str) else expected(data, bytes)


def _dict(pairs: Any = (), *, items: Any = ()) -> dict:
    """dict and OrderedDict.

    Args:
        pairs: keys with values.
        items: keys and values in turn.
    """
    items = [part for key, value in _tuple(pairs) for part in (key, value)] + list(items)
    keys, values = (expected(key, KEYS) for key in items[::2]), items[1::2]
    return dict(zip(keys, values, strict=True))


def _set(members: Any = (), *, items: Any = ()) -> set:
    """set and frozenset."""
    return {expected(item, KEYS) for item in (*_tuple(members), *items)}


def _tuple(members: Any) -> tuple:
    """torch.Size; never of an array or of bytes, whose items take more memory one by one."""
    return tuple(expected(members, (list, tuple)))


JOBLIB_ARRAY = "joblib.numpy_pickle.NumpyArrayWrapper"
TORCH_BYTES = "torch.storage._load_from_bytes"

FUNCTIONS: dict[str, Callable[..., Any]] = {
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
"""What makes a value of plain arguments, by names as Python 3 and NumPy 1 have them."""

CALLABLE = frozenset([*FUNCTIONS, JOBLIB_ARRAY, TORCH_BYTES])
"""What a pickle may call; the last two hold bytes, which the reader reads itself."""

NAMES = CALLABLE | tensors.ARRAY_TYPES | tensors.TENSOR_TYPES | set(tensors.STORAGE_TYPES)
"""What a pickle may name; what it may not call is a class and stays its name."""
