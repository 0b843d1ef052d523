"""The dataset's folder: made, interrupted, taken up again, refused, read."""

import contextlib
import hashlib
import json
import multiprocessing
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from shards.archive import Shard, write_shard
from shards.dataset import Dataset, DatasetWriter
from shards.manifest import DatasetError
from shards.schema import SchemaError
from shards.splits import split_subjects

CONFIG = {"camera": {"pixel_size": 0.005}, "views": 3, "tags": ["a"]}
SUBJECTS = ["a", "b", "c", "d", "e"]


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "dataset"


VERSIONS = {"numpy": "1", "bpy": "4"}

# Opens the dataset and waits for a line, or says why it cannot.
HOLD = """
import json, sys
from shards.dataset import DatasetWriter
from shards.manifest import DatasetError
folder, config, planned, versions = map(json.loads, sys.argv[1:])
try:
    with DatasetWriter(folder, config, planned, 7, versions):
        print("writing", flush=True)
        sys.stdin.readline()
except DatasetError as error:
    print(error, flush=True)
"""


@pytest.fixture
def open_writer(folder):
    """open_writer(folder, ...): a writer; the one before is closed, as by its process's end."""
    last = contextlib.ExitStack()

    def open_writer(folder=folder, config=CONFIG, planned=SUBJECTS, versions=VERSIONS):
        last.close()
        return last.enter_context(DatasetWriter(folder, config, planned, 7, versions))

    with last:
        yield open_writer


@pytest.fixture
def add(arrays, meta, surfaces):
    def add(writer, subject, licence="CC0-1.0"):
        if not (writer.folder / "subjects" / "box.obj").exists():
            surfaces(writer.folder)
        written = write_shard(writer.shard_path(subject), arrays, {**meta, "subject": subject})
        writer.add(subject, *written, 1.0, licence)

    return add


@pytest.fixture
def whole(folder, open_writer, add):
    writer = open_writer()
    for subject in reversed(SUBJECTS):
        add(writer, subject)
    writer.finish()
    writer.close()
    return folder


def test_a_dataset_is_written_and_read(whole, arrays):
    dataset = Dataset(whole)
    assert dataset.subjects() == SUBJECTS == list(dataset.manifest)
    assert len(dataset.subjects("train")) == 4
    assert len(dataset.subjects("test")) == 1
    assert dataset.config == CONFIG
    assert dataset.failures == []
    np.testing.assert_array_equal(dataset.shard("c")["mask"], arrays["mask"])
    counts = dataset.description["counts"]
    assert counts == {
        "planned": 5, "subjects": 5, "failures": 0, "train": 4, "test": 1, "views": 15
    }  # fmt: skip
    assert dataset.description["totals"]["bytes"] == sum(
        path.stat().st_size for path in (whole / "shards").iterdir()
    )
    with pytest.raises(DatasetError, match="no finished subject 'z'"):
        dataset.shard("z")
    with pytest.raises(DatasetError, match="split 'val' is unknown"):
        dataset.subjects("val")


def test_the_document_is_croissant(whole):
    document = json.loads((whole / "dataset.json").read_text())
    assert document["@type"] == "sc:Dataset"
    assert document["conformsTo"] == "http://mlcommons.org/croissant/1.1"
    kinds = [node["@type"] for node in document["distribution"]]
    assert kinds == ["cr:FileObject"] * 5 + ["cr:FileSet"]
    manifest = Dataset(whole).manifest
    for node in document["distribution"][:5]:
        entry = next(e for e in manifest.values() if e.file == node["contentUrl"])
        assert node["sha256"] == entry.sha256
    fields = {f["@id"]: f for f in document["recordSet"][0]["field"]}
    assert fields["subjects/normal_back"]["arrayShape"] == "-1,64,96,3"
    assert fields["subjects/normal_back"]["dataType"] == "cr:Float16"
    ids = [*fields, *(node["@id"] for node in document["distribution"]), "subjects"]
    assert len(set(ids)) == len(ids)
    sets = {node["@id"] for node in document["distribution"]}
    assert all(f["source"]["fileSet"]["@id"] in sets for f in fields.values())


