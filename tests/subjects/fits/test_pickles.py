"""Pickles as fitting tools write them, as they break, and as an attacker would."""

from __future__ import annotations

import builtins
import bz2
import codecs
import collections
import functools
import gzip
import io
import lzma
import os
import pickle  # noqa: TID251 - to write pickles, and to show that the hostile ones are armed
import pickletools
import struct
import subprocess
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pytest
import torch
import trimesh

from subjects.fits.pickles import content, read_npy, read_npz, read_pickle
from subjects.fits.pickles.reader import DEEPEST
from subjects.mesh import MeshError

PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)

MOST_MEMORY = 48 * 2**20
"""Bytes that reading any small file may take."""


class Asks:
    """Pickles as a call of `function`, and as its state `state` where that is given."""

    def __init__(self, function: Callable[..., Any], *arguments: Any, state: Any = None) -> None:
        self.reduced = (function, arguments, state)

    def __reduce__(self) -> tuple:
        return self.reduced


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Any]:
    """Reads bytes as a pickle's file; whatever they are, that takes little memory."""
    return functools.partial(read_bytes, tmp_path / "fit.pkl")


def read_bytes(path: Path, data: bytes, reader: Callable = read_pickle, **options: Any) -> Any:
    path.write_bytes(data)
    tracemalloc.start()
    try:
        return reader(path, **options)
    except MeshError as error:
        check_line(str(error), path)
        raise
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < MOST_MEMORY


def check_line(message: str, path: Path) -> None:
    """One short line about `path`."""
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    assert len(message) < len(str(path)) + 300


def same(read: Any, written: Any) -> None:
    """Alike in value, type and element type, and arrays of one's own."""
    assert type(read) is type(written)
    if isinstance(written, dict):
        assert list(read) == list(written)
        same(list(read.values()), list(written.values()))
    elif isinstance(written, list | tuple):
        assert len(read) == len(written)
        for one, other in zip(read, written, strict=True):
            same(one, other)
    elif isinstance(written, np.ndarray):
        assert read.dtype == written.dtype.newbyteorder("=")
        assert read.shape == written.shape
        assert read.flags.writeable
        assert read.flags.c_contiguous
        if written.dtype.hasobject:
            same(read.ravel().tolist(), written.ravel().tolist())
        else:
            assert np.array_equal(read, written)
    else:
        assert read == written


def torch_saved(value: Any, *, is_zip: bool = True) -> bytes:
    file = io.BytesIO()
    torch.save(value, file, _use_new_zipfile_serialization=is_zip)
    return file.getvalue()


def joblib_saved(value: Any, **options: Any) -> bytes:
    file = io.BytesIO()
    joblib.dump(value, file, **options)
    return file.getvalue()


