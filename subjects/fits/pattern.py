"""Where the files that belong to a scan lie, said once for all scans."""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from storage.mirror import local_folder


@dataclass(frozen=True)
class Place:
    """What a pattern may say of a scan.

    Attributes:
        id: the subject's id.
        folder: the scan's folder below the scans' root, with '/'; "" in the root itself.
        name: the scan's file name without its ending.
    """

    id: str
    folder: str
    name: str


FIELDS = ("id", "folder", "name")


def check_pattern(pattern: str, key: str, *, of_each: bool = False) -> None:
    """ValueError where a pattern leaves its root or cannot be what it should.

    Args:
        pattern: of the setting `key`.
        key: for the message.
        of_each: whether it has to tell scans apart; else one file may serve all.
    """
    # A scan in the root itself has an empty folder.
    filled = (expand(pattern, Place("a", folder, "a")) for folder in ("", "a"))
    climbs = any(".." in PurePosixPath(path).parts for path in filled)
    if not pattern.strip("/") or pattern.startswith("/") or climbs or "\\" in pattern:
        raise ValueError(
            f"{key}: '{pattern}' does not stay below its root; give one like '{{folder}}/fit.pkl'"
        )
    unknown = set(re.findall(r"{(.*?)}", pattern)) - set(FIELDS)
    if of_each and not re.search(r"{\w+}", pattern):
        raise ValueError(
            f"{key}: '{pattern}' is one file for all scans; use {{folder}}, {{name}} or {{id}} of "
            "the scan in it"
        )
    if re.search(r"\*\*[^/]|[^/]\*\*", pattern):
        raise ValueError(f"{key}: '{pattern}' has ** beside letters; give * there")
    if unknown:
        raise ValueError(
            f"{key}: '{pattern}' names {', '.join(sorted(unknown))}; "
            "use {folder}, {name} or {id} of the scan"
        )


def expand(pattern: str, place: Place, quote: Callable[[str], str] = str) -> str:
    """The path, relative to its root, that `pattern` means for one scan, its fields quoted."""
    for field in FIELDS:
        pattern = pattern.replace(f"{{{field}}}", quote(getattr(place, field)))
    return str(PurePosixPath(pattern.lstrip("/")))


def matching(pattern: str, root: Path) -> Iterator[tuple[Path, str]]:
    """The files below `root` that `pattern` means for any scan, and what it calls that scan.

    Hidden files and folders are left out, as they are among scans.
    """
    parts = re.split(r"{\w+}", pattern)
    anything = "*".join(glob.escape(part) for part in parts)
    deep = "{folder}" in pattern
    for path in sorted(root.glob(f"**/{anything}" if deep else anything)):
        below = path.relative_to(root)
        found = re.fullmatch(_expression(pattern), below.as_posix())
        hidden = any(part.startswith(".") for part in below.parts)
        if found and not hidden and path.is_file():
            fields = found.groupdict()
            yield path, next(fields[field] for field in FIELDS if fields.get(field))


def _expression(pattern: str) -> str:
    """The regular expression of a pattern; a field that comes again has to be the same."""
    expression, seen = "", set()
    for part in re.split(r"({\w+})", pattern):
        field = part[1:-1]
        if part[:1] != "{":
            expression += re.escape(part)
        elif field in seen:
            expression += f"(?P={field})"
        else:
            seen.add(field)
            expression += f"(?P<{field}>{'.+' if field == 'folder' else '[^/]+'})"
    return expression


def first_file(patterns: Iterable[str], place: Place, base: Path) -> Path | None:
    """The first file that is there, of those that `patterns` mean for one scan."""
    paths = (base / expand(pattern, place) for pattern in patterns)
    return next((path for path in paths if path.is_file()), None)


def base_folder(root: str | None, scans: Path, key: str) -> Path:
    """The folder that patterns are relative to: that of the setting `key`, or the scans' own.

    Raises:
        ValueError: it is no folder.
    """
    base = scans if root is None else local_folder(root)
    if not base.is_dir():
        raise ValueError(f"{key}: '{base}' is no folder; give the folder of the files it names")
    return base


def not_there(patterns: Iterable[str], place: Place, base: Path, key: str) -> str:
    """What to tell of a scan for which no pattern of the setting `key` leads to a file."""
    names = [f"'{expand(pattern, place)}'" for pattern in patterns]
    return (
        f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} not in '{base}'; "
        f"put it there or correct {key}"
    )