def test_the_card_tells_members_licence_and_config(whole):
    card = (whole / "README.md").read_text()
    assert "Redistributable: yes" in card
    assert "`depth_back` | (V, H, W) | float32" in card
    assert "radiance" not in card
    assert "64 x 96 pixels" in card
    assert '"pixel_size": 0.005' in card


def test_the_card_warns_of_a_licence_that_forbids_sharing(folder, open_writer, add):
    writer = open_writer(folder, planned=["a", "b"])
    add(writer, "a", "THuman2.0 (non-commercial, no sharing)")
    add(writer, "b")
    writer.finish()
    card = (folder / "README.md").read_text()
    assert "Redistributable: no" in card
    assert (
        "THuman2.0 (non-commercial, no sharing) (subjects: 1): not known to allow sharing" in card
    )


def test_the_card_s_snippet_runs(whole, monkeypatch):
    monkeypatch.chdir(whole)
    snippet = (whole / "README.md").read_text().split("```python\n")[1].split("```")[0]
    names = {}
    exec(snippet, names)
    assert (names["thickness"] >= 0).all()
    assert names["meta"]["licence"] == "CC0-1.0"


def test_descriptions_depend_on_content_only(tmp_path, open_writer, add):
    """Two builds, in other order, at another place, one of them interrupted: the same files."""
    texts = []
    for name, order in (("one", SUBJECTS), ("two", SUBJECTS[::-1])):
        for subject in order:  # a writer for each subject, as if killed after each
            writer = open_writer(tmp_path / name, planned=order)
            add(writer, subject)
        writer.finish()
        texts.append([(tmp_path / name / f).read_bytes() for f in ("dataset.json", "README.md")])
    assert texts[0] == texts[1]


def test_an_interrupted_build_goes_on_with_what_is_missing(folder, open_writer, add, arrays, meta):
    writer = open_writer(folder)
    for subject in ("a", "b", "c"):
        add(writer, subject)
    # Killed now: b's shard is cut, c's is gone, d's line is torn, e is in no line.
    path = writer.shard_path("b")
    path.write_bytes(path.read_bytes()[:-1])
    writer.shard_path("c").unlink()
    with (folder / "manifest.jsonl").open("ab") as file:
        file.write(b'{"file": "shards/d.npz", "byt')
    write_shard(writer.shard_path("e"), arrays, {**meta, "subject": "e"})
    (folder / "shards" / ".e.npz.host.1.tmp").write_bytes(b"half")

    writer = open_writer(folder)
    assert writer.finished == {"a"}
    for subject in ("b", "c", "d", "e"):
        add(writer, subject)
    assert Dataset(folder).subjects() == SUBJECTS, "the torn line has spoilt no later one"
    writer.finish()
    assert sorted(p.name for p in (folder / "shards").iterdir()) == [f"{s}.npz" for s in SUBJECTS]


def test_a_shard_of_the_right_size_that_is_torn_is_made_again(whole, open_writer):
    path = whole / "shards" / "a.npz"
    path.write_bytes(bytes(path.stat().st_size))
    assert open_writer(whole).finished == set(SUBJECTS) - {"a"}


@pytest.mark.parametrize("name", ["box.obj", "body.obj"])
def test_a_shard_whose_surface_is_lost_is_made_again(whole, open_writer, name):
    (whole / "subjects" / name).unlink()
    assert open_writer().finished == set()


def test_a_shard_whose_surface_was_edited_is_made_again(whole, open_writer, arrays, meta, add):
    mesh = whole / "subjects" / "box.obj"
    (whole / "subjects" / "other.obj").write_bytes(mesh.read_bytes())
    meta["mesh"] = "subjects/other.obj"
    writer = open_writer()
    add(writer, "c")
    mesh.write_bytes(mesh.read_bytes() + b"# edited\n")
    assert open_writer().finished == {"c"}


@pytest.mark.parametrize("edit", ["changed", "missing"])
def test_a_shard_one_of_whose_files_was_edited_is_made_again(
    whole, open_writer, arrays, meta, add, edit
):
    """A texture, say, or the fit of a body."""
    fit = whole / "subjects" / "fit.json"
    fit.write_text("{}")
    meta["files"] = {"subjects/fit.json": hashlib.sha256(b"{}").hexdigest()}
    writer = open_writer()
    add(writer, "c")
    assert open_writer().finished == {*SUBJECTS}
    if edit == "changed":
        fit.write_text("{ }")
    else:
        fit.unlink()
    assert open_writer().finished == {*SUBJECTS} - {"c"}


