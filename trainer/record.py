"""A branch as plain values, for a checkpoint that runs nothing when it is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from trainer.branch import Back, Branch, Front


def to_record(branch: Branch) -> dict[str, Any]:
    """Plain values that say what was chosen."""
    return {"name": branch.name, **asdict(branch)}


def from_record(record: Mapping[str, Any]) -> Branch:
    """The branch that `to_record` described; nothing is imported, read or run by name.

    Raises:
        ValueError: it describes none.
    """
    if not isinstance(record, Mapping):
        raise ValueError(f"branch: {record!r}; give keys and values")
    chosen = {**record}
    branches = {branch.name: branch for branch in (Front, Back)}
    name = chosen.pop("name", None)
    if not isinstance(name, str) or name not in branches:
        raise ValueError(f"branch {name!r} is none of {', '.join(branches)}")
    return _made(branches[name], chosen, name)


def _made(kind: Any, value: Any, key: str) -> Any:
    """What plain values describe: a dataclass, null, a choice, or a value of just this type."""
    if get_origin(kind) is UnionType:
        kinds = get_args(kind)
        kind = next(k for k in kinds if (k is NoneType) == (value is None))
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind)
        known = {field.name: hints[field.name] for field in fields(kind)}
        if not isinstance(value, Mapping):
            raise ValueError(f"{key}: {value!r}; give {', '.join(known)}")
        if unknown := [str(name) for name in value if name not in known]:
            raise ValueError(f"{key}: no {', '.join(unknown)} there; give {', '.join(known)}")
        return kind(**{n: _made(known[n], value[n], f"{key}.{n}") for n in value})
    if get_origin(kind) is Literal:
        fits = isinstance(value, str) and value in get_args(kind)
    else:
        fits = type(value) in ((int, float) if kind is float else (kind,))
    if not fits:
        raise ValueError(f"{key}: {value!r} does not fit")
    return value
