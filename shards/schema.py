"""What a shard holds: its members, their shapes and types, and its meta data."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, Protocol

import numpy as np

SCHEMA_VERSION = 2

DROPPED_LIMIT = 2e-4
"""Largest part of a view's silhouette that only one of the two cameras may have hit."""

RADIANCE_WATTS = 1e5
"""Power of the lamp that `radiance_*` are light of. Light per watt of a dim, grazed surface falls
among the half-precision numbers that have few digits."""

_SUBJECT_ID = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*")
_SHA256 = re.compile(r"[0-9a-f]{64}")


class SchemaError(ValueError):
    """Data that break the contract; one line that names the member and what was found."""


class ArrayLike(Protocol):
    """Anything with a shape and a type: an array, a map, or a member not yet read."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    @property
    def dtype(self) -> np.dtype[Any]: ...


@dataclass(frozen=True)
class Member:
    """One array of a shard.

    Attributes:
        name: its name in the npz.
        view_shape: what follows the leading axis of views; "H" and "W" are the image's, "D" is
            any number above 0.
        dtype: little-endian type on disk.
        meaning: one line with the unit and the frame.
        optional: whether a shard may lack it.
    """

    name: str
    view_shape: tuple[int | str, ...]
    dtype: np.dtype[Any]
    meaning: str
    optional: bool = False

    def shape(self, views: int, height: int, width: int, draws: int = 1) -> tuple[int, ...]:
        """The whole member's shape for `views` images of `height` x `width` pixels."""
        sizes = {"H": height, "W": width, "D": draws}
        return (views, *(sizes[n] if isinstance(n, str) else n for n in self.view_shape))

    @property
    def shape_text(self) -> str:
        """The shape as the documentation writes it, e.g. "(V, H, W, 3)"."""
        axes = ", ".join(str(n) for n in ("V", *self.view_shape))
        return f"({axes})" if self.view_shape else f"({axes},)"


def _member(
    name: str, view_shape: tuple[int | str, ...], dtype: str, meaning: str, optional: bool = False
) -> Member:
    return Member(name, view_shape, np.dtype(dtype), meaning, optional)


_IMAGE: tuple[int | str, ...] = ("H", "W")
_IMAGE3: tuple[int | str, ...] = ("H", "W", 3)

MEMBERS: dict[str, Member] = {
    member.name: member
    for member in (
        _member("yaw_deg", (), "<f4", "turn of the subject about y, degrees; + faces camera +x"),
        _member("camera_to_world", (4, 4), "<f8", "camera-frame metres to the subject's world"),
        _member("mask", _IMAGE, "|b1", "the subject's silhouette, one for front and back"),
        _member("depth_front", _IMAGE, "<f4", "nearest surface from the camera plane, metres"),
        _member("depth_back", _IMAGE, "<f4", "farthest surface from the same plane, metres"),
        _member("normal_front", _IMAGE3, "<f2", "unit outward normal, camera frame, z >= 0"),
        _member("normal_back", _IMAGE3, "<f2", "unit outward normal, camera frame, z <= 0"),
        _member("rgb_front", _IMAGE3, "|u1", "sRGB under the configured light"),
        _member("rgb_back", _IMAGE3, "|u1", "sRGB of the back, in the front camera's grid"),
        _member("depth_sensor", _IMAGE, "<f4", "the front as the sensor sees it, metres"),
        _member("depth_sensor_more", ("D", *_IMAGE), "<f4", "further readings of the same", True),
        _member("body_depth_front", _IMAGE, "<f4", "nearest surface of the parametric body"),
        _member("body_depth_back", _IMAGE, "<f4", "farthest surface of the parametric body"),
        _member("radiance_front", _IMAGE3, "<f2", "linear light per 100 kW of the lamp", True),
        _member("radiance_back", _IMAGE3, "<f2", "the same of the back", True),
    )
}
"""Every member but `meta`, in the order a shard holds them."""

META = "meta"

_NUMBER = (int, float)
_META_TYPES: dict[str, tuple[type, ...]] = {
    "schema_version": (int,),
    "subject": (str,),
    "source": (str,),
    "licence": (str,),
    "mesh": (str,),
    "mesh_to_world": (list,),
    "mesh_sha256": (str,),
    "body": (str, type(None)),
    "body_parameters": (dict,),
    "camera": (dict,),
    "camera.size": (list,),
    "camera.pixel_size": _NUMBER,
    "camera.distance": _NUMBER,
    "camera.center_height": _NUMBER,
    "light": (dict,),
    "light.power": _NUMBER,
    "light.position": (list,),
    "light.exposure": _NUMBER,
    "cycles": (dict,),
    "sensor": (dict,),
    "sensor.model": (str,),
    "seed": (int,),
    "dropped_pixels": (list,),
    "versions": (dict,),
}


def check_subject_id(subject: str) -> str:
    """`subject`, if it can name a file: letters, digits, '.', '_', '-', no leading '.'.

    Raises:
        SchemaError: for any other id.
    """
    if not isinstance(subject, str) or not _SUBJECT_ID.fullmatch(subject):
        raise SchemaError(
            f"subject id {subject!r}: use letters, digits, '.', '_' and '-', not starting with '.'"
        )
    return subject


def check_relative_path(path: str, where: str) -> str:
    """`path`, if it is a posix path that stays below the folder it is relative to.

    Args:
        path: as read from a file.
        where: what holds it, for the message, e.g. "meta.mesh".

    Raises:
        SchemaError: if it is absolute, empty, or climbs with '..'.
    """
    if (
        not isinstance(path, str)
        or path in ("", ".")
        or "\\" in path
        or "\0" in path
        or PurePosixPath(path).is_absolute()
        or PureWindowsPath(path).drive
        or ".." in PurePosixPath(path).parts
    ):
        raise SchemaError(f"{where}: {path!r} is no posix path below the dataset's folder")
    return path


