"""Damaged files, drawn by the hundred: every reader ends with what it promises, soon and small.

The draws are the same in every run. FUZZ=20 draws twenty times as many.
"""

from __future__ import annotations

import io
import json
import os
import pickle  # noqa: TID251
import time
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from shards import schema
from shards.archive import Shard, ShardError, write_shard
from shards.checksum import file_sha256
from shards.dataset import Dataset
from shards.geometry import read_geometry
from shards.manifest import DatasetError, read_manifest
from shards.verify import verify
from subjects.fits.parameters import read_parameters
from subjects.fits.similarity import read_similarity
from subjects.limits import Limits
from subjects.mesh import MeshError
from subjects.meshfile import check_winding, read_mesh, read_texture
from tests.hostile import corpus
from tests.hostile.mutate import damaged, edits, exchanged
from tests.shards.conftest import closed_form_arrays, closed_form_meta

TIMES = float(os.environ.get("FUZZ", "1"))

LIMITS = Limits(mesh_mb=16, triangles=100_000, texture_megapixels=1, fit_mb=4)

MOST_BYTES = 2**28
"""Memory that reading one small file may take at its peak."""

MOST_SECONDS = 5.0
"""Of the processor, for one file."""


def fuzzed(examples: int) -> Callable[[Callable], Callable]:
    """So many draws, the same in every run; a fixture may serve them all."""
    return settings(
        max_examples=int(examples * TIMES),
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )


@contextmanager
def only(*errors: type[Exception]) -> Iterator[None]:
    """Within, these errors may come, in one line; neither others nor much memory or time."""
    start = time.process_time()
    tracemalloc.start()
    try:
        yield
    except errors as error:
        said = str(error)
    else:
        said = "nothing"
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert len(said.splitlines()) == 1, said
    assert peak < MOST_BYTES
    assert time.process_time() - start < MOST_SECONDS


def mesh_files() -> dict[str, dict[str, bytes]]:
    """A small mesh in every format: name of a case -> file -> content, the mesh's own first."""
    colored = corpus.ball()
    colored.visual.vertex_colors = np.arange(len(colored.vertices) * 4).reshape(-1, 4) % 256
    material = {"m.mtl": b"newmtl m\nKd 0.5 0.5 0.5\nmap_Kd t.png\n", "t.png": corpus.image("PNG")}
    return {
        "obj": {"a.obj": corpus.obj("m.mtl").encode(), **material},
        "mtl": {"m.mtl": material["m.mtl"], "a.obj": corpus.obj("m.mtl").encode()} | material,
        "ply": {"a.ply": corpus.ply_binary()},
        "ply in text": {"a.ply": corpus.ply_ascii().encode()},
        "ply with colours": {"a.ply": colored.export(file_type="ply")},
        "stl": {"a.stl": corpus.export("stl")},
        "stl in text": {"a.stl": corpus.export("stl_ascii").encode()},
        "glb": {"a.glb": corpus.glb()},
        "glb with colours": {"a.glb": colored.export(file_type="glb")},
        "gltf": {
            "a.gltf": corpus.gltf("a.bin").encode(),
            "a.bin": corpus.glb_parts(corpus.glb())[1],
        },
    }


def read_all(folder: Path) -> None:
    """Read the mesh in a folder as a build does, and as verify does."""
    path = next(path for path in folder.iterdir() if path.stem == "a" and path.suffix != ".bin")
    with only(MeshError):
        check_winding(read_mesh(path, LIMITS))
    with only(ValueError):
        read_geometry(path)


@pytest.mark.parametrize("kind", mesh_files())
def test_meshes(tmp_path: Path, kind: str) -> None:
    files = mesh_files()[kind]
    first = next(iter(files))
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)

    @fuzzed(40)
    @given(edits())
    def check(changes: list) -> None:
        (tmp_path / first).write_bytes(damaged(files[first], changes))
        read_all(tmp_path)

    check()


def test_gltf_of_other_values(tmp_path: Path) -> None:
    header, binary = corpus.glb_parts(corpus.gltf_image("t.png"))
    (tmp_path / "t.png").write_bytes(corpus.image("PNG"))

    @fuzzed(100)
    @given(exchanged(header))
    def check(changed: dict) -> None:
        (tmp_path / "a.glb").write_bytes(corpus.glb_of(json.dumps(changed).encode(), binary))
        read_all(tmp_path)

    check()


@pytest.mark.parametrize(
    "kind", ["BMP", "DDS", "GIF", "JPEG", "JPEG2000", "PNG", "PPM", "TGA", "TIFF", "WEBP"]
)
def test_textures(tmp_path: Path, kind: str) -> None:
    sound = corpus.image(kind, 32)

    @fuzzed(40)
    @given(edits())
    def check(changes: list) -> None:
        (tmp_path / "texture").write_bytes(damaged(sound, changes))
        with only(MeshError):
            assert read_texture(tmp_path / "texture", LIMITS).dtype == np.uint8

    check()


def parameter_files() -> dict[str, bytes]:
    """A sound fit in every format: file -> content."""
    values = {name: array.tolist() for name, array in corpus.PARAMETERS.items()}
    whole = io.BytesIO()
    np.savez(whole, **corpus.PARAMETERS)
    packed = corpus.npz(**{name: corpus.npy(a) for name, a in corpus.PARAMETERS.items()})
    return {
        "stored.npz": whole.getvalue(),
        "deflated.npz": packed,
        "objects.npy": corpus.npy(np.array(corpus.PARAMETERS, dtype=object)),
        "text.pkl": pickle.dumps(corpus.PARAMETERS, protocol=0),
        "binary.pkl": pickle.dumps(corpus.PARAMETERS, protocol=4),
        "fit.json": json.dumps(values).encode(),
    }


