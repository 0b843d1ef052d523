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

_LINES = 10
"""Most lines for a triangle: one of its own, and of v, vt and vn three each."""

_KINDS = ("v", "vt", "vn")
"""What a corner names, in the order in which it does."""


def read_obj(data: bytes, folder: Folder) -> dict[str, Any]:
    """The geometries of an OBJ file, one for each material, as trimesh gives those of other files;
    only that texture coordinates are of corners, "corner_uv" (T, 3, 2).

    Not read by trimesh: it takes index 0 for 1 and any other that is wrong for what it finds there,
    counts negative ones from the file's end, and goes without all texture coordinates or normals
    where one is missing, so that every corner would have to be read twice.
    """
    lines = _Lines(data, folder.limits)
    faces = _faces(lines, folder.limits)
    materials = _materials(lines, folder)
    rows = _Rows.of(lines, faces.corners)
    corners, face = faces.triangles()
    distinct = list({id(material): material for _, material in materials}.values())
    place = {id(material): i for i, material in enumerate(distinct)}
    since = np.searchsorted([line for line, _ in materials], faces.lines, side="right") - 1
    number = np.array([place[id(material)] for _, material in materials])[since][face]
    if len(distinct) > 1:
        order = np.argsort(number, kind="stable")
        corners, number = corners[:, order], number[order]
    ends = np.searchsorted(number, np.arange(len(distinct)), side="right").tolist()
    geometry = {
        str(i): {**_geometry(corners[:, begin:end], rows), "material": material}
        for i, (material, begin, end) in enumerate(zip(distinct, [0, *ends], ends, strict=False))
        if end > begin
    }
    return {"geometry": geometry}


class _Lines:
    """The lines of an OBJ file by their first words.

    Attributes:
        found: of "v", "vt", "vn" and "f" the numbers of their lines.
    """

    def __init__(self, data: bytes, limits: Limits) -> None:
        """Args:
        data: of the file.
        limits: what they allow has no more lines than 10 for a triangle.

        Raises:
            MeshError: it has more.
        """
        text = b"\n" + data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") + b"\n"
        text = text.replace(b"\\\n", b" ")
        if b"\n " in text or b"\n\t" in text:
            text = re.sub(rb"\n[ \t]+", b"\n", text)
        count = text.count(b"\n")
        if count > _LINES * limits.triangles + 1000:
            raise MeshError(
                f"has {count} lines, more than {limits.triangles} triangles have; copy or export "
                "it again, or raise subjects.limits.triangles"
            )
        letters = np.frombuffer(bytearray(text + b"\n\n"), dtype=np.uint8)
        self._ends = np.flatnonzero(letters[:-2] == ord("\n"))
        self._starts = np.concatenate([[0], self._ends[:-1] + 1])
        known = np.isin(letters[self._starts], list(b"vfum"))  # not what is of no use here
        self._starts, self._ends = self._starts[known], self._ends[known]
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
        self._first, self._second = first, second
        self._text = letters.data

    def text(self, lines: np.ndarray) -> bytes:
        """What these lines say after their first word, each with its end; `lines` in order."""
        begins, ends = self._starts[lines], self._ends[lines] + 1
        parted = begins[1:] != ends[:-1]  # they do not follow each other
        begins = begins[np.concatenate([[True], parted])]
        ends = ends[np.concatenate([parted, [True]])]
        spans = zip(begins.tolist(), ends.tolist(), strict=True)
        text = b"".join(self._text[begin:end] for begin, end in spans)
        return re.sub(rb"#.*", b"", text) if b"#" in text else text

    def words(self, key: str) -> Iterator[tuple[int, str]]:
        """Number and content of the lines that begin with the word `key`."""
        begin = (self._first == ord(key[0])) & (self._second == ord(key[1]))
        for line in np.flatnonzero(begin).tolist():
            text = bytes(self._text[self._starts[line] : self._ends[line]])
            word, content = (*text.split(maxsplit=1), b"", b"")[:2]
            if word == key.encode() and content:
                yield line, content.decode("utf-8", errors="replace").strip()

    def numbers(self, key: str, least: int) -> np.ndarray:
        """(n, m) the numbers of all lines of a kind, of which there are some, as many as the
        shortest has.

        Raises:
            MeshError: one has fewer than `least`.
            DeprecationWarning: one is not made of numbers; NumPy warns, and `read_mesh` raises it.
        """
        lines = self.found[key]
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
    """All faces of a file.

    Attributes:
        corners: (3, n) what each names of `_KINDS`, counted from 0, -1 for nothing; face by face.
        counts: (F,) corners of each face.
        lines: (F,) its line.
    """

    corners: np.ndarray
    counts: np.ndarray
    lines: np.ndarray

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """(3, T, 3) corners of the fans that the faces become, and (T,) which face each is of."""
        fans = self.counts - 2
        face = np.repeat(np.arange(len(fans)), fans)
        step = np.arange(len(face)) - (np.cumsum(fans) - fans)[face]
        begin = (np.cumsum(self.counts) - self.counts)[face]
        triangles = np.stack([begin, begin + step + 1, begin + step + 2], axis=1)
        return self.corners[:, triangles], face


