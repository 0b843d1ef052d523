"""The scans in a folder."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from subjects.fits.pattern import Place
from subjects.meshfile import EXTENSIONS

BODY = "body.obj"
"""The file beside a scan that holds its parametric body, in letters of either case."""

LONGEST_ID = 150
"""Letters of an id: files are named by it, and 255 bytes are what a name may have."""

_UNFIT = re.compile(r"[\\\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""What no portable path holds: what parts it on other systems, moves a terminal's cursor or turns
its text round, and what stands for bytes that are no UTF-8."""


def scans_below(root: Path, pattern: str) -> Iterator[tuple[str, Path]]:
    """Id and file of every scan below `root` that `pattern` names, by path.

    "0525/0525.obj" is "0525", "a/b.glb" is "a_b". Hidden files, `body.obj` and files with "smplx"
    in their name are no scans. Links that lead nowhere and pipes are: reading them tells why not.
    """
    for path in sorted(root.glob(pattern)):
        below = path.relative_to(root)
        if _is_scan(path) and not any(part.startswith(".") for part in below.parts):
            yield scan_id(below), path


def find_scans(root: Path, pattern: str) -> dict[str, Path]:
    """Id -> file of every scan, as `scans_below` finds them.

    Raises:
        ValueError: `root` holds no scan, or two scans get the same id.
    """
    paths: dict[str, Path] = {}
    for name, path in scans_below(root, pattern):
        if name in paths:
            raise ValueError(
                f"subjects.root: '{paths[name]}' and '{path}' have the same id '{name}'; "
                "rename one or narrow subjects.pattern"
            )
        paths[name] = path
    if not paths:
        deeper = next((path for _, path in scans_below(root, f"**/{pattern}")), None)
        told = f"give the folder that it starts from, with {', '.join(EXTENSIONS)} files"
        if deeper is not None:
            told = f"'{deeper}' would, from a folder further down: give that"
        raise ValueError(f"subjects.root: '{root}' holds no scan that matches '{pattern}'; {told}")
    return paths


def scan_id(below: Path) -> str:
    """The id of a scan at `below` its root: in letters that files allow."""
    parts = below.with_suffix("").parts
    if len(parts) > 1 and parts[-1] == parts[-2]:
        parts = parts[:-1]
    return re.sub(r"[^A-Za-z0-9._-]", "_", "_".join(parts))


def fault_of_name(name: str, below: Path) -> str | None:
    """Why a scan at `below` its root, of the id `name`, cannot be part of a dataset; or None."""
    if _UNFIT.search(str(below)):
        return (
            "has a name with backslashes, control characters or bytes that are no text; rename it"
        )
    if len(name) > LONGEST_ID:
        return (
            f"has an id of {len(name)} characters, where {LONGEST_ID} are the most; "
            "shorten the names of the file and its folders"
        )
    return None


def shown(path: Path) -> str:
    """A path as text that a terminal and a file of text take."""
    return _UNFIT.sub(lambda match: ascii(match[0])[1:-1], str(path))


def place_of(subject: str, path: Path, root: Path) -> Place:
    """What patterns may say of the scan at `path`."""
    folder = path.parent.relative_to(root).as_posix()
    return Place(subject, "" if folder == "." else folder, path.stem)


def is_body(path: Path) -> bool:
    """Whether a file is the parametric body of the scan that it lies beside."""
    return path.name.lower() == BODY and not path.is_dir()


def linked(source: Path, link: Path) -> Path:
    """`link`, made to hold what `source` holds: as a link, or as a copy where links fail."""
    if link.exists() and not link.is_symlink() and link.samefile(source):
        return link
    link.parent.mkdir(parents=True, exist_ok=True)
    link.unlink(missing_ok=True)
    try:
        link.symlink_to(source.resolve())
    except OSError:
        shutil.copyfile(source, link)
    return link


def _is_scan(path: Path) -> bool:
    body = is_body(path) or "smplx" in path.name.lower()
    return path.suffix.lower() in EXTENSIONS and not body and not path.is_dir()