def test_a_shard_that_breaks_the_contract_is_made_again(whole, open_writer, arrays, meta):
    path = whole / "shards" / "a.npz"
    np.savez(path, **arrays, meta=np.array(json.dumps({**meta, "mesh": "../box.obj"})))
    manifest = whole / "manifest.jsonl"
    first, *rest = manifest.read_text().splitlines()
    first = json.dumps({**json.loads(first), "bytes": path.stat().st_size})
    manifest.write_text("\n".join([first, *rest]) + "\n")
    assert open_writer().finished == set(SUBJECTS) - {"a"}


def test_shards_of_other_versions_are_made_again(whole, open_writer, add):
    assert Dataset(whole).description["versions"] == VERSIONS
    newer = {**VERSIONS, "bpy": "5"}
    writer = open_writer(versions=newer)
    assert writer.finished == set()
    add(writer, "b")
    writer = open_writer(versions=newer)
    assert writer.finished == {"b"}
    writer.finish()
    assert Dataset(whole).description["versions"] == newer
    assert Dataset(whole).manifest["b"].versions == newer


def start_holder(folder):
    arguments = [str(folder), CONFIG, SUBJECTS, VERSIONS]
    return subprocess.Popen(
        [sys.executable, "-c", HOLD, *map(json.dumps, arguments)],
        cwd=Path(__file__).parents[2],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_a_second_process_may_not_write(whole, open_writer):
    users = "another build, sweep or training"
    busy = f"{whole} is in use by {users}; wait for it or choose another folder"
    writer = open_writer()
    with start_holder(whole) as other:
        assert other.communicate()[0] == busy + "\n"
    assert Dataset(whole).subjects() == SUBJECTS, "readers need no lock"
    writer.close()
    with start_holder(whole) as other:
        assert other.stdout.readline() == "writing\n"
        with pytest.raises(DatasetError, match=busy):
            open_writer()
        other.send_signal(signal.SIGKILL)
        other.wait()
    assert open_writer().finished == set(SUBJECTS), "a dead process holds no lock"


def test_a_writer_that_is_refused_holds_no_lock(whole, open_writer):
    with pytest.raises(DatasetError, match="another configuration") as kept:
        open_writer(config={})
    assert open_writer().finished == set(SUBJECTS), kept


def test_a_torn_last_line_is_ignored_by_readers(whole):
    path = whole / "manifest.jsonl"
    path.write_bytes(path.read_bytes()[:-5])
    assert Dataset(whole).subjects() == SUBJECTS[:-1]


def test_a_broken_line_in_the_middle_is_named(whole):
    path = whole / "manifest.jsonl"
    lines = path.read_text().splitlines()
    lines[2] = lines[2][:40]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(DatasetError, match="line 3 is no JSON object; remove the line"):
        Dataset(whole)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("bytes", "9"),
        ("bytes", -1),
        ("seconds", float("nan")),
        ("sha256", None),
        ("licence", []),
        ("versions", "1"),
        ("split", "val"),
    ],
)
def test_a_manifest_s_line_of_other_types_is_named(whole, key, value):
    path = whole / "manifest.jsonl"
    first, *rest = path.read_text().splitlines()
    first = json.dumps({**json.loads(first), key: value})
    path.write_text("\n".join([first, *rest]) + "\n")
    with pytest.raises(DatasetError, match=f"line 1: {key} is .*; remove the line and build again"):
        Dataset(whole)


@pytest.mark.parametrize("file", ["/etc/passwd", "../x.npz", "shards/../../x.npz"])
def test_a_manifest_that_leads_out_of_the_folder_is_refused(whole, file):
    path = whole / "manifest.jsonl"
    path.write_text(path.read_text().replace("shards/a.npz", file))
    with pytest.raises(DatasetError, match=r"line 1: file: .* no posix path below"):
        Dataset(whole)


def test_a_path_in_meta_stays_in_the_folder(whole):
    dataset = Dataset(whole)
    assert dataset.path("subjects/box.obj") == whole / "subjects" / "box.obj"
    for path in ("../x", "/x"):
        with pytest.raises(SchemaError, match="no posix path below"):
            dataset.path(path)


