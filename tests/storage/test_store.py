"""Stores by URL, in memory; and mirrors of them."""

from __future__ import annotations

import copy
import os
import uuid

import pytest

from storage.mirror import FETCHED, URL, Mirror, local_folder, mirrors
from storage.store import Store, StoreError, is_url, local_path


@pytest.fixture
def url(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return f"memory://{uuid.uuid4().hex}/people"


@pytest.mark.parametrize("place", ["s3://bucket/a", "memory://a", "gs+x://a"])
def test_urls_are_told_from_folders(place):
    assert is_url(place)


@pytest.mark.parametrize("place", ["a/b", "/a/b", "file:///a/b", "c:/a", "://b"])
def test_folders_are_told_from_urls(place):
    assert not is_url(place)


def test_a_file_url_is_a_folder():
    assert local_path("file:///a/b%20c").as_posix() == "/a/b c"


def test_files_come_back(url, tmp_path):
    store = Store(url)
    store.write("a/b.txt", b"one")
    (tmp_path / "two").write_bytes(b"two2")
    store.put(tmp_path / "two", "c")
    assert store.read("a/b.txt") == b"one"
    assert {name: stored.bytes for name, stored in store.files().items()} == {"a/b.txt": 3, "c": 4}
    assert list(store.files("a")) == ["a/b.txt"]
    store.fetch("c", tmp_path / "deep" / "er")
    assert (tmp_path / "deep" / "er").read_bytes() == b"two2"
    assert store.stat("c").bytes == 4
    assert copy.copy(store).read("c") == b"two2"


def test_what_is_missing_is_not_found(url, tmp_path):
    store = Store(url)
    assert store.files() == {}
    for ask in (store.read, store.stat, lambda name: store.fetch(name, tmp_path / "x")):
        with pytest.raises(FileNotFoundError):
            ask("nothing")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError):
        Mirror(url).bring()


def test_unknown_stores_are_refused():
    with pytest.raises(StoreError, match="nosuch"):
        Store("nosuch://bucket/a")


def test_a_mirror_follows_its_store(url):
    store, mirror = Store(url), Mirror(url)
    store.write("a", b"one")
    path = mirror.path("a")
    assert path.read_bytes() == b"one"
    store.write("a", b"other")
    assert mirror.path("a").read_bytes() == b"one"  # asked for once
    assert Mirror(url).path("a").read_bytes() == b"other"
    before = path.stat().st_mtime_ns
    assert Mirror(url).path("a").stat().st_mtime_ns == before  # not fetched again
    store.write("b/c", b"x")
    folder = mirror.bring()
    assert sorted(p.name for p in folder.iterdir()) == sorted([URL, FETCHED, "a", "b"])
    store._place()[0].rm(f"{store._place()[1]}/a")
    mirror.bring()
    assert not path.exists()


def test_what_went_from_the_store_is_not_here_either(url):
    store = Store(url)
    store.write("a", b"one")
    path = Mirror(url).path("a")
    store._place()[0].rm(f"{store._place()[1]}/a")
    Mirror(url).renew(["a"])
    assert not path.exists()


@pytest.mark.parametrize("name", ["../evil", "a/../../evil", "a\\b", URL, "a//b"])
def test_no_key_leads_out_of_the_mirror(url, name):
    mirror = Mirror(url)
    with pytest.raises(StoreError, match="rename it"):
        mirror.path(name)
    assert not (mirrors() / "evil").exists()
    assert (mirror.folder / URL).is_file()


def test_a_key_that_leads_out_is_not_brought(url):
    store = Store(url)
    system, root = store._place()
    system.pipe_file(f"{root}/a/..\\b", b"evil")
    with pytest.raises(StoreError, match="rename it"):
        Mirror(url).bring("a")
    with pytest.raises(StoreError, match="rename it"):
        store.read("a/..\\b")


def test_a_folder_that_is_a_file_of_no_bytes_is_none(url):
    store = Store(url)
    store.write("a/b", b"one")
    system, root = store._place()
    system.store[f"{root}/a/c/"] = type(system.store[f"{root}/a/b"])(system, f"{root}/a/c/")
    assert f"{root}/a/c/" in system.find(root)
    assert list(store.files()) == ["a/b"]


def test_what_a_mirror_is_of_can_be_read_at_any_time(url):
    """Another process that opens the same mirror does not empty the file that says so."""
    mirror = Mirror(url)
    before = (mirror.folder / URL).stat().st_ino
    with (mirror.folder / URL).open() as held:
        Mirror(url)
        assert held.read() == url
    assert (mirror.folder / URL).stat().st_ino == before


def test_only_mirrors_are_believed(url, tmp_path):
    Store(url).write("a", b"one")
    mirror = Mirror(url)
    found = Mirror.of(mirror.folder)
    assert found is not None
    assert found.store.url == url
    forged = tmp_path / "forged"
    forged.mkdir()
    (forged / URL).write_text(url)
    assert Mirror.of(forged) is None


def test_a_fork_has_its_own_connection(url):
    store = Store(url)
    store.write("a", b"one")
    child = os.fork()
    if child == 0:
        os._exit(0 if store.read("a") == b"one" and store._open[0] == os.getpid() else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_inputs_are_brought_whole(url, tmp_path):
    Store(url).write("scan/a.obj", b"v 0 0 0\n")
    folder = local_folder(url)
    assert (folder / "scan" / "a.obj").read_bytes() == b"v 0 0 0\n"
    assert local_folder(str(tmp_path)) == tmp_path