def npz(**arrays: Any) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def npy(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


PLAIN = {
    "none": None,
    "bools": [True, False],
    "ints": (0, 255, 65535, -1, 2**31, -(2**70)),
    "float": 0.1,
    "complex": 1 - 2j,
    "text": "Größe 人",
    "bytes": [b"", b"\x00\xff\n'"],
    "tuples": [(), (1,), (1, 2), (1, 2, 3), (1, 2, 3, 4)],
    "sets": [set(), {1, "a"}],
    "empty": [[], {}],
    7: {1.5: "deep"},
}

ARRAYS = {
    "float32": np.linspace(-1, 1, 10, dtype=np.float32).reshape(1, 10),
    "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "strided": np.arange(12)[::2],
    "big endian": np.arange(3, dtype=">i4"),
    "scalar": np.array(1.02, dtype=np.float64),
    "empty": np.zeros((0, 3)),
    "bool": np.array([True, False]),
    "text": np.array(["neutral", ""]),
    "bytes": np.array([b"ab", b"c"]),
    "complex": np.array([1j]),
    "objects": np.array([{"a": 1}, None, [2.0]], dtype=object),
    "object": np.array({"pelvis": np.arange(3)}, dtype=object),
    "objects of objects": np.array([[1, "a"], [2, np.ones(2)]], dtype=object, order="F"),
}


class TestPickle:
    @pytest.mark.parametrize("protocol", PROTOCOLS)
    def test_plain_values(self, read: Callable, protocol: int) -> None:
        same(read(pickle.dumps(PLAIN, protocol)), PLAIN)

    @pytest.mark.parametrize("protocol", PROTOCOLS)
    def test_their_kin_come_plain(self, read: Callable, protocol: int) -> None:
        kin = [collections.OrderedDict(a=1, b=2), frozenset([1]), bytearray(b"\xff"), bytearray()]
        same(read(pickle.dumps(kin, protocol)), [{"a": 1, "b": 2}, {1}, b"\xff", b""])

    @pytest.mark.parametrize("protocol", PROTOCOLS)
    @pytest.mark.parametrize("name", ARRAYS)
    def test_arrays(self, read: Callable, name: str, protocol: int) -> None:
        same(read(pickle.dumps({"array": ARRAYS[name]}, protocol)), {"array": ARRAYS[name]})

    @pytest.mark.parametrize("protocol", PROTOCOLS)
    @pytest.mark.parametrize("scalar", [np.float32(1.5), np.int64(-3), np.bool_(True)])
    def test_scalars(self, read: Callable, scalar: np.generic, protocol: int) -> None:
        same(read(pickle.dumps(scalar, protocol)), scalar)

    @pytest.mark.parametrize("protocol", PROTOCOLS)
    def test_tracked_arrays_come_plain(self, read: Callable, protocol: int) -> None:
        pose = np.arange(63, dtype=np.float32).reshape(1, 63)
        same(read(pickle.dumps(trimesh.caching.tracked_array(pose), protocol)), pose)

    @pytest.mark.parametrize("protocol", [2, 4])
    def test_names_of_numpy_2(self, read: Callable, protocol: int) -> None:
        """Protocol 4 tells the length of a name before it, protocol 2 ends it with its line."""
        written = pickle.dumps(ARRAYS["float32"], protocol)
        assert b"numpy.core.multiarray" in written
        written = written.replace(b"\x8c\x15numpy.core.", b"\x8c\x16numpy._core.")
        written = written.replace(b"cnumpy.core.", b"cnumpy._core.")
        assert b"numpy._core.multiarray" in written
        same(read(written), ARRAYS["float32"])

    def test_python_2_in_binary(self, read: Callable) -> None:
        written = (
            b"\x80\x02}q\x00U\x05\xe9tat\xe9cnumpy.core.multiarray\n_reconstruct\nq\x01cnumpy\n"
            b"ndarray\nK\x00\x85U\x01b\x87Rq\x02(K\x01K\x02\x85cnumpy\ndtype\nU\x02f4K\x00K\x01\x87R"
            b"(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U\x08"
            + np.array([1.5, -2], dtype="<f4").tobytes()
            + b"tbs."
        )
        same(read(written), {"étaté": np.array([1.5, -2], dtype=np.float32)})

    def test_python_2_in_text(self, read: Callable) -> None:
        written = (
            b"(dp0\nS'pose'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\n"
            b"tp4\nS'b'\np5\ntp6\nRp7\n(I1\n(L2L\ntp8\ncnumpy\ndtype\np9\n(S'f8'\np10\nI0\nI1\ntp11\nR"
            b"p12\n(I3\nS'<'\np13\nNNNI-1\nI-1\nI0\ntp14\nbI00\n"
            b"S'\\x00\\x00\\x00\\x00\\x00\\x00\\xf8?\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\xc0'\np15\n"
            b"tp16\nbsS'set'\nc__builtin__\nset\n((lp17\nF1.5\natRs."
        )
        same(read(written), {"pose": np.array([1.5, -2.0]), "set": {1.5}})

    def test_an_array_named_twice_is_one_a_list_two(self, read: Callable) -> None:
        array, items = np.ones(3), [1]
        first, second, one, other = read(pickle.dumps([array, array, items, items]))
        assert first is second
        assert one == other
        assert one is not other

    @pytest.mark.parametrize("compress", [gzip.compress, bz2.compress, lzma.compress])
    def test_compressed(self, read: Callable, compress: Callable) -> None:
        same(read(compress(pickle.dumps(PLAIN))), PLAIN)


class TestSchemas:
    """What fitting tools write, in the shapes and types that they write it in."""

    def test_thuman(self, read: Callable) -> None:
        generator = np.random.default_rng(0)
        shapes = {
            "betas": (1, 10),
            "expression": (1, 10),
            "global_orient": (1, 3),
            "body_pose": (1, 63),
            "jaw_pose": (1, 3),
            "left_hand_pose": (1, 12),
            "right_hand_pose": (1, 12),
            "scale": (),
            "translation": (3,),
        }
        fit = {name: generator.normal(size=shape) for name, shape in shapes.items()}
        fit = {name: np.array(value, dtype=np.float32) for name, value in fit.items()}
        tracked = {name: trimesh.caching.tracked_array(value) for name, value in fit.items()}
        tracked["scale"] = np.asarray(fit["scale"]).view(trimesh.caching.TrackedArray)
        assert type(tracked["translation"]) is trimesh.caching.TrackedArray
        same(read(pickle.dumps(tracked)), fit)

    def test_pixie(self, read: Callable) -> None:
        turns = np.tile(np.eye(3, dtype=np.float32), (21, 1, 1))
        fit = {
            "shape": np.zeros(200, dtype=np.float32),
            "exp": np.zeros(50, dtype=np.float32),
            "global_pose": turns[:1],
            "body_pose": turns,
            "head_pose": turns[:1],
            "left_hand_pose": turns[:15],
            "body_cam": np.array([8.5, 0.01, 0.2], dtype=np.float32),
        }
        same(read(pickle.dumps(fit, protocol=2)), fit)

    @pytest.mark.parametrize("compress", [0, 3])
    def test_pymaf(self, read: Callable, compress: int) -> None:
        fit = {
            "pred_cam": np.ones((2, 3), dtype=np.float32),
            "smplx_params": [
                {"shape": np.zeros((1, 10), dtype=np.float32), "gender": np.array([0])}
            ]
            * 2,
            "frame_ids": np.arange(2),
            "image_names": ["a.png", "b.png"],
            "joints3d": np.arange(12.0).reshape(2, 2, 3),
        }
        tensors = [{k: torch.from_numpy(v) for k, v in d.items()} for d in fit["smplx_params"]]
        same(read(joblib_saved({**fit, "smplx_params": tensors}, compress=compress)), fit)

    @pytest.mark.parametrize("name", ["joint2num", "part2num"])
    def test_model(self, read: Callable, name: str) -> None:
        members = {
            name: np.array({"Pelvis": 0, "Left_Hip": 1}, dtype=object),
            "v_template": np.ones((4, 3)),
            "f": np.arange(6, dtype=np.uint32).reshape(2, 3),
        }
        same(read(npz(**members), read_npz), members)

    def test_econ(self, read: Callable) -> None:
        fit = {"betas": torch.ones(1, 10), "scale": torch.tensor(1.5), "type": "smplx"}
        found = read(npy(fit), read_npy)
        assert found.shape == ()
        plain = {"betas": np.ones((1, 10), np.float32), "scale": np.array(1.5, np.float32)}
        same(found.item(), {**plain, "type": "smplx"})


FORMS = {
    "zip": torch_saved,
    "legacy": functools.partial(torch_saved, is_zip=False),
    "pickle": functools.partial(pickle.dumps, protocol=2),
    "joblib": joblib_saved,
}


@pytest.fixture
def _on_cuda() -> Iterator[None]:
    """Within, torch writes its tensors as lying on a GPU."""
    torch.serialization.register_package(1, lambda storage: "cuda:0", lambda storage, place: None)
    yield
    torch.serialization._package_registry[:] = [
        entry for entry in torch.serialization._package_registry if entry[0] != 1
    ]


@pytest.mark.parametrize("form", FORMS)
class TestTorch:
    def read(self, tmp_path: Path, form: str, value: Any) -> Any:
        return read_bytes(tmp_path / "output.pkl", FORMS[form](value))

    @pytest.mark.parametrize(
        "name",
        [
            "float16",
            "float32",
            "float64",
            "uint8",
            "int8",
            "int16",
            "int32",
            "int64",
            "bool",
            "complex64",
            "complex128",
        ],
    )
    def test_element_types(self, tmp_path: Path, form: str, name: str) -> None:
        tensor = torch.tensor([[0, 1, 1], [1, 0, 0]]).to(getattr(torch, name))
        same(self.read(tmp_path, form, tensor), tensor.numpy())

    def test_bfloat16_as_float32(self, tmp_path: Path, form: str) -> None:
        tensor = torch.tensor([1.0, -0.333, 3e38, float("inf")], dtype=torch.bfloat16)
        same(self.read(tmp_path, form, tensor), tensor.float().numpy())

    @pytest.mark.parametrize(
        "view",
        [
            lambda tensor: tensor.t(),
            lambda tensor: tensor[1:, ::2],
            lambda tensor: tensor[0, 1],
            lambda tensor: tensor[:, :0],
            lambda tensor: tensor[:1].expand(5, 4),
        ],
    )
    def test_views(self, tmp_path: Path, form: str, view: Callable) -> None:
        tensor = view(torch.arange(12.0).reshape(3, 4))
        same(self.read(tmp_path, form, tensor), tensor.numpy())

    def test_tensors_of_one_storage(self, tmp_path: Path, form: str) -> None:
        whole = torch.arange(6)
        same(self.read(tmp_path, form, [whole[:2], whole[2:]]), [np.arange(2), np.arange(2, 6)])

    def test_parameters_and_names(self, tmp_path: Path, form: str) -> None:
        value = {
            "weight": torch.nn.Parameter(torch.ones(2)),
            "size": torch.Size([1, 3]),
            "dtype": torch.float32,
            "device": torch.device("cuda", 0),
            "storage": torch.ones(2)._typed_storage(),
        }
        ones = np.ones(2, dtype=np.float32)
        names = {"size": (1, 3), "dtype": "torch.float32", "device": "cuda:0"}
        same(self.read(tmp_path, form, value), {"weight": ones, **names, "storage": ones})

    @pytest.mark.usefixtures("_on_cuda")
    def test_tensors_of_a_gpu(self, tmp_path: Path, form: str) -> None:
        tensor = torch.arange(3.0)
        assert b"cuda:0" in FORMS[form](tensor)
        same(self.read(tmp_path, form, tensor), tensor.numpy())


class TestOldTorch:
    def test_storages_of_cuda_classes(self, read: Callable) -> None:
        written = torch_saved(torch.arange(3.0), is_zip=False)
        assert written.count(b"ctorch\nFloatStorage\n") == 1
        written = written.replace(b"ctorch\nFloatStorage\n", b"ctorch.cuda\nFloatStorage\n")
        same(read(written), np.arange(3, dtype=np.float32))

    @pytest.mark.parametrize(("view", "fits"), [((1, 2), True), ((2, 3), False), ((-1, 2), False)])
    def test_views_of_storages(self, read: Callable, view: tuple, fits: bool) -> None:
        class Pickler(pickle.Pickler):
            def persistent_id(self, value: Any) -> Any:
                if isinstance(value, torch.storage.TypedStorage):
                    return "storage", torch.FloatStorage, "7", "cpu", 4, ("8", *view)
                return None

        file = io.BytesIO()
        for part in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}):
            file.write(pickle.dumps(part, protocol=2))
        Pickler(file, protocol=2).dump(torch.arange(2.0)._typed_storage())
        file.write(pickle.dumps(["7"], protocol=2) + struct.pack("<q4f", 4, 0, 1, 2, 3))
        if fits:
            same(read(file.getvalue()), np.array([1, 2], dtype=np.float32))
        else:
            with pytest.raises(MeshError):
                read(file.getvalue())