@pytest.mark.parametrize("name", parameter_files())
def test_fits(tmp_path: Path, name: str) -> None:
    sound = parameter_files()[name]

    @fuzzed(80)
    @given(edits())
    def check(changes: list) -> None:
        (tmp_path / name).write_bytes(damaged(sound, changes))
        with only(MeshError):
            read_parameters(tmp_path / name, LIMITS.fit_mb)

    check()


def test_members_of_fits(tmp_path: Path) -> None:
    """Damage within a member, whose checksum is right."""
    members = {name: corpus.npy(array) for name, array in corpus.PARAMETERS.items()}

    @fuzzed(80)
    @given(st.sampled_from(sorted(members)), edits())
    def check(name: str, changes: list) -> None:
        changed = members | {name: damaged(members[name], changes)}
        (tmp_path / "fit.npz").write_bytes(corpus.npz(**changed))
        with only(MeshError):
            read_parameters(tmp_path / "fit.npz", LIMITS.fit_mb)

    check()


def test_values_of_fits(tmp_path: Path) -> None:
    values = {name: array.tolist() for name, array in corpus.PARAMETERS.items()}
    placed = {"scale": 1.0, "rotation": np.eye(3).tolist(), "translation": [0, 0, 0]}

    @fuzzed(80)
    @given(exchanged(values), exchanged(placed))
    def check(fit: dict, similarity: dict) -> None:
        (tmp_path / "fit.json").write_text(json.dumps(fit))
        (tmp_path / "similarity.json").write_text(json.dumps(similarity))
        with only(MeshError):
            read_parameters(tmp_path / "fit.json", LIMITS.fit_mb)
        with only(MeshError):
            read_similarity(tmp_path / "similarity.json")

    check()


def read_shard(path: Path) -> None:
    """Everything in a shard, as a loader and as verify ask for it."""
    with only(ShardError, schema.SchemaError):
        shard = Shard(path)
        arrays = {name: shard[name] for name in shard.names}
        schema.check_meta(shard.meta, *schema.check_arrays(arrays))
        shard.view(len(shard) - 1)


@pytest.mark.parametrize("compression", ["stored", "deflate"])
def test_shards(tmp_path: Path, compression: Any) -> None:
    small = {name: array[:1] for name, array in closed_form_arrays(1).items()}
    write_shard(tmp_path / "sound.npz", small, closed_form_meta("box", 1), compression)
    sound = (tmp_path / "sound.npz").read_bytes()

    @fuzzed(80)
    @given(edits(), st.booleans())
    def check(changes: list, late: bool) -> None:
        # the directory lies at the end
        start = len(sound) - 3000 if late else 0
        (tmp_path / "a.npz").write_bytes(sound[:start] + damaged(sound[start:], changes))
        read_shard(tmp_path / "a.npz")

    check()


def test_members_of_shards(tmp_path: Path) -> None:
    """Damage within the members' headers, whose checksums are right."""
    write_shard(tmp_path / "sound.npz", closed_form_arrays(1), closed_form_meta("box", 1))
    with zipfile.ZipFile(tmp_path / "sound.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}

    @fuzzed(100)
    @given(st.sampled_from(sorted(members)), edits())
    def check(name: str, changes: list) -> None:
        header, rest = members[name][:128], members[name][128:]
        changed = members | {name: damaged(header, changes) + rest}
        (tmp_path / "a.npz").write_bytes(
            corpus.npz(**{key.removesuffix(".npy"): data for key, data in changed.items()})
        )
        read_shard(tmp_path / "a.npz")

    check()


@pytest.mark.parametrize("name", ["manifest.jsonl", "failures.jsonl", "dataset.json"])
def test_papers_of_a_dataset(dataset: Path, name: str) -> None:
    failure = {"subject": "a", "stage": "b", "reason": "c"}
    (dataset / "failures.jsonl").write_text(json.dumps(failure) + "\n")
    sound = (dataset / name).read_bytes()
    value = json.loads(sound)

    @fuzzed(80)
    @given(edits() | exchanged(value))
    def check(changes: Any) -> None:
        if isinstance(changes, list):
            content = damaged(sound, changes)
        else:
            content = json.dumps(changes).encode() + b"\n"
        (dataset / name).write_bytes(content)
        with only(DatasetError):
            read_manifest(dataset / "manifest.jsonl")
        with only(DatasetError):
            found = Dataset(dataset)
            assert len(found.subjects("train")) + len(found.subjects("test")) == len(found)
            assert all(isinstance(failure["reason"], str) for failure in found.failures)

    check()


def test_verify_of_other_values(dataset: Path) -> None:
    """Meta data exchanged in a shard that the manifest lists as it is."""
    arrays = closed_form_arrays(1)
    manifest = json.loads((dataset / "manifest.jsonl").read_text())
    shard = dataset / manifest["file"]

    @fuzzed(40)
    @given(exchanged(closed_form_meta("box", 1)))
    def check(meta: dict) -> None:
        members = {name: corpus.npy(array) for name, array in arrays.items()}
        members["meta"] = corpus.npy(np.array(json.dumps(meta)))
        shard.write_bytes(corpus.npz(**members))
        entry = manifest | {"bytes": shard.stat().st_size, "sha256": file_sha256(shard)}
        (dataset / "manifest.jsonl").write_text(json.dumps(entry) + "\n")
        with only(DatasetError):
            report = verify(dataset)
            assert all(len(breach.splitlines()) == 1 for breach in report.breaches)
            assert report.table()

    check()
