"""Damaged and hostile datasets: readers and verify say what is wrong, in one line, and soon."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shards.archive import META_LIMIT, ShardError
from shards.checksum import file_sha256
from shards.dataset import Dataset
from shards.manifest import DatasetError
from shards.verify import verify
from tests.hostile import corpus
from tests.hostile.corpus import TERABYTE
from tests.shards.conftest import closed_form_arrays, closed_form_meta

ROOT = Path(__file__).parents[2]

MOST_BYTES = 2**28
"""Memory that a look at one small dataset may take at its peak."""


Change = Callable[[Path], object]


def shard_of(**members: bytes) -> Change:
    """Puts a shard of the box's members, these exchanged, in the place of one."""

    def write(path: Path) -> None:
        plain = {name: corpus.npy(array) for name, array in closed_form_arrays(1).items()}
        plain["meta"] = meta_of()
        path.write_bytes(corpus.npz(**(plain | members)))

    return write


def meta_of(**changes: Any) -> bytes:
    """The box's meta data, some exchanged, as the member that holds it."""
    return corpus.npy(np.array(json.dumps(closed_form_meta("box", 1) | changes)))


def content_of(change: Callable[[bytes], bytes]) -> Change:
    """Changes a file's bytes."""
    return lambda path: path.write_bytes(change(path.read_bytes()))


def special(make: Change) -> Change:
    """Puts a pipe or a link in the place of a file."""

    def write(path: Path) -> None:
        path.unlink()
        make(path)

    return write


def bomb(path: Path) -> None:
    """A shard whose directory claims that a member unpacks to terabytes, as its header does."""
    shard_of(mask=corpus.npy_that_claims(f"(1, 64, {TERABYTE})", "|b1"))(path)
    data = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        name, size = b"mask.npy", archive.getinfo("mask.npy").file_size
    entry = data.index(b"PK\1\2", data.rindex(name) - 46 - 4)
    claimed = size + 64 * TERABYTE
    extra = (1).to_bytes(2, "little") + (8).to_bytes(2, "little") + claimed.to_bytes(8, "little")
    # the size moves into an extra field of 64 bits
    data[entry + 24 : entry + 28] = b"\xff" * 4
    data[entry + 30 : entry + 32] = len(extra).to_bytes(2, "little")
    end = entry + 46 + len(name)
    data[end:end] = extra
    tail = data.rindex(b"PK\5\6")
    length = int.from_bytes(data[tail + 12 : tail + 16], "little") + len(extra)
    data[tail + 12 : tail + 16] = length.to_bytes(4, "little")
    path.write_bytes(data)


