"""Datasets in a store: written, taken up again, read and proven."""

from __future__ import annotations

import uuid

import numpy as np
import pytest

from shards.archive import write_shard
from shards.dataset import Dataset, DatasetWriter
from shards.manifest import DatasetError
from shards.verify import verify
from storage.mirror import Mirror, builds
from storage.store import Store, StoreError


@pytest.fixture
def url(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return f"memory://{uuid.uuid4().hex}/people"


def writer(url, meta, config=None, planned=("box",)):
    mirror = Mirror(url, builds())
    return DatasetWriter(
        mirror.folder, config or {"a": 1}, planned, 7, meta["versions"], mirror=mirror
    )


def fill(url, tmp_path, arrays, meta, surfaces, finish=True):
    """As a build does: a worker's files go to the store, and the writer is told."""
    work = tmp_path / "work"
    (work / "subjects" / "box").mkdir(parents=True)
    surfaces(work)
    (work / "subjects" / "box" / "subject.json").write_text("{}")
    with writer(url, meta) as made:
        store = Store(url)
        written = write_shard(work / "box.npz", arrays, meta)
        for path in (work / "subjects").rglob("*"):
            if path.is_file():
                store.put(path, path.relative_to(work).as_posix())
        store.put(work / "box.npz", "shards/box.npz")
        made.add("box", *written, 1.25, meta["licence"])
        if finish:
            made.finish()


def test_it_is_read_and_proven(url, tmp_path, arrays, meta, surfaces):
    fill(url, tmp_path, arrays, meta, surfaces)
    assert {"dataset.json", "manifest.jsonl", "README.md"} <= Store(url).files().keys()
    dataset = Dataset(url)
    assert dataset.subjects() == ["box"]
    assert np.array_equal(dataset.shard("box")["depth_front"], arrays["depth_front"])
    report = verify(url)
    assert report.ok, report.breaches


def test_only_what_is_asked_for_comes(url, tmp_path, arrays, meta, surfaces):
    fill(url, tmp_path, arrays, meta, surfaces)
    folder = Mirror(url).folder
    for path in folder.rglob("*.npz"):
        path.unlink()
    dataset = Dataset(url)
    assert not list(folder.rglob("*.npz"))
    assert len(dataset.shard("box")) == len(arrays["mask"])
    assert not list(folder.rglob("*.obj"))


def test_a_writer_goes_on(url, tmp_path, arrays, meta, surfaces):
    fill(url, tmp_path, arrays, meta, surfaces, finish=False)  # the list goes when it closes
    with writer(url, meta) as again:
        assert list(again.finished) == ["box"]
    store = Store(url)
    store.write("shards/box.npz", b"torn")
    with writer(url, meta) as again:
        assert list(again.finished) == []


def test_another_configuration_is_refused(url, tmp_path, arrays, meta, surfaces):
    fill(url, tmp_path, arrays, meta, surfaces)
    with pytest.raises(DatasetError, match="a is 1 there and 2 here"):
        writer(url, meta, {"a": 2})


def test_other_things_are_left_alone(url, meta):
    Store(url).write("thesis.doc", b"x")
    with pytest.raises(DatasetError, match="choose another URL"):
        writer(url, meta)
    assert list(Store(url).files()) == ["thesis.doc"]


def test_two_writers_on_one_machine(url, meta):
    with writer(url, meta), pytest.raises(DatasetError, match="in use"):
        writer(url, meta)


def test_damage_is_found(url, tmp_path, arrays, meta, surfaces):
    fill(url, tmp_path, arrays, meta, surfaces)
    Store(url).write("shards/box.npz", b"torn")
    assert not verify(url).ok


def test_what_is_no_dataset_is_told_by_its_url(url):
    with pytest.raises(DatasetError, match=f"^{url} holds no dataset.json"):
        Dataset(url)


def test_who_reads_meanwhile_takes_nothing_from_the_list(url, meta):
    entered = (3, "0" * 64, 2, 1.0, "CC0-1.0")
    with writer(url, meta, planned=("ball", "box")) as made:
        made.add("ball", *entered)
        assert Dataset(url).subjects() == []  # not told yet
        made.add("box", *entered)
    assert Dataset(url).subjects() == ["ball", "box"]


def test_what_ended_a_build_is_told_and_not_the_store_that_went_with_it(url, meta, monkeypatch):
    def gone(store, file, name):
        raise StoreError("gone")

    def build(end: type[BaseException] | None) -> None:
        with writer(url, meta) as made:
            made.add("box", 3, "0" * 64, 2, 1.0, "CC0-1.0")
            monkeypatch.setattr(Store, "put", gone)
            if end is not None:
                raise end

    with pytest.raises(KeyboardInterrupt):
        build(KeyboardInterrupt)
    with pytest.raises(StoreError, match="gone"):
        build(None)