class TestJoblib:
    @pytest.mark.parametrize("protocol", [2, 3, 4, 5])
    @pytest.mark.parametrize("name", ARRAYS)
    def test_arrays(self, read: Callable, name: str, protocol: int) -> None:
        value = [ARRAYS[name], "between", ARRAYS[name]]
        same(read(joblib_saved(value, protocol=protocol)), value)

    @pytest.mark.parametrize("method", ["zlib", "gzip", "bz2", "lzma", "xz"])
    def test_compressed(self, read: Callable, method: str) -> None:
        written = joblib_saved(ARRAYS, compress=(method, 3))
        assert b"numpy" not in written
        same(read(written), ARRAYS)

    @pytest.mark.parametrize("start", [b"ZF0x0000", b"\x04\x22\x4d\x18"])
    def test_what_is_not_read_is_told(self, read: Callable, start: bytes) -> None:
        with pytest.raises(MeshError, match=r"joblib before 0\.10|LZ4"):
            read(start + bytes(20))


class TestNumpyFiles:
    @pytest.mark.parametrize("name", ARRAYS)
    def test_npz_and_npy(self, read: Callable, name: str) -> None:
        same(read(npz(a=ARRAYS[name]), read_npz), {"a": ARRAYS[name]})
        same(read(npy(ARRAYS[name]), read_npy), ARRAYS[name])

    def test_compressed(self, tmp_path: Path) -> None:
        np.savez_compressed(tmp_path / "fit.npz", pose=np.zeros(1000))
        same(read_npz(tmp_path / "fit.npz"), {"pose": np.zeros(1000)})

    def test_shape_beside_the_objects(self, read: Callable) -> None:
        written = npy(ARRAYS["objects"])
        with pytest.raises(MeshError, match="another array"):
            read(written.replace(b"(3,), ", b"(4,), "), read_npy)

    def test_error_names_the_member(self, read: Callable) -> None:
        written = npz(pose=np.zeros(3), part2num=np.array([Asks(os.getpid)], dtype=object))
        with pytest.raises(MeshError, match=r"member 'part2num': asks for posix\.getpid, "):
            read(written, read_npz)

    @pytest.mark.parametrize(
        "array",
        [np.zeros(2, dtype=[("a", "f4")]), np.array(["2020-01-01"], dtype="M8[D]")],
    )
    def test_other_types_are_told(self, read: Callable, array: np.ndarray) -> None:
        with pytest.raises(MeshError, match=r"type|records"):
            read(npy(array), read_npy)
        with pytest.raises(MeshError, match=r"type|records"):
            read(pickle.dumps(array))


