"""OBJ files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from subjects.limits import Limits
from subjects.mesh import Material, MeshError
from subjects.meshfile.folder import Folder
from subjects.meshfile.mtl import read_mtl
from subjects.meshfile.part import check_corners

_BLOCK = 10_000  # faces whose corners are looked at together

_KINDS = ("v", "vt", "vn")
"""What a corner names, in the order in which it does."""


def read_obj(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of an OBJ file, one for each material, in the form that trimesh gives.

    Not read by trimesh: it takes index 0 for 1 and any other that is wrong for what it finds there,
    counts negative ones from the file's end, and goes without all texture coordinates or normals
    where one is missing, so that every corner would have to be read twice.
    """
    lines = _Lines(data)
    faces = _faces(lines, folder.limits)
    materials = _materials(lines, folder)
    rows = {kind: lines.numbers(kind, least) for kind, least in zip(_KINDS, (3, 2, 3), strict=True)}
    distinct = list({id(material): material for _, material in materials}.values())
    place = {id(material): i for i, material in enumerate(distinct)}
    since = np.searchsorted([line for line, _ in materials], faces.lines, side="right") - 1
    of_face = np.array([place[id(material)] for _, material in materials])[since]
    geometry: dict[str, Any] = {}
    for i, material in enumerate(distinct):
        corners = faces.triangles(of_face == i)
        if corners.size:
            geometry[str(i)] = {**_geometry(corners, rows), "material": material}
    return {"geometry": geometry}


class _Lines:
    """The lines of an OBJ file by their first words.

    Attributes:
        found: of "v", "vt", "vn" and "f" the numbers of their lines.
    """

    def __init__(self, data: bytes) -> None:
        text = b"\n" + data.replace(b"\r\n", b"\n").replace(b"\\\n", b" ") + b"\n"
        if b"\n " in text or b"\n\t" in text:
            text = re.sub(rb"\n[ \t]+", b"\n", text)
        letters = np.frombuffer(bytearray(text + b"\n\n"), dtype=np.uint8)
        self._ends = np.flatnonzero(letters[:-2] == ord("\n"))
        self._starts = np.concatenate([[0], self._ends[:-1] + 1])
        first, second, third = (letters[self._starts + k] for k in range(3))
        one, two = second <= ord(" "), third <= ord(" ")  # letters in the first word
        vertex = first == ord("v")
        self.found = {
            "f": np.flatnonzero((first == ord("f")) & one),
            "v": np.flatnonzero(vertex & one),
            "vt": np.flatnonzero(vertex & two & (second == ord("t"))),
            "vn": np.flatnonzero(vertex & two & (second == ord("n"))),
        }
        for word, lines in self.found.items():  # blank, so that what is left are the numbers
            for place in range(len(word)):
                letters[self._starts[lines] + place] = ord(" ")
        self._first = first
        self._text = letters.data

    def text(self, lines: np.ndarray) -> bytes:
        """What these lines say after their first word, each with its end; `lines` in order."""
        breaks = np.flatnonzero(np.diff(lines) != 1)
        begins = self._starts[lines[np.concatenate([[0], breaks + 1])]]
        ends = self._ends[lines[np.concatenate([breaks, [len(lines) - 1]])]] + 1
        spans = zip(begins.tolist(), ends.tolist(), strict=True)
        text = b"".join(self._text[begin:end] for begin, end in spans)
        return re.sub(rb"#.*", b"", text) if b"#" in text else text

    def words(self, key: str) -> Iterator[tuple[int, str]]:
        """Number and content of the lines that begin with the word `key`."""
        for line in np.flatnonzero(self._first == ord(key[0])).tolist():
            text = bytes(self._text[self._starts[line] : self._ends[line]])
            word, content = (*text.split(maxsplit=1), b"", b"")[:2]
            if word == key.encode() and content:
                yield line, content.decode("utf-8", errors="replace").strip()

    def numbers(self, key: str, least: int) -> np.ndarray:
        """(n, m) the numbers of all lines of a kind, as many as the shortest has.

        Raises:
            MeshError: one has fewer than `least`.
            ValueError: one is not made of numbers, by the warning of NumPy's that `_mesh` raises.
        """
        lines = self.found[key]
        if not len(lines):
            return np.empty((0, least))
        text = self.text(lines)
        values = np.fromstring(text, sep=" ")
        letters = np.frombuffer(text, dtype=np.uint8)
        solid = letters > ord(" ")
        begins = np.flatnonzero(solid[1:] & ~solid[:-1])
        ends = np.flatnonzero(letters == ord("\n"))
        counts = np.diff(np.searchsorted(begins, ends), prepend=0)
        width = int(counts.min())
        if width < least:
            raise MeshError(
                f"has a line '{key}' that is not {least} numbers or more; export it again"
            )
        if counts.max() > width:
            values = values[(np.cumsum(counts) - counts)[:, None] + np.arange(width)]
        return values.reshape(len(lines), width)


@dataclass(eq=False)
class _Faces:
    """Attributes:
    corners: (3, n) what each names of `_KINDS`, counted from 0, -1 for nothing; face by face.
    counts: (F,) corners of each face.
    lines: (F,) its line.
    """

    corners: np.ndarray
    counts: np.ndarray
    lines: np.ndarray

    def triangles(self, chosen: np.ndarray) -> np.ndarray:
        """(3, T, 3) corners of the fans that the `chosen` (F,) faces become."""
        first, counts = (np.cumsum(self.counts) - self.counts)[chosen], self.counts[chosen]
        fans = counts - 2
        step = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans)
        begin = np.repeat(first, fans)
        return self.corners[:, np.stack([begin, begin + step + 1, begin + step + 2], axis=1)]


