"""Arrays and tensors, made of what a pickle says of them: element type, shape, bytes.

Every function takes plain values from a stranger and gives a plain value. An array may be a view
of the bytes that it was given, so it costs nothing until it is copied.
"""

from __future__ import annotations

import math
import re
import sys
from typing import Any

import numpy as np

from subjects.mesh import MeshError

ARRAY_TYPES = {"numpy.ndarray", "trimesh.caching.TrackedArray", "trimesh.util.TrackedArray"}
"""Classes whose pickles hold what a plain array's hold."""

_ELEMENT_TYPES = {
    "Float": "<f4",
    "Double": "<f8",
    "Half": "<f2",
    "BFloat16": "<u2",
    "Long": "<i8",
    "Int": "<i4",
    "Short": "<i2",
    "Char": "|i1",
    "Byte": "|u1",
    "Bool": "|b1",
    "ComplexFloat": "<c8",
    "ComplexDouble": "<c16",
    "Untyped": "|u1",
}

STORAGE_TYPES = {
    f"{module}.{name}Storage": element_type
    for module in ("torch", "torch.cuda", "torch.storage")
    for name, element_type in _ELEMENT_TYPES.items()
}
"""torch's storage classes and the type of their elements as stored."""

TENSOR_TYPES = frozenset(
    f"torch.{name}"
    for name in [
        *("float", "double", "half", "float16", "float32", "float64", "bfloat16", "bool"),
        *("uint8", "int8", "int16", "int32", "int64", "long", "int", "short"),
        *("complex64", "complex128"),
    ]
)
"""torch's element types."""

_PLAIN = re.compile(r"[<>=|]?[biufcSU][1-9][0-9]{0,8}")
_OBJECT = re.compile(r"[<>=|]?O[48]?")

MOST_AXES = 32
"""Axes of an array; NumPy 1 has no more."""


def element_type(code: str, *_: Any, state: tuple = ()) -> str:
    """numpy.dtype: its code with the byte order that `state` tells, as in "<f4"."""
    _, order, *records = state[:5]
    if any(part is not None for part in records):
        raise MeshError("holds an array of records; export each of its fields as an array")
    if not is_object(f"{order}{code}"):
        byte_count(f"{order}{code}", ())
    return f"{order}{code}"


def is_object(code: str) -> bool:
    """Whether that is the element type of arrays of Python objects."""
    return _OBJECT.fullmatch(code) is not None


def byte_count(code: str, shape: Any) -> int:
    """What an array of a plain element type takes."""
    if not _PLAIN.fullmatch(code):
        raise MeshError(f"holds an array of type {code!r:.40}; export it as numbers or text")
    return math.prod(_extent(shape)) * np.dtype(code).itemsize


def array(data: bytes, code: str, shape: Any, order: str = "C") -> np.ndarray:
    """`data` as an array of a plain element type, which it has to fill exactly."""
    if not isinstance(data, bytes) or byte_count(code, shape) != len(data):
        raise MeshError(f"has no array of type {code!r:.40} where it claims one; export it again")
    filled: np.ndarray = np.ndarray(_extent(shape), code, data, order="F" if order == "F" else "C")
    if filled.dtype.kind == "U":
        points = np.frombuffer(data, dtype=f"{filled.dtype.str[0]}u4")
        if points.max(initial=0) > sys.maxunicode:
            raise MeshError("holds text of no characters; it is damaged, export it again")
    return filled


def scalar(code: str, data: Any) -> Any:
    """numpy.core.multiarray.scalar."""
    return array(_as_bytes(data), code, ())[()]


def reconstruct(kind: str, *_: Any, state: tuple) -> np.ndarray:
    """numpy.core.multiarray._reconstruct, of any class with a plain array's pickle.

    Args:
        kind: the class.
        state: what numpy.ndarray.__setstate__ takes; a list of plain values, where it holds
            objects, makes an array of them.
    """
    if kind not in ARRAY_TYPES:
        raise MeshError(f"holds an array of class {kind!r:.40}; export a plain one")
    shape, code, fortran, data = state[-4:]
    if not isinstance(data, list):
        return array(_as_bytes(data), code, shape, "F" if fortran else "C")
    extent = _extent(shape)
    if not is_object(code) or math.prod(extent) != len(data):
        raise MeshError("claims another number of objects than it has; export it again")
    objects = np.empty(len(data), dtype=object)
    for i, item in enumerate(data):
        objects[i] = item
    return objects.reshape(extent)  # a list is in C order whatever the array's


def storage(kind: str, data: bytes, count: int) -> np.ndarray:
    """(count,) of a torch storage of class `kind`; bfloat16 comes as float32."""
    elements = array(data, STORAGE_TYPES[kind], (count,))
    if kind.endswith("BFloat16Storage"):
        return (elements.astype("<u4") << 16).view("<f4")
    return elements


def tensor(
    elements: np.ndarray,
    offset: int,
    size: Any,
    stride: Any,
    requires_grad: bool = False,
    hooks: Any = None,
    metadata: Any = None,
) -> np.ndarray:
    """torch._utils._rebuild_tensor_v2: a view of a storage's elements, wherever they lay."""
    extent, steps, (offset,) = _extent(size), _extent(stride), _extent((offset,))
    last = offset + sum((n - 1) * step for n, step in zip(extent, steps, strict=True))
    if elements.ndim != 1 or elements.dtype.hasobject or metadata:
        raise MeshError("holds a tensor of no plain storage; export it as a NumPy array")
    if math.prod(extent) == 0:
        return np.empty(extent, dtype=elements.dtype)
    if last >= elements.size:
        raise MeshError(
            f"has a tensor that reaches element {last} of {elements.size}; "
            "it is damaged, export it again"
        )
    width = elements.dtype.itemsize
    return np.ndarray(
        extent, elements.dtype, elements, offset * width, [step * width for step in steps]
    )


def parameter(data: np.ndarray, *_: Any) -> np.ndarray:
    """torch._utils._rebuild_parameter."""
    return data


def device(kind: str, index: int | None = None) -> str:
    """torch.device: its name, as in "cuda:0"."""
    if not isinstance(kind, str) or not isinstance(index, int | None):
        raise MeshError("names a device by no name; export the parameters again as npz or JSON")
    return kind if index is None else f"{kind}:{index}"


def _extent(shape: Any) -> tuple[int, ...]:
    """A shape, or the steps through one: whole numbers, none negative."""
    if not isinstance(shape, list | tuple) or len(shape) > MOST_AXES:
        raise MeshError(f"has an array of no shape or over {MOST_AXES} axes; export it again")
    if not all(type(n) is int and n >= 0 for n in shape):
        raise MeshError("has an array whose shape is no whole numbers; export it again")
    return tuple(shape)


def _as_bytes(data: Any) -> bytes:
    """Bytes; Python 2 wrote them as strings."""
    return data.encode("latin-1") if isinstance(data, str) else data