# Hostile pickles, each with the name it asks for; "MARK" is the file they make when run.
ARMED: dict[str, Callable[[str], tuple[str, bytes]]] = {
    "os.system": lambda mark: ("posix.system", pickle.dumps(Asks(os.system, f"touch {mark}"))),
    "eval": lambda mark: (
        "builtins.eval",
        pickle.dumps(Asks(builtins.eval, f"open({mark!r}, 'w').close()")),
    ),
    "exec": lambda mark: (
        "builtins.exec",
        pickle.dumps(Asks(builtins.exec, f"open({mark!r}, 'w').close()")),
    ),
    "eval by Python 2's name": lambda mark: (
        "__builtin__.eval",
        pickle.dumps(Asks(builtins.eval, f"open({mark!r}, 'w').close()"), protocol=2),
    ),
    "Popen": lambda mark: (
        "subprocess.Popen",
        pickle.dumps([Asks(subprocess.Popen, ["touch", mark])]),
    ),
    "partial": lambda mark: (
        "functools.partial",
        pickle.dumps(Asks(functools.partial(os.system, f"touch {mark}"))),
    ),
    "getattr": lambda mark: (
        "builtins.getattr",
        b"cbuiltins\ngetattr\n(cbuiltins\n__import__\n(Vos\ntRVsystem\ntR(Vtouch %b\ntR."
        % mark.encode(),
    ),
    "__import__": lambda mark: (
        "builtins.__import__",
        b"(cbuiltins\n__import__\n(Vos\ntR0cos\nsystem\n(Vtouch %b\ntR." % mark.encode(),
    ),
    "GLOBAL": lambda mark: ("os.system", b"cos\nsystem\n(S'touch %b'\ntR." % mark.encode()),
    "INST": lambda mark: ("os.system", b"(S'touch %b'\nios\nsystem\n." % mark.encode()),
    "OBJ": lambda mark: ("os.system", b"(cos\nsystem\nS'touch %b'\no." % mark.encode()),
    "BUILD": lambda mark: (
        "os.system",
        b"ccollections\nOrderedDict\n)R}(V__setstate__\ncos\nsystem\nubVtouch %b\nb."
        % mark.encode(),
    ),
    "attributes of attributes": lambda mark: (
        "numpy.ctypeslib.os.system",
        b"\x80\x04Vnumpy\nVctypeslib.os.system\n\x93Vtouch %b\n\x85R." % mark.encode(),
    ),
    "in a torch storage's bytes": lambda mark: (
        "posix.system",
        pickle.dumps(
            Asks(
                torch.storage._load_from_bytes,
                torch_saved(Asks(os.system, f"touch {mark}"), is_zip=False),
            )
        ),
    ),
    "in a joblib array of objects": lambda mark: (
        "posix.system",
        joblib_saved(np.array([1, Asks(os.system, f"touch {mark}")], dtype=object)),
    ),
    "in an array of objects": lambda mark: (
        "posix.system",
        pickle.dumps(np.array([Asks(os.system, f"touch {mark}")], dtype=object)),
    ),
    "in a torch file": lambda mark: (
        "posix.system",
        torch_saved({"a": torch.ones(1), "b": Asks(os.system, f"touch {mark}")}),
    ),
    "in a legacy torch file": lambda mark: (
        "posix.system",
        torch_saved([torch.ones(1), Asks(os.system, f"touch {mark}")], is_zip=False),
    ),
    "in a compressed joblib file": lambda mark: (
        "posix.system",
        joblib_saved([Asks(os.system, f"touch {mark}")], compress=3),
    ),
}