def _faces(lines: _Lines, limits: Limits) -> _Faces:
    """All faces.

    Raises:
        MeshError: they are too many, or name what the file does not hold.
    """
    held = [len(lines.found[kind]) for kind in _KINDS]
    rows = lines.found["f"]
    limits.check_count(vertices=max(held), triangles=len(rows))
    corners, counts, triangles = [np.empty((3, 0), np.int32)], [np.empty(0, np.int64)], 0
    for start in range(0, len(rows), _BLOCK):
        block = rows[start : start + _BLOCK]
        named, given, count = _corners(lines.text(block))
        check_corners(count)
        triangles += int((count - 2).sum())
        limits.check_count(triangles=triangles)
        for kind, total, index, has in zip(_KINDS, held, named, given, strict=True):
            back = index < 0
            known = np.full(len(index), total)
            if back.any():  # they count from the face back
                before = np.searchsorted(lines.found[kind], block)
                known[back] = np.repeat(before, count)[back]
            bad = has & ((index == 0) | (np.abs(index) > known))
            if bad.any():
                raise MeshError(
                    f"a face names {kind} {index[bad][0]}, but there are {known[bad][0]}, "
                    "counted from 1; export it again"
                )
            index += np.where(back, known, -1)
        corners.append(np.where(given, named, -1).astype(np.int32))
        counts.append(count)
    return _Faces(np.concatenate(corners, axis=1), np.concatenate(counts), rows)


def _corners(text: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(3, n) int, v, vt and vn of each corner, and (3, n) bool, where it has them; corners a face.

    Args:
        text: lines of faces, each corner "v", "v/vt", "v//vn" or "v/vt/vn" after a blank.
    """
    letters = np.frombuffer(text, dtype=np.uint8)
    slash, blank = letters == ord("/"), letters <= ord(" ")
    gap = slash | blank
    number = np.flatnonzero(~gap & np.roll(gap, 1))
    starts = np.flatnonzero(~blank & np.roll(blank, 1))
    found = np.fromstring(text.replace(b"/", b" "), sep=" ", dtype=np.int64)
    corner = np.searchsorted(starts, number, side="right") - 1
    first = np.flatnonzero(np.diff(corner, prepend=-1))
    if not np.array_equal(number[first], starts):
        raise MeshError("has a corner that begins with no number; copy or export it again")
    slashes = np.cumsum(slash, dtype=np.int32)[number]
    place = slashes - slashes[first][corner]
    if place.max(initial=0) > 2:
        raise MeshError("has a corner of more than v/vt/vn: it is damaged; copy it again")
    indices = np.zeros((3, len(starts)), dtype=np.int64)
    given = np.zeros(indices.shape, dtype=bool)
    indices[place, corner] = found
    given[place, corner] = True
    ends = np.flatnonzero(letters == ord("\n"))
    return indices, given, np.diff(np.searchsorted(starts, ends), prepend=0)


def _materials(lines: _Lines, folder: Folder) -> list[tuple[int, Material]]:
    """From which line on which material covers the faces.

    Faces that name no material take the MTL's one where it has no other: many scanners write no
    usemtl.
    """
    libraries = {name for _, name in lines.words("mtllib")}
    if folder.material is not None:
        libraries = set()
    if len(libraries) > 1:
        raise MeshError(f"names {len(libraries)} material files; join them into one")
    used = list(lines.words("usemtl"))
    materials = {} if not libraries else read_mtl(min(libraries), folder)
    if len(materials) > 1 and not used:
        raise MeshError(
            f"uses none of the {len(materials)} materials of '{min(libraries)}'; "
            "add usemtl lines, or leave one material there"
        )
    unknown = {name for _, name in used} - set(materials)
    if libraries and unknown:
        raise MeshError(
            f"uses material '{min(unknown)}', which '{min(libraries)}' does not "
            "define; define it there or export both files again"
        )
    default = next(iter(materials.values())) if len(materials) == 1 else Material()
    return [(-1, default), *((line, materials.get(name, default)) for line, name in used)]


def _geometry(corners: np.ndarray, rows: dict[str, np.ndarray]) -> dict[str, Any]:
    """Triangles and what their corners name; texture coordinates only if all name them.

    Args:
        corners: (3, T, 3), as `_Faces.triangles` gives them.
        rows: the file's numbers of each of `_KINDS`.
    """
    v, vt, vn = corners
    if (vn >= 0).any():
        normals = np.concatenate([np.zeros((1, 3)), rows["vn"][:, :3]])  # the first for none
        pairs, faces = np.unique(v * np.int64(len(normals)) + vn + 1, return_inverse=True)
        used, normal = np.divmod(pairs, len(normals))
        faces = faces.reshape(v.shape)
        found = {"vertex_normals": normals[normal]}
    else:
        held = np.zeros(len(rows["v"]), dtype=bool)
        held[v] = True
        used, faces, found = np.flatnonzero(held), (np.cumsum(held) - 1)[v], {}
    if (vt >= 0).all():
        found["corner_uv"] = rows["vt"][:, :2].astype(np.float32)[vt]
    if rows["v"].shape[1] >= 6:
        found["vertex_colors"] = rows["v"][used, 3:6]
    return {"vertices": rows["v"][used, :3], "faces": faces, **found}
