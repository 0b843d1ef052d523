"""The npz on disk: round trips, alignment, determinism, and every way a file can be broken."""

import io
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import zipfile
from multiprocessing.reduction import ForkingPickler
from pathlib import Path

import numpy as np
import pytest

from shards.archive import Shard, ShardError, write_shard
from shards.schema import MEMBERS, SchemaError
from storage.atomic import atomic_write, remove_temporary_files

ROOT = Path(__file__).parents[2]

# Writes a shard of full size, some 120 MB, to the path it is given.
WRITE_BIG = """
import sys, numpy as np
from pathlib import Path
from shards import schema
from shards.archive import write_shard
size = 14, 424, 512
arrays = {n: np.zeros(m.shape(*size), m.dtype) for n, m in schema.MEMBERS.items()}
meta = dict(schema_version=2, subject="box", source="", licence="CC0-1.0", mesh="subjects/box.obj",
    mesh_to_world=np.eye(4).tolist(), mesh_sha256="0" * 64, body=None, body_parameters={},
    camera=dict(size=size[1:], pixel_size=0.005, distance=2.0, center_height=0.9),
    light=dict(power=1.0, position=[0, 0, 0], exposure=1.0), cycles={}, sensor=dict(model="none"),
    seed=0, dropped_pixels=[0] * 14, versions={})
print("ready", flush=True)
write_shard(Path(sys.argv[1]), arrays, meta)
"""


@pytest.fixture
def path(tmp_path, arrays, meta):
    path = tmp_path / "box.npz"
    write_shard(path, arrays, meta)
    return path


@pytest.mark.parametrize("compression", ["stored", "deflate"])
def test_round_trip(tmp_path, arrays, meta, compression):
    path = tmp_path / "box.npz"
    size, sha256, views = write_shard(path, arrays, meta, compression)
    assert views == len(arrays["mask"])
    assert size == path.stat().st_size
    assert sha256 == subprocess.check_output(["sha256sum", path], text=True).split()[0]
    shard = Shard(path)
    assert shard.names == tuple(name for name in MEMBERS if name in arrays)
    assert len(shard) == len(arrays["mask"])
    assert shard.meta == meta
    for name, array in arrays.items():
        assert shard[name].dtype == MEMBERS[name].dtype
        assert not shard[name].flags.writeable
        np.testing.assert_array_equal(shard[name], array)
        np.testing.assert_array_equal(shard.view(1, [name])[name], array[1])
    assert set(shard.view(0)) == set(arrays)


@pytest.mark.parametrize("compression", ["stored", "deflate"])
def test_numpy_reads_it_without_pickle(tmp_path, arrays, meta, compression):
    path = tmp_path / "box.npz"
    write_shard(path, arrays, meta, compression)
    with np.load(path, allow_pickle=False) as loaded:
        assert set(loaded.files) == {*arrays, "meta"}
        for name, array in arrays.items():
            assert loaded[name].dtype == array.dtype
            np.testing.assert_array_equal(loaded[name], array)
        assert loaded["meta"].shape == ()
        assert json.loads(str(loaded["meta"])) == meta


def test_stored_members_are_mapped_and_aligned(path, arrays):
    shard = Shard(path)
    raw = path.read_bytes()
    for name, member in shard.members.items():
        assert member.offset % 64 == 0, name
        data = np.ascontiguousarray(arrays[name]).tobytes()
        assert raw[member.offset : member.offset + len(data)] == data, name
        assert shard[name].ctypes.data % 64 == 0, name
        assert not shard[name].flags.owndata
    assert zipfile.ZipFile(path).testzip() is None


def test_members_past_32_bit_sizes_stay_aligned(tmp_path, arrays, meta, monkeypatch):
    """The zip64 fields move the data: pretend the limit is low instead of writing 2 GiB."""
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", 10_000)
    path = tmp_path / "box.npz"
    write_shard(path, arrays, meta)
    monkeypatch.undo()
    raw = path.read_bytes()
    info = zipfile.ZipFile(path).getinfo("mask.npy")
    assert raw[info.header_offset + 4] == 45  # version needed: zip64
    shard = Shard(path)
    for name, member in shard.members.items():
        assert member.offset % 64 == 0, name
        np.testing.assert_array_equal(shard[name], arrays[name])
    with np.load(path) as loaded:
        np.testing.assert_array_equal(loaded["depth_back"], arrays["depth_back"])