def run(data: bytes) -> Any:
    """What a trusting reader does."""
    file = io.BytesIO(data)
    if b"NumpyArrayWrapper" in data or data.startswith(b"\x78"):
        return joblib.load(file)
    if data.startswith(b"PK") or torch_saved(0, is_zip=False)[:14] in data[:14]:
        return torch.load(file, weights_only=False)
    return pickle.loads(data)


class TestHostile:
    @pytest.mark.parametrize("name", ARMED)
    def test_nothing_runs(self, read: Callable, tmp_path: Path, name: str) -> None:
        mark = tmp_path / "ran"
        asked, data = ARMED[name](str(mark))
        with pytest.raises(MeshError) as raised:
            read(data)
        assert f": asks for {asked}, which is no array or plain container; " in str(raised.value)
        assert "nothing in it was run. Export the parameters again as npz or JSON" in str(
            raised.value
        )
        assert not mark.exists()

        done = run(data)
        for process in done if isinstance(done, list) else []:
            if isinstance(process, subprocess.Popen):
                process.wait()
        assert mark.exists(), "the payload is not armed"

    def test_nothing_runs_in_an_npz(self, read: Callable, tmp_path: Path) -> None:
        mark = tmp_path / "ran"
        data = npz(joint2num=np.array([Asks(os.system, f"touch {mark}")], dtype=object))
        with pytest.raises(MeshError, match=r"member 'joint2num': asks for posix\.system, which"):
            read(data, read_npz)
        assert not mark.exists()
        with np.load(io.BytesIO(data), allow_pickle=True) as arrays:
            assert arrays["joint2num"].tolist() == [0]
        assert mark.exists(), "the payload is not armed"

    @pytest.mark.parametrize(
        ("data", "told"),
        [
            (b"\x80\x04\x8c\x05numpy\x8c\x11ndarray.__class__\x93.", "numpy.ndarray.__class__"),
            (b"\x80\x04\x8c\x05numpy\x8c\x0edtype.__init__\x93.", "numpy.dtype.__init__"),
            (b"\x80\x04\x8c\x00\x8c\x04eval\x93.", ".eval"),
            (b"cnumpy.core.multiarray\nfromfile\n.", "numpy.core.multiarray.fromfile"),
            (b"ccopyreg\n_reconstructor\n(c", "copyreg._reconstructor"),
            (b"cbuiltins\ntype\n.", "builtins.type"),
            (b"cos\nsys\x1b[31m\ntem\n.", r"os.sys\x1b[31m"),
            (b"c" + b"x" * 10_000 + b"\ny\n.", "x" * 100),
            (b"Pevil id\n.", "persistent id 'evil id'"),
            (b"Vevil id\nQ.", "persistent id 'evil id'"),
            (b"\x80\x02\x82\x01.", "EXT1"),
            (b"\x80\x02\x83\x01\x00.", "EXT2"),
            (b"\x80\x02\x84\x01\x00\x00\x00.", "EXT4"),
            (b"\x80\x04cnumpy\nndarray\n)}\x92.", "NEWOBJ_EX"),
            (b"\x80\x05\x97.", "NEXT_BUFFER"),
            (b"cnumpy\nndarray\n)R.", "calls numpy.ndarray"),
            (b"ctorch\nFloatStorage\n(I9\ntR.", "calls torch.FloatStorage"),
            (b"Vbuiltins.bytes\n)R.", "calls builtins.bytes"),
            (b"}(V__class__\nNdb.", "nothing can be told|where there can be none|is truncated"),
            (b"]}b.", "list where there can be none"),
        ],
    )
    def test_is_told_by_name(self, read: Callable, data: bytes, told: str) -> None:
        with pytest.raises(MeshError) as raised:
            read(data)
        assert any(part in str(raised.value) for part in told.split("|"))

    @pytest.mark.parametrize(
        "ask",
        [
            Asks(codecs.encode, "a", "rot13"),
            Asks(codecs.encode, b"a" * 99, "zlib_codec"),
            Asks(codecs.encode, ["a"], "latin1"),
            Asks(codecs.encode, "a", "latin1", "backslashreplace"),
            Asks(bytes, 10**12),
            Asks(bytearray, 10**12),
            Asks(bytes, [1, 2]),
            Asks(complex, "nonsense"),
            Asks(set, [[1]]),
            Asks(set, [((),)]),
            Asks(collections.OrderedDict, [((1, 2), 3)]),
            Asks(collections.OrderedDict, 7),
            Asks(np.dtype, "V999999999"),
            Asks(np.core.multiarray._reconstruct, np.ndarray, (10**12,), b"b"),
            Asks(
                np.core.multiarray._reconstruct,
                np.ndarray,
                (0,),
                b"b",
                state=(1, (10**12,), np.dtype("f4"), False, b"abcd"),
            ),
            Asks(
                np.core.multiarray._reconstruct,
                np.ndarray,
                (0,),
                b"b",
                state=(1, (2**32, 2**32), np.dtype("f4"), False, b""),
            ),
            Asks(
                np.core.multiarray._reconstruct,
                np.ndarray,
                (0,),
                b"b",
                state=(1, (-1, -1), np.dtype("f4"), False, b"abcd"),
            ),
            Asks(
                np.core.multiarray._reconstruct,
                np.ndarray,
                (0,),
                b"b",
                state=(1, (1,), np.dtype("O"), False, b"\x00" * 8),
            ),
            Asks(
                np.core.multiarray._reconstruct,
                np.ndarray,
                (0,),
                b"b",
                state=(1, (10**9,), np.dtype("O"), False, [None]),
            ),
            Asks(
                np.core.multiarray._reconstruct,
                np.ndarray,
                (0,),
                b"b",
                state=(1, (1,), np.dtype("U1"), False, b"\xff\xff\xff\x7f"),
            ),
            Asks(np.core.multiarray._reconstruct, float, (0,), b"b", state=(1, (), 2, 3, b"")),
            Asks(np.core.multiarray.scalar, np.dtype("O"), [1]),
            Asks(np.core.multiarray.scalar, np.dtype("S999999999"), b""),
            Asks(np.core.numeric._frombuffer, b"abcd", np.dtype("f4"), (10**12,), "C"),
            Asks(np.core.numeric._frombuffer, b"", np.dtype("S0"), (10**12,), "C"),
            Asks(np.core.numeric._frombuffer, b"abcd", "f4,f4", (1,), "C"),
            Asks(
                np.core.numeric._frombuffer,
                np.array([None], dtype=object),
                np.dtype("i8"),
                (1,),
                "C",
            ),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 0, (5,), (1,)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 0, (2, 2), (3, 1)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 3, (2,), (1,)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), -1, (1,), (1,)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 3, (2,), (-1,)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 0, (10**6, 10**6), (0, 0)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 0, (2, 2), (1,)),
            Asks(torch._utils._rebuild_tensor, np.array([None]), 0, (1,), (1,)),
            Asks(torch._utils._rebuild_tensor, b"abcdefgh", 0, (1,), (1,)),
            Asks(torch._utils._rebuild_parameter),
            Asks(torch.storage._load_from_bytes, b""),
            Asks(torch.storage._load_from_bytes, 10**12),
            Asks(torch.storage._load_from_bytes, pickle.dumps(5) * 5),
            Asks(torch.Size, 7),
            Asks(torch.Size, b"abc"),
            Asks(torch.device, ["cpu"]),
            Asks(torch.device, "cuda", [0]),
            Asks(set, np.arange(3)),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 0, b"\x01", b"\x01"),
            Asks(torch._utils._rebuild_tensor, np.arange(4.0), 0, (1,) * 33, (1,) * 33),
        ],
    )
    def test_admitted_functions_with_hostile_arguments(self, read: Callable, ask: Asks) -> None:
        for protocol in PROTOCOLS:
            with pytest.raises(MeshError):
                read(pickle.dumps([ask], protocol))

    def test_tensor_beyond_its_storage(self, read: Callable) -> None:
        ask = Asks(torch._utils._rebuild_tensor, np.arange(4.0), 1, (2, 2), (2, 1))
        with pytest.raises(MeshError, match="a tensor that reaches element 4 of 4; "):
            read(pickle.dumps(ask))

    @pytest.mark.parametrize("shape", [(10**12,), (2**63,), (-1,), (1.5,)])
    def test_shapes_of_joblib_and_npy(self, read: Callable, shape: tuple) -> None:
        wrapper = joblib.numpy_pickle.NumpyArrayWrapper(np.ndarray, shape, "C", np.dtype("f4"))
        with pytest.raises(MeshError):
            read(pickle.dumps(wrapper)[:-1] + b"\x01\xffabcd.")
        header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}\n".encode()
        npy_file = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + b"abcd"
        with pytest.raises(MeshError):
            read(npy_file, read_npy)

    def test_storage_that_claims_more_than_it_has(self, read: Callable) -> None:
        written = torch_saved(torch.arange(3.0), is_zip=False)
        size = struct.pack("<q", 3)
        assert written.count(size) == 1
        for claimed in (4, 2, 10**12, -1, -(10**12)):
            with pytest.raises(MeshError):
                read(written.replace(size, struct.pack("<q", claimed)))