SHARDS: dict[str, tuple[Change, str]] = {
    "empty": (content_of(lambda data: b""), "no whole shard"),
    "truncated": (content_of(lambda data: data[:-100]), "no whole shard"),
    "halved": (content_of(lambda data: data[: len(data) // 2]), "no whole shard"),
    "flipped": (content_of(lambda data: corpus.flipped(data, (-60, 3), (-90, 4))), "shard"),
    "a pipe": (special(corpus.make_pipe), "no regular file"),
    "zeros without end": (special(corpus.link_to("/dev/zero")), "no regular file"),
    "a ring": (special(corpus.link_to("box.npz")), "cannot be opened"),
    "a folder": (special(Path.mkdir), "Is a directory"),
    "terabytes": (shard_of(mask=corpus.npy_that_claims(f"({TERABYTE}, 9, 9)", "|b1")), "'mask'"),
    "terabytes, unpacked": (bomb, "unpack to over"),
    "more than any number": (shard_of(mask=corpus.npy_that_claims(f"({'9' * 90},)")), "'mask'"),
    "a size below 0": (
        shard_of(mask=corpus.npy_that_claims("(-1, -8)", "|b1", bytes(8))),
        "'mask'",
    ),
    "a long meta": (shard_of(meta=corpus.npy(np.zeros((), f"<U{META_LIMIT // 4 + 1}"))), "meta"),
    "a meta without text": (shard_of(meta=corpus.npy(np.zeros(3))), "no text"),
    "a meta of objects": (
        shard_of(meta=corpus.npy(np.array(corpus.Payload(os.mkdir, corpus.CANARY), object))),
        "Python objects",
    ),
    "objects": (
        shard_of(mask=corpus.npy(np.array([corpus.Payload(os.mkdir, corpus.CANARY)], object))),
        "Python objects",
    ),
    "code in a header": (
        shard_of(mask=corpus.npy_that_claims(f"(__import__('os').mkdir('{corpus.CANARY}'),)")),
        "no whole shard",
    ),
    "a path": (lambda path: path.write_bytes(corpus.npz(**{"../out": b"x"})), "no whole shard"),
    "a mesh outside": (shard_of(meta=meta_of(mesh="../../secret.obj")), "no posix path"),
    "an absolute mesh": (shard_of(meta=meta_of(mesh="/etc/passwd")), "no posix path"),
    "a base outside": (
        shard_of(meta=meta_of(base={"shard": "../x", "contents": "0" * 64, "sha256": "0" * 64})),
        "no posix path",
    ),
    "files that are none": (shard_of(meta=meta_of(files=["../x"])), "meta.files"),
    "a mesh that is gone": (shard_of(meta=meta_of(mesh="subjects/gone.obj")), "missing"),
}
"""What stands in the place of a shard, and a word of what is found."""


def listed(dataset: Path) -> None:
    """Let the manifest state the shard's size and checksum as they are."""
    shard, manifest = dataset / "shards" / "box.npz", dataset / "manifest.jsonl"
    if shard.is_file():
        entry = json.loads(manifest.read_text())
        entry |= {"bytes": shard.stat().st_size, "sha256": file_sha256(shard)}
        manifest.write_text(json.dumps(entry) + "\n")


@pytest.mark.parametrize("kind", SHARDS)
def test_hostile_shards(
    dataset: Path, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write, word = SHARDS[kind]
    write(dataset / "shards" / "box.npz")
    listed(dataset)
    tracemalloc.start()
    report = verify(dataset)
    said = "box.npz"
    try:
        shard = Dataset(dataset).shard("box")
        for name in shard.names:
            assert shard[name].nbytes < MOST_BYTES
    except ShardError as error:
        said = str(error)
    assert "box.npz" in said
    assert len(said.splitlines()) == 1
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MOST_BYTES
    assert word in "\n".join(report.breaches)
    assert all(len(breach.splitlines()) == 1 for breach in report.breaches)
    assert not list(tmp_path.rglob(corpus.CANARY))


SURFACES: dict[str, tuple[str, Change, str]] = {
    "a pipe": ("obj", corpus.make_pipe, "no regular file"),
    "zeros without end": ("obj", corpus.link_to("/dev/zero"), "no regular file"),
    "a long number": (
        "obj",
        lambda path: path.write_text("v 0 0 0\n" * 999 + "v 0 0 " + "0" * 10**6),
        "letters",
    ),
    "vertices by terabytes": (
        "ply",
        lambda path: path.write_bytes(corpus.ply_binary({"vertex 162": f"vertex {TERABYTE}"})),
        "damaged",
    ),
    "json by gigabytes": (
        "glb",
        lambda path: path.write_bytes(corpus.glb()[:12] + b"\xff\xff\xff\x7f" + corpus.glb()[16:]),
        "damaged",
    ),
    "a buffer that is gone": (
        "gltf",
        lambda path: path.write_text(corpus.gltf("gone.bin")),
        "gone.bin",
    ),
    "a buffer outside": (
        "gltf",
        lambda path: path.write_text(corpus.gltf("../../../secret.bin")),
        "damaged",
    ),
}
"""What stands in the place of a mesh: its ending, what makes it, a word of what is found."""


@pytest.mark.parametrize("kind", SURFACES)
def test_hostile_surfaces(dataset: Path, tmp_path: Path, kind: str) -> None:
    ending, make, word = SURFACES[kind]
    (tmp_path / "secret.bin").write_bytes(corpus.glb_parts(corpus.glb())[1])
    make(dataset / "subjects" / f"hostile.{ending}")
    meta = meta_of(mesh=f"subjects/hostile.{ending}", body=None)
    shard_of(meta=meta)(dataset / "shards" / "box.npz")
    listed(dataset)
    tracemalloc.start()
    report = verify(dataset)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MOST_BYTES
    breaches = [breach for breach in report.breaches if f"hostile.{ending}" in breach]
    assert word in "\n".join(breaches)


def line_of(**changes: Any) -> Change:
    """Exchanges values in the manifest's line."""

    def write(dataset: Path) -> None:
        path = dataset / "manifest.jsonl"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes) + "\n")

    return write


def document_of(change: Callable[[dict], Any]) -> Change:
    """Changes dataset.json, or puts what `change` returns in its place."""

    def write(dataset: Path) -> None:
        path = dataset / "dataset.json"
        document = json.loads(path.read_text())
        changed = change(document)
        path.write_text(json.dumps(document if changed is None else changed))

    return write


def file_of(name: str, content: bytes) -> Change:
    """Puts a file of other bytes in the place of one."""
    return lambda dataset: (dataset / name).write_bytes(content)


def special_file(name: str, make: Change) -> Change:
    """Puts a pipe or a link in the place of one."""
    return lambda dataset: special(make)(dataset / name)


PAPERS: dict[str, tuple[Change, str]] = {
    "a shard outside": (line_of(file="../../secret.npz"), "no posix path"),
    "an absolute shard": (line_of(file="/etc/passwd"), "no posix path"),
    "a shard of a drive": (line_of(file="C:/secret.npz"), "no posix path"),
    "a subject with separators": (line_of(subject="../box"), "subject id"),
    "a subject with a null": (line_of(subject="box\0"), "subject id"),
    "a size without end": (line_of(bytes=float("inf")), "bytes"),
    "a line of binary": (file_of("manifest.jsonl", b"\xff\xfe\0\n"), "line 1"),
    "a line too deep": (file_of("manifest.jsonl", b"[" * 99_999 + b"\n"), "line 1"),
    "a number too long": (file_of("manifest.jsonl", b'{"a": ' + b"9" * 9999 + b"}\n"), "line 1"),
    "a manifest that is a pipe": (
        special_file("manifest.jsonl", corpus.make_pipe),
        "no regular file",
    ),
    "a manifest without end": (
        special_file("manifest.jsonl", corpus.link_to("/dev/zero")),
        "no regular file",
    ),
    "a manifest that is a folder": (special_file("manifest.jsonl", Path.mkdir), "directory"),
    "an empty document": (file_of("dataset.json", b""), "no dataset's"),
    "a torn document": (file_of("dataset.json", b'{"rectoverso": {'), "no dataset's"),
    "a binary document": (file_of("dataset.json", b"\x80\x04."), "no dataset's"),
    "a deep document": (file_of("dataset.json", b"[" * 99_999), "no dataset's"),
    "a document of a list": (document_of(lambda document: [document]), "no dataset's"),
    "a document of text": (document_of(lambda document: {"rectoverso": "x"}), "no dataset's"),
    "a document that is a pipe": (
        special_file("dataset.json", corpus.make_pipe),
        "no regular file",
    ),
    "a document that is a folder": (special_file("dataset.json", Path.mkdir), "directory"),
    "other splits": (
        document_of(lambda document: document["rectoverso"].update(splits=["box"])),
        "no dataset's",
    ),
}
"""What happens to a dataset's papers, and a word of what its reader says."""


@pytest.mark.parametrize("kind", PAPERS)
def test_hostile_papers(dataset: Path, kind: str) -> None:
    change, word = PAPERS[kind]
    change(dataset)
    for read in (Dataset, verify):
        with pytest.raises(DatasetError, match=word) as error:
            read(dataset)
        assert len(str(error.value).splitlines()) == 1


def test_verify_says_it_in_one_line_and_fails(dataset: Path) -> None:
    for change, status in ((lambda: None, 0), (lambda: bomb(dataset / "shards" / "box.npz"), 1)):
        change()
        command = [sys.executable, str(ROOT / "pipeline.py"), "verify", str(dataset)]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == status, result.stdout + result.stderr
        assert "Traceback" not in result.stderr
    shutil.rmtree(dataset / "shards")
    PAPERS["a shard outside"][0](dataset)
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