@pytest.mark.parametrize("compression", ["stored", "deflate"])
def test_bytes_depend_on_content_only(tmp_path, arrays, meta, compression):
    first, second = tmp_path / "a.npz", tmp_path / "other name.npz"
    write_shard(first, arrays, meta, compression)
    os.utime(first, (0, 0))
    backwards = {name: np.asfortranarray(arrays[name]) for name in reversed(arrays)}
    write_shard(second, backwards, dict(reversed(meta.items())), compression)
    assert first.read_bytes() == second.read_bytes()


def test_a_view_is_a_copy(path, arrays):
    shard = Shard(path)
    view = shard.view(0, ["mask"])["mask"]
    view[:] = ~view
    np.testing.assert_array_equal(shard["mask"], arrays["mask"])
    with pytest.raises(IndexError, match="view 3 is not among 0 to 2"):
        shard.view(3)
    with pytest.raises(KeyError, match="no member 'depth'"):
        shard.view(0, ["depth"])


def test_a_writer_killed_in_the_middle_leaves_no_shard(tmp_path, arrays, meta):
    path = tmp_path / "box.npz"
    child = subprocess.Popen(
        [sys.executable, "-c", WRITE_BIG, str(path)], cwd=ROOT, stdout=subprocess.PIPE
    )
    child.stdout.readline()
    deadline = time.monotonic() + 60
    while sum(p.stat().st_size for p in tmp_path.iterdir()) < 5_000_000:
        assert child.poll() is None, "the child ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.001)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    assert not path.exists()
    assert len(list(tmp_path.iterdir())) == 1, "the temporary file of the dead writer"
    write_shard(path, arrays, meta)
    remove_temporary_files(tmp_path)
    assert list(tmp_path.iterdir()) == [path]
    np.testing.assert_array_equal(Shard(path)["mask"], arrays["mask"])


def test_a_failed_write_keeps_the_old_file(path):
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), atomic_write(path) as file:
        file.write(b"half" + bytes(1 // file.tell()))
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("part", [0.0, 0.001, 0.5, 0.999, 0.99999])
def test_a_truncated_shard_is_refused(path, part):
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * part)])
    with pytest.raises(ShardError, match=r"^\S+box\.npz is no whole shard: [^\n]+$"):
        Shard(path)