def test_another_configuration_is_refused_by_its_keys(whole, open_writer):
    other = {"camera": {"pixel_size": 0.004}, "views": 3, "tags": ["b"]}
    with pytest.raises(DatasetError) as caught:
        open_writer(whole, other)
    message = str(caught.value)
    assert "camera.pixel_size is 0.005 there and 0.004 here" in message
    assert 'tags is ["a"] there and ["b"] here' in message
    assert "views" not in message
    assert "choose another folder" in message
    assert "\n" not in message
    assert open_writer(whole, dict(reversed(CONFIG.items()))).finished == set(SUBJECTS)


def test_a_folder_of_other_things_is_refused_and_left_alone(folder, open_writer):
    folder.mkdir()
    (folder / "thesis.tex").write_text("x")
    with pytest.raises(DatasetError, match=r"is not empty and holds no dataset\.json"):
        open_writer(folder)
    assert [p.name for p in folder.iterdir()] == ["thesis.tex"]
    with pytest.raises(DatasetError, match="is a file"):
        open_writer(folder / "thesis.tex")
    with pytest.raises(DatasetError, match=r"holds no dataset\.json"):
        Dataset(folder)


def test_a_build_killed_at_its_very_start_can_begin_again(folder, open_writer):
    folder.mkdir()
    (folder / ".dataset.json.host.1.tmp").write_text("{")
    (folder / ".lock").touch()
    writer = open_writer(folder)
    writer.finish()
    assert [path.name for path in folder.glob(".*")] == [".lock"]
    assert Dataset(folder).subjects() == []


def test_another_schema_is_refused(whole):
    path = whole / "dataset.json"
    path.write_text(path.read_text().replace('"schema_version": 2', '"schema_version": 99'))
    with pytest.raises(DatasetError, match="has schema 99, this program reads 2"):
        Dataset(whole)


def test_failures_are_listed_and_cleared_when_tried_again(folder, open_writer, add):
    writer = open_writer(folder)
    writer.fail("c", "render", "the mesh has no faces")
    writer.fail("b", "subjects", "missing")
    add(writer, "a")
    writer.finish()
    assert [f["subject"] for f in Dataset(folder).failures] == ["b", "c"]
    assert Dataset(folder).description["counts"]["failures"] == 2
    writer = open_writer(folder)
    assert Dataset(folder).failures == []
    add(writer, "b")
    writer.fail("c", "render", "again")
    writer.finish()
    assert Dataset(folder).failures == [{"subject": "c", "stage": "render", "reason": "again"}]


def test_only_planned_subjects_with_good_names(folder, open_writer):
    writer = open_writer(folder)
    for call in (
        lambda: writer.shard_path("z"),
        lambda: writer.add("z", 1, "", 1, 1.0, ""),
    ):
        with pytest.raises(DatasetError, match="'z' is not planned"):
            call()
    with pytest.raises(SchemaError, match=r"subject id '\.\./z'"):
        open_writer(folder, planned=["../z"])
    with pytest.raises(DatasetError, match="'a' is planned 2 times"):
        open_writer(folder, planned=["a", "a"])


@pytest.mark.parametrize(
    ("count", "test"), [(0, 0), (1, 0), (2, 1), (4, 1), (5, 1), (7, 1), (8, 2), (10, 2), (526, 105)]
)
def test_splits_are_four_to_one(count, test):
    ids = [f"{i:04d}" for i in range(count)]
    splits = split_subjects(ids, seed=1)
    assert list(splits) == ids
    assert sum(split == "test" for split in splits.values()) == test
    assert split_subjects(ids[::-1], seed=1) == splits


def test_splits_follow_the_seed():
    ids = [f"{i:04d}" for i in range(100)]
    first, second = split_subjects(ids, 1), split_subjects(ids, 2)
    assert first != second
    both = sum(first[i] == second[i] == "test" for i in ids)
    assert both < 15, "20 of 100 each: 4 in common are expected"


def test_a_dataset_travels_to_a_spawned_process(whole, arrays):
    dataset = Dataset(whole)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        shard = pool.apply(dataset.shard, ("d",))
    assert isinstance(shard, Shard)
    np.testing.assert_array_equal(shard["depth_back"], arrays["depth_back"])