@dataclass(eq=False)
class _Rows:
    """The numbers of the lines that faces name; a kind that none names is not read.

    Attributes:
        places: (N, 3).
        colors: (N, 3) of the same lines, if all have them.
        uv: (K, 2) float32.
        normals: (M + 1, 3), of which the first, of zeros, is for corners that name none.
    """

    places: np.ndarray
    colors: np.ndarray | None
    uv: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(cls, lines: _Lines, corners: np.ndarray) -> _Rows:
        """Those that (3, n) corners name, as `_Faces` has them."""
        found = [
            lines.numbers(kind, least) if (named >= 0).any() else np.empty((0, least))
            for kind, least, named in zip(_KINDS, (3, 2, 3), corners, strict=True)
        ]
        places, uv, normals = found
        return cls(
            places[:, :3],
            places[:, 3:6] if places.shape[1] >= 6 else None,
            uv[:, :2].astype(np.float32),
            np.concatenate([np.zeros((1, 3)), normals[:, :3]]),
        )


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
            bad = has & ((index == 0) | (index > known) | (index < -known))
            if bad.any():
                name, count_of = index[bad][0], known[bad][0]
                counted = "before it" if name < 0 else "counted from 1"
                raise MeshError(
                    f"a face names {kind} {name}, but there are {count_of}, {counted}; "
                    "export it again"
                )
            index += np.where(back, known, -1)
        corners.append(np.where(given, named, -1).astype(np.int32))
        counts.append(count)
    return _Faces(np.concatenate(corners, axis=1), np.concatenate(counts), rows)


def _corners(text: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(3, n) int, v, vt and vn of each corner, and (3, n) bool, where it has them; corners a face.

    Args:
        text: lines of faces, each corner "v", "v/vt", "v//vn" or "v/vt/vn" after a blank.

    Raises:
        MeshError: a corner is none of these.
        DeprecationWarning: it is not made of numbers, as of `_Lines.numbers`.
    """
    letters = np.frombuffer(text, dtype=np.uint8)
    slash, blank = letters == ord("/"), letters <= ord(" ")
    gap = slash | blank
    number = np.flatnonzero(~gap & np.roll(gap, 1))
    starts = np.flatnonzero(~blank & np.roll(blank, 1))
    found = np.fromstring(text.replace(b"/", b" "), sep=" ", dtype=np.int64)
    corner = np.searchsorted(starts, number, side="right") - 1
    if slash[starts].any():
        raise MeshError("has a corner that begins with no number; copy or export it again")
    before = np.cumsum(slash, dtype=np.int32)  # slashes up to each letter
    if np.diff(before[starts], append=before[-1:]).max(initial=0) > 2:
        raise MeshError("has a corner of more than v/vt/vn: it is damaged; copy it again")
    place = before[number] - before[starts][corner]
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


def _geometry(corners: np.ndarray, rows: _Rows) -> dict[str, Any]:
    """Triangles and what their corners name; texture coordinates only if all name them.

    Args:
        corners: (3, T, 3), as `_Faces.triangles` gives them.
        rows: what they name.
    """
    v, vt, vn = corners
    found = {}
    if (vn >= 0).any():
        pairs, faces = np.unique(v * np.int64(len(rows.normals)) + vn + 1, return_inverse=True)
        used, normal = np.divmod(pairs, len(rows.normals))
        found["vertex_normals"] = rows.normals[normal]
    elif v.size < len(rows.places):
        used, faces = np.unique(v, return_inverse=True)
    else:  # no sorting where most are named
        named = np.zeros(len(rows.places), dtype=bool)
        named[v] = True
        used, faces = np.flatnonzero(named), (np.cumsum(named) - 1)[v]
    if (vt >= 0).all():
        found["corner_uv"] = rows.uv[vt]
    if rows.colors is not None:
        found["vertex_colors"] = rows.colors[used]
    return {"vertices": rows.places[used], "faces": faces.reshape(v.shape), **found}