def check_arrays(arrays: Mapping[str, ArrayLike]) -> tuple[int, int, int]:
    """Check names, shapes and types; the values are not read.

    Args:
        arrays: every member but `meta`.

    Returns:
        views V, height H and width W.

    Raises:
        SchemaError: at the first member that is missing, unknown, or of another shape or type.
    """
    for name in arrays:
        if name not in MEMBERS:
            raise SchemaError(f"member {name!r} is unknown; known are {', '.join(MEMBERS)}, meta")
    for name, member in MEMBERS.items():
        if name not in arrays and not member.optional:
            raise SchemaError(f"member {name!r} is missing")
    if ("radiance_front" in arrays) != ("radiance_back" in arrays):
        raise SchemaError("radiance_front and radiance_back come together, but one is missing")
    shape = tuple(arrays["mask"].shape)
    if len(shape) != 3 or 0 in shape:
        raise SchemaError(f"member 'mask' has shape {shape} where (V, H, W) is due, none of them 0")
    views, height, width = shape
    for name, array in arrays.items():
        member = MEMBERS[name]
        draws = max(tuple(array.shape)[1:2] or (1,)) if "D" in member.view_shape else 1
        due = member.shape(views, height, width, max(draws, 1))
        if array.dtype != member.dtype:
            raise SchemaError(f"member {name!r} has type {array.dtype}, not {member.dtype}")
        if tuple(array.shape) != due:
            raise SchemaError(
                f"member {name!r} has shape {tuple(array.shape)}, not {due} as mask demands"
            )
    return views, height, width


def check_meta(meta: Mapping[str, Any], views: int, height: int, width: int) -> None:
    """Check that `meta` has every key of the contract, of the right type, agreeing with the arrays.

    Raises:
        SchemaError: at the first key that is missing or wrong, or number that is not finite.
    """
    _check_finite(meta)
    for key, types in _META_TYPES.items():
        value: Any = meta
        for part in key.split("."):
            if part not in value:
                raise SchemaError(f"meta.{key} is missing")
            value = value[part]
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            names = " or ".join("null" if t is type(None) else t.__name__ for t in types)
            raise SchemaError(f"meta.{key} is {value!r}, which is no {names}")
    if meta["schema_version"] != SCHEMA_VERSION:
        raise SchemaError(
            f"meta.schema_version is {meta['schema_version']}, but this program reads "
            f"{SCHEMA_VERSION}; build the dataset again or use the program that wrote it"
        )
    check_subject_id(meta["subject"])
    check_relative_path(meta["mesh"], "meta.mesh")
    if meta["body"] is not None:
        check_relative_path(meta["body"], "meta.body")
    if not _SHA256.fullmatch(meta["mesh_sha256"]):
        raise SchemaError(f"meta.mesh_sha256 is {meta['mesh_sha256']!r}, not 64 hex digits")
    files = meta.get("files", {})
    if not isinstance(files, dict):
        raise SchemaError(f"meta.files is {files!r}, which is no dict")
    for name, sha256 in files.items():
        check_relative_path(name, "meta.files")
        if not isinstance(sha256, str) or not _SHA256.fullmatch(sha256):
            raise SchemaError(f"meta.files has {sha256!r} for '{name}', not 64 hex digits")
    if "base" in meta:
        check_base(meta["base"])
    _check_similarity(meta["mesh_to_world"])
    if meta["camera"]["size"] != [height, width]:
        raise SchemaError(
            f"meta.camera.size is {meta['camera']['size']}, but the images are [{height}, {width}]"
        )
    if not meta["camera"]["pixel_size"] > 0:
        raise SchemaError(f"meta.camera.pixel_size is {meta['camera']['pixel_size']}, not above 0")
    dropped = meta["dropped_pixels"]
    if len(dropped) != views or not all(type(n) is int and n >= 0 for n in dropped):
        raise SchemaError(
            f"meta.dropped_pixels is {dropped}, not one count for each of {views} views"
        )


def check_base(base: Any) -> None:
    """Check the `base` of a meta: the shard that holds the members that its own does not.

    Raises:
        SchemaError: if it is no object of shard (path below the dataset), contents and sha256.
    """
    if not isinstance(base, dict) or set(base) != {"shard", "contents", "sha256"}:
        raise SchemaError(f"meta.base is {base!r}, no object of shard, contents and sha256")
    check_relative_path(base["shard"], "meta.base.shard")
    for key in ("contents", "sha256"):
        if not isinstance(base[key], str) or not _SHA256.fullmatch(base[key]):
            raise SchemaError(f"meta.base.{key} is {base[key]!r}, not 64 hex digits")


def _check_finite(meta: Mapping[str, Any]) -> None:
    rest: list[tuple[str, Any]] = [("meta", meta)]
    while rest:
        key, value = rest.pop()
        # Compared like this NaN is refused, and an integer that no float can hold.
        if isinstance(value, _NUMBER) and not abs(value) <= sys.float_info.max:
            raise SchemaError(f"{key} is {value}, which is no finite number")
        if isinstance(value, Mapping):
            rest += [(f"{key}.{name}", inner) for name, inner in value.items()]
        elif isinstance(value, list):
            rest += [(key, inner) for inner in value]


def _check_similarity(rows: Any) -> None:
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise SchemaError("meta.mesh_to_world is no 4x4 list of finite numbers")
    linear = matrix[:3, :3]
    scale = abs(np.linalg.det(linear)) ** (1 / 3)
    rigid = scale > 0 and np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-6 * scale**2)
    if not rigid or np.linalg.det(linear) < 0 or not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise SchemaError("meta.mesh_to_world is no similarity (rotation, one scale, translation)")