def test_no_flipped_byte_of_the_structure_goes_unseen(path, arrays, meta):
    """Whatever byte of the zip's structure is flipped: an error of ours, or the same content."""
    raw = path.read_bytes()
    members = Shard(path).members.values()
    data = np.zeros(len(raw), dtype=bool)
    for member in members:
        data[member.offset : member.offset + member.count * member.dtype.itemsize] = True
    structure = np.flatnonzero(~data)
    for position in structure[:: max(1, len(structure) // 400)]:
        broken = bytearray(raw)
        broken[position] ^= 0xFF
        path.write_bytes(broken)
        try:
            shard = Shard(path)
            found = {name: np.array(shard[name]) for name in shard.names}
        except ShardError:
            continue
        for name in set(found) & set(arrays):
            if found[name].dtype == arrays[name].dtype and found[name].shape == arrays[name].shape:
                np.testing.assert_array_equal(found[name], arrays[name])


def test_a_flipped_byte_of_deflated_data_is_refused(tmp_path, arrays, meta):
    path = tmp_path / "box.npz"
    write_shard(path, arrays, meta, "deflate")
    raw = bytearray(path.read_bytes())
    info = zipfile.ZipFile(path).getinfo("depth_front.npy")
    raw[info.header_offset + info.compress_size // 2] ^= 0xFF
    path.write_bytes(raw)
    with pytest.raises(ShardError, match=r"box\.npz"):
        Shard(path)["depth_front"]


@pytest.mark.parametrize("content", [b"", b"PK", b"not a zip" * 100])
def test_what_is_no_npz_is_refused(tmp_path, content):
    path = tmp_path / "box.npz"
    path.write_bytes(content)
    with pytest.raises(ShardError, match=r"box\.npz is no whole shard"):
        Shard(path)
    path.unlink()
    with pytest.raises(ShardError, match=r"box\.npz is missing"):
        Shard(path)


def test_a_zip_of_other_files_is_refused(tmp_path):
    path = tmp_path / "box.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(ShardError, match=r"'readme.txt' does not belong into an npz"):
        Shard(path)


def test_python_objects_are_refused_by_name_and_never_loaded(tmp_path, arrays, meta):
    touched = tmp_path / "touched"

    class Bomb:
        def __reduce__(self):
            return (Path.touch, (touched,))

    path = tmp_path / "box.npz"
    bombs = np.empty(2, dtype=object)
    bombs[:] = Bomb()
    np.savez(path, **{**arrays, "depth_front": bombs}, meta=np.array(json.dumps(meta)))
    with pytest.raises(ShardError, match="'depth_front' holds Python objects"):
        Shard(path)
    assert not touched.exists()
    with pytest.raises(SchemaError, match="'depth_front' has type object"):
        write_shard(path, {**arrays, "depth_front": bombs}, meta)


def test_a_plain_numpy_npz_is_read_as_well(tmp_path, arrays, meta):
    """Its members are not aligned, but they are whole."""
    path = tmp_path / "box.npz"
    np.savez(path, **arrays, meta=np.array(json.dumps(meta)))
    shard = Shard(path)
    for name, array in arrays.items():
        np.testing.assert_array_equal(shard[name], array)
        np.testing.assert_array_equal(shard.view(2, [name])[name], array[2])


def test_a_shard_travels_to_a_spawned_process(path, arrays):
    shard = Shard(path)
    assert shard["mask"].any()  # mapped before it is sent
    assert len(ForkingPickler.dumps(shard)) < 20_000, "maps must not travel"
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        view = pool.apply(shard.view, (1,))
    for name, array in arrays.items():
        np.testing.assert_array_equal(view[name], array[1])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_shard_is_read_on_both_sides_of_a_fork(path, arrays):
    shard = Shard(path)
    assert shard["mask"].any()
    with multiprocessing.get_context("fork").Pool(2) as pool:
        views = pool.map(shard.view, [0, 1, 2, 0, 1, 2])
    for i, view in enumerate(views):
        np.testing.assert_array_equal(view["normal_back"], arrays["normal_back"][i % 3])
    np.testing.assert_array_equal(shard["mask"], arrays["mask"])


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc")
def test_views_hold_no_file_open(path):
    before = len(list(Path("/proc/self/fd").iterdir()))
    shards = [Shard(path) for _ in range(50)]
    assert all(shard.view(0)["mask"].any() for shard in shards)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    mapped = shards[0]["mask"]
    shards[0].close()
    assert mapped.any(), "an array handed out stays good"


def test_meta_that_is_no_json_is_refused(tmp_path, arrays, meta):
    for value in (float("nan"), Path("x"), np.float32(1)):
        with pytest.raises(SchemaError, match="meta cannot be written as JSON"):
            write_shard(tmp_path / "box.npz", arrays, {**meta, "extra": value})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
def test_a_constant_that_is_no_json_is_refused_on_reading(tmp_path, arrays, meta, constant):
    path = tmp_path / "box.npz"
    meta["camera"]["distance"] = float(constant)
    np.savez(path, **arrays, meta=np.array(json.dumps(meta)))
    with pytest.raises(ShardError, match=f"'meta' holds {constant}, which is no finite number"):
        Shard(path)


def test_an_unknown_compression_names_the_known(tmp_path, arrays, meta):
    with pytest.raises(ValueError, match="use stored or deflate"):
        write_shard(tmp_path / "box.npz", arrays, meta, "zstd")


def test_a_npy_header_that_lies_about_its_size_is_refused(tmp_path, arrays, meta):
    path = tmp_path / "box.npz"
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": "<f4", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mask.npy", buffer.getvalue() + bytes(64))
    with pytest.raises(ShardError, match="'mask' is 192 bytes, its header says else"):
        Shard(path)