def deep(start: bytes, step: bytes, count: int = 100_000) -> bytes:
    return b"\x80\x04" + start + step * count + b"."


class TestBombs:
    """Files of a megabyte at most that would take all memory or the interpreter's stack."""

    @pytest.mark.parametrize(
        "data",
        [
            b"\x80\x04" + b"]" * 100_000 + b"a" * 99_999 + b".",
            deep(b")", b"\x85"),
            # hashing such a tuple overruns the C stack of the standard library's reader
            b"\x80\x04})" + b"\x85" * 100_000 + b"Ns.",
            b"\x80\x04" + b"}N" * 50_000 + b"N" + b"s" * 50_000 + b".",
            deep(b"N", b"Q"),
            b"\x80\x04ccollections\nOrderedDict\n\x940"
            + b"h\x00" * 50_000
            + b")"
            + b"R\x85" * 50_000
            + b".",
            b"\x80\x04" + b"}" * 50_000 + b"b" * 49_999 + b".",
            b"\x80\x04]\x94h\x00a.",
            b"\x80\x04}\x94Nh\x00s.",
        ],
    )
    def test_nested(self, read: Callable, data: bytes) -> None:
        with pytest.raises(MeshError, match=r"levels deep|outside itself"):
            read(data)

    def test_as_deep_as_told(self, read: Callable) -> None:
        assert str(read(deep(b"]", b"\x85", DEEPEST - 1))).count("(") == DEEPEST - 1
        with pytest.raises(MeshError, match="over 64 levels"):
            read(deep(b"]", b"\x85", DEEPEST + 1))

    @pytest.mark.parametrize(
        "data",
        [
            deep(b"N", b"2\x86", 60),
            b"\x80\x04}(N" + b"2\x86" * 60 + b"Nu.",
            b"\x80\x04(" + b"N" * 50_000 + b"l\x940(" + b"h\x00" * 50_000 + b"l.",
            b"\x80\x04cbuiltins\nset\n\x94((" + b"N" * 50_000 + b"lt\x940(" + b"h\x00h\x01R" * 9999,
        ],
    )
    def test_sharing(self, read: Callable, data: bytes) -> None:
        with pytest.raises(MeshError, match=r"unpacks to more|truncated"):
            read(data, largest_mb=8)

    def test_sharing_an_array_costs_nothing(self, read: Callable) -> None:
        array = np.zeros(2**17)
        found = read(pickle.dumps([array] * 1000), largest_mb=4)
        assert len(found) == 1000
        assert all(each is found[0] for each in found)

    @pytest.mark.parametrize("is_zip", [True, False])
    def test_views_cost_their_own_size(self, read: Callable, is_zip: bool) -> None:
        frames = torch.arange(2**17)
        found = read(torch_saved(list(frames.split(2**10)), is_zip=is_zip), largest_mb=4)
        assert np.array_equal(np.concatenate(found), frames)

    def test_memo(self, read: Callable) -> None:
        assert read(b"\x80\x04Nr\xff\xff\xff\xff.") is None

    @pytest.mark.parametrize("opcode", [b"\x8d", b"\x8e", b"\x96", b"\x95"])
    def test_claimed_lengths(self, read: Callable, opcode: bytes) -> None:
        data = b"\x80\x05" + opcode + struct.pack("<Q", 2**40) + b"abc."
        with pytest.raises(MeshError, match="is truncated or no pickle"):
            read(data)

    def test_steps(self, read: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
        data = pickle.dumps([torch.ones(1) for _ in range(20)])
        outside = sum(1 for _ in pickletools.genops(data))
        monkeypatch.setattr(content, "MOST_OPCODES", outside + 20 * 200)
        assert len(read(data)) == 20
        for most in (outside - 1, outside + 100):  # the storages' pickles count too
            monkeypatch.setattr(content, "MOST_OPCODES", most)
            with pytest.raises(MeshError, match=f"takes over {most} steps"):
                read(data)

    @pytest.mark.parametrize(
        "compress", [zlib.compress, gzip.compress, bz2.compress, lzma.compress]
    )
    def test_compressed(self, read: Callable, compress: Callable) -> None:
        data = compress(bytes(2**26))
        with pytest.raises(MeshError, match="unpacks to more than it may"):
            read(data, largest_mb=4)

    @pytest.mark.parametrize(("name", "reader"), [("a/data.pkl", read_pickle), ("a.npy", read_npz)])
    def test_zipped(self, read: Callable, name: str, reader: Callable) -> None:
        def packed(size: int, method: int) -> bytes:
            file = io.BytesIO()
            with zipfile.ZipFile(file, "w", method) as archive:
                archive.writestr(name, bytes(size))
            return file.getvalue()

        with pytest.raises(MeshError, match="unpacks to more than it may"):
            read(packed(2**26, zipfile.ZIP_DEFLATED), reader, largest_mb=4)
        honest = packed(2**26, zipfile.ZIP_DEFLATED)
        lying = honest.replace(struct.pack("<I", 2**26), struct.pack("<I", 999))
        assert lying != honest
        with pytest.raises(MeshError):
            read(lying, reader, largest_mb=4)
        # the standard library unpacks these without a bound
        for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
            with pytest.raises(MeshError, match="otherwise than by deflate"):
                read(packed(999, method), reader)

    def test_one_member_of_a_torch_file_under_many_names(self, read: Callable) -> None:
        file = io.BytesIO(torch_saved([torch.zeros(2**18) for _ in range(9)]))
        same(read(file.getvalue(), largest_mb=32), [np.zeros(2**18, np.float32)] * 9)
        with pytest.raises(MeshError, match="unpacks to more than it may"):
            read(file.getvalue(), largest_mb=12)

    def test_file_too_large(self, read: Callable) -> None:
        with pytest.raises(MeshError, match="more than it may"):
            read(bytes(2**21), largest_mb=1)


SMALL = {
    "pose": np.ones((1, 3), dtype=np.float32),
    "tensor": torch.arange(2.0),
    "objects": np.array([{"a": 1}], dtype=object),
    "names": ["a", "ä", 2**40, {1}],
}

FILES: dict[str, tuple[Callable, bytes]] = {
    **{f"protocol {p}": (read_pickle, pickle.dumps(SMALL, p)) for p in (0, 2, 4, 5)},
    "joblib": (read_pickle, joblib_saved(SMALL)),
    **{m: (read_pickle, joblib_saved(SMALL, compress=(m, 3))) for m in ("zlib", "bz2", "xz")},
    "zip": (read_pickle, torch_saved(SMALL)),
    "legacy": (read_pickle, torch_saved(SMALL, is_zip=False)),
    "npz": (read_npz, npz(pose=SMALL["pose"], objects=SMALL["objects"])),
    "npy": (read_npy, npy(SMALL["objects"])),
}


@pytest.mark.parametrize("name", FILES)
class TestDamage:
    def test_truncated_anywhere(self, read: Callable, name: str) -> None:
        reader, data = FILES[name]
        read(data, reader)
        for end in range(len(data)):
            with pytest.raises(MeshError):
                read(data[:end], reader)

    def test_changed_anywhere(self, read: Callable, name: str) -> None:
        reader, data = FILES[name]
        generator = np.random.default_rng(0)
        errors = 0
        for _ in range(400):
            damaged = np.frombuffer(data, np.uint8).copy()
            count = generator.integers(1, 4)
            damaged[generator.integers(len(data), size=count)] = generator.integers(256, size=count)
            try:
                read(damaged.tobytes(), reader)
            except MeshError:
                errors += 1
        assert errors > 100


class TestFiles:
    @pytest.mark.parametrize("reader", [read_pickle, read_npz, read_npy])
    def test_missing_and_empty(self, tmp_path: Path, reader: Callable) -> None:
        with pytest.raises(MeshError, match=r"fit\.pkl: cannot be opened \(No such file"):
            reader(tmp_path / "fit.pkl")
        for other in (tmp_path, Path("/dev/zero")):
            with pytest.raises(MeshError, match=r"cannot be opened \(it is no file\)"):
                reader(other)
        (tmp_path / "fit.pkl").touch()
        with pytest.raises(MeshError, match=r"fit\.pkl: is truncated or no "):
            reader(tmp_path / "fit.pkl")

    @pytest.mark.parametrize("data", [b"hello", b"{}", b"PK\x03\x04", b"x\x9c", bytes(99)])
    def test_no_pickle(self, read: Callable, data: bytes) -> None:
        with pytest.raises(MeshError, match="is truncated"):
            read(data)

    def test_npz_is_no_torch_file(self, read: Callable) -> None:
        with pytest.raises(MeshError, match=r"none of torch\.save"):
            read(npz(a=np.zeros(1)))
