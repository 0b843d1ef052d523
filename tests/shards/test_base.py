"""Shards that hold what differs, and the dataset that holds the rest."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from shards.archive import Shard, ShardError, write_shard
from shards.checksum import file_sha256
from shards.dataset import Dataset, DatasetWriter
from shards.manifest import DatasetError
from shards.schema import SchemaError
from shards.verify import verify


def base_of(path: Path) -> dict[str, object]:
    """What a meta says of its base."""
    return {
        "shard": f"base/shards/{path.name}",
        "contents": Shard(path).contents,
        "sha256": file_sha256(path),
    }


def light(colour: int) -> dict[str, object]:
    """The configuration of a power's dataset."""
    return {"light": {"power": 100.0}, "c": colour}


@pytest.fixture
def base(build, arrays, meta) -> Path:
    """A finished dataset of one shard, "box"."""
    return build(arrays, meta)


@pytest.fixture
def lend(tmp_path, base, meta) -> Callable[..., Path]:
    """lend(folder, colour, compression): a dataset of one shard of that colour, the rest lent."""

    def lend(folder: Path, colour: int = 9, compression="stored") -> Path:
        lender = Dataset(base)
        whole = lender.shard("box")
        images = np.where(whole["mask"][..., None], colour, 0).astype("u1").repeat(3, axis=-1)
        with DatasetWriter(folder, light(colour), ["box"], 0, meta["versions"], lender) as writer:
            own = {**meta, "mesh": f"base/{meta['mesh']}", "body": f"base/{meta['body']}"}
            own["base"] = base_of(lender.shard_path("box"))
            own["sweep"] = light(colour)
            colours = {"rgb_front": images, "rgb_back": images}
            path = writer.shard_path("box")
            writer.add("box", *write_shard(path, colours, own, compression, whole), 1.0, "CC0-1.0")
            writer.finish()
        return folder

    return lend


@pytest.mark.parametrize("compression", ["stored", "deflate"])
def test_both_files_read_as_one_shard(lend, base, tmp_path, compression):
    shard = Dataset(lend(tmp_path / "lit", 9, compression)).shard("box")
    whole = Dataset(base).shard("box")
    assert set(shard.names) == set(whole.names)
    assert len(shard) == len(whole)
    assert set(shard.lent) == set(whole.names) - {"rgb_front", "rgb_back"}
    assert whole.lent == ()
    for name in shard.names:
        due = whole[name] if name in shard.lent else np.minimum(whole["rgb_front"], 9)
        np.testing.assert_array_equal(shard[name], due)
        np.testing.assert_array_equal(shard.view(2, [name])[name], due[2])
    assert set(shard.view(0)) == set(shard.names)
    again = copy.deepcopy(shard)
    np.testing.assert_array_equal(again["depth_back"], whole["depth_back"])
    shard.close()
    np.testing.assert_array_equal(shard["mask"], whole["mask"])
    with pytest.raises(KeyError, match="no member 'nothing'"):
        shard["nothing"]


def test_it_is_proven_as_any_other(lend, tmp_path):
    folder = lend(tmp_path / "lit")
    report = verify(folder)
    assert report.ok, report.breaches
    assert report.figures["box"]["depth_off"] == 0
    assert "depth_off" not in verify(folder, lent=False).figures["box"]


def test_the_split_is_the_base_s_and_the_link_relative(lend, base, tmp_path):
    folder = lend(tmp_path / "deep" / "lit")
    assert Dataset(folder).manifest["box"].split == Dataset(base).manifest["box"].split
    assert (folder / "base").is_symlink()
    assert str((folder / "base").readlink()) == "../../dataset"
    assert not (folder / "subjects").exists()


def test_card_and_description_say_where_the_rest_lies(lend, base, tmp_path):
    folder = lend(tmp_path / "lit")
    card = (folder / "README.md").read_text()
    assert 'base = np.load("base/shards/box.npz")' in card
    assert "`base/subjects/` holds the surfaces" in card
    code = card.split("```python\n")[1].split("```")[0]
    values: dict[str, object] = {}
    exec(
        code.replace('"shards/', f'"{folder}/shards/').replace('"base/', f'"{folder}/base/'), values
    )
    np.testing.assert_array_equal(values["depth"], Dataset(base).shard("box")["depth_front"])
    assert "base" not in (base / "README.md").read_text()
    document = json.loads((folder / "dataset.json").read_text())
    assert any(part["@id"] == "base-shards" for part in document["distribution"])
    fields = {f["@id"]: f for f in document["recordSet"][0]["field"]}
    for name, files in (("depth_front", "base-shards"), ("rgb_back", "shards")):
        assert fields[f"subjects/{name}"]["source"]["fileSet"]["@id"] == files
    plain = json.loads((base / "dataset.json").read_text())
    assert not any(part["@id"] == "base-shards" for part in plain["distribution"])


def writer_of(folder: Path, base: Path, meta: dict) -> DatasetWriter:
    return DatasetWriter(folder, light(9), ["box"], 0, meta["versions"], Dataset(base))


def test_a_shard_stands_until_its_base_changes(lend, base, meta, tmp_path):
    folder = lend(tmp_path / "lit")
    with writer_of(folder, base, meta) as writer:
        assert writer.finished == {"box"}
    manifest = base / "manifest.jsonl"
    manifest.write_text(
        manifest.read_text().replace(Dataset(base).manifest["box"].sha256, 64 * "0")
    )
    with writer_of(folder, base, meta) as writer:
        assert not writer.finished


def test_a_base_that_moved_is_linked_anew(lend, base, meta, tmp_path):
    folder = lend(tmp_path / "lit")
    moved = base.rename(tmp_path / "moved")
    with pytest.raises(ShardError, match=r"box\.npz is missing.*or link it there anew"):
        Dataset(folder).shard("box")
    with writer_of(folder, moved, meta) as writer:
        assert writer.finished == {"box"}
    assert Dataset(folder).shard("box")["mask"].any()


def test_a_folder_in_the_place_of_the_link_is_not_touched(base, meta, tmp_path):
    folder = tmp_path / "lit"
    with writer_of(folder, base, meta):
        pass
    (folder / "base").unlink()
    (folder / "base").mkdir()
    with pytest.raises(DatasetError, match="base is no link; move it away"):
        writer_of(folder, base, meta)


def test_base_and_meta_come_together(base, meta, arrays, tmp_path):
    whole = Dataset(base).shard("box")
    colours = {name: arrays[name] for name in ("rgb_front", "rgb_back")}
    with pytest.raises(SchemaError, match="come together"):
        write_shard(tmp_path / "a.npz", colours, meta, base=whole)
    with pytest.raises(SchemaError, match="come together"):
        write_shard(tmp_path / "a.npz", arrays, {**meta, "base": base_of(whole.path)})
    short = {name: array[:1] for name, array in colours.items()}
    named = {**meta, "base": base_of(whole.path)}
    with pytest.raises(SchemaError, match="as mask demands"):
        write_shard(tmp_path / "a.npz", short, named, base=whole)
    assert not (tmp_path / "a.npz").exists()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"shard": "../../etc/passwd"}, "no posix path below"),
        ({"shard": "/etc/passwd"}, "no posix path below"),
        ({"shard": 3}, "no posix path below"),
        ({"contents": "many"}, "contents is 'many'"),
        ({"contents": True}, "contents is True"),
        ({"sha256": "f00"}, "not 64 hex digits"),
        ({"more": 1}, "no object of shard, contents and sha256"),
    ],
)
def test_a_wrong_base_is_refused_when_written_and_when_read(
    base, meta, arrays, tmp_path, monkeypatch, wrong, message
):
    whole = Dataset(base).shard("box")
    named = {**meta, "base": {**base_of(whole.path), **wrong}}
    with pytest.raises(SchemaError, match=message):
        write_shard(tmp_path / "a.npz", arrays, named, base=whole)
    monkeypatch.setattr("shards.schema.check_meta", lambda *_: None)
    (tmp_path / "lit" / "shards").mkdir(parents=True)
    path = tmp_path / "lit" / "shards" / "box.npz"
    write_shard(path, arrays, named, base=whole)
    with pytest.raises(ShardError, match=message):
        Shard(path)


def test_a_base_has_none_itself_and_none_is_its_own(lend, base, meta, arrays, tmp_path):
    folder = lend(tmp_path / "lit")
    middle = Dataset(folder).shard_path("box")
    (tmp_path / "second" / "shards").mkdir(parents=True)
    (tmp_path / "second" / "base").symlink_to(folder)
    path = tmp_path / "second" / "shards" / "box.npz"
    named = {**meta, "base": base_of(middle)}
    write_shard(path, arrays, named, base=Dataset(base).shard("box"))
    with pytest.raises(ShardError, match="has a base itself"):
        Shard(path)
    loop = tmp_path / "loop"
    (loop / "shards").mkdir(parents=True)
    (loop / "base").symlink_to(".")
    path = loop / "shards" / "box.npz"
    write_shard(path, arrays, named, base=Dataset(base).shard("box"))
    with pytest.raises(ShardError, match="has a base itself"):
        Shard(path)


def test_a_base_of_other_bytes_is_named(lend, base, tmp_path):
    folder = lend(tmp_path / "lit")
    path = Dataset(base).shard_path("box")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert any("another sha256" in breach for breach in verify(folder, lent=False).breaches)


def test_a_base_of_other_maps_is_refused_when_it_is_opened(lend, base, arrays, meta, tmp_path):
    """Of the same size to the byte, as another seed gives it."""
    folder = lend(tmp_path / "lit")
    path = Dataset(base).shard_path("box")
    size = path.stat().st_size
    write_shard(path, {**arrays, "depth_back": arrays["depth_back"] + np.float32(1)}, meta)
    assert path.stat().st_size == size
    with pytest.raises(ShardError, match=r"holds other maps than .*; run the sweep again"):
        Dataset(folder).shard("box")


def test_names_come_in_the_order_asked_for(lend, tmp_path):
    shard = Dataset(lend(tmp_path / "lit")).shard("box")
    for names in (["rgb_back", "mask", "rgb_front"], ["mask", "rgb_front", "depth_back"]):
        assert list(shard.view(0, names)) == names


def test_colours_of_another_light_are_made_again_and_noticed(lend, base, meta, tmp_path):
    """Shards that went from one power's folder to another's, manifest and all."""
    folder = lend(tmp_path / "lit", 9)
    other = lend(tmp_path / "other", 4)
    for name in ("manifest.jsonl", "shards/box.npz"):
        (folder / name).write_bytes((other / name).read_bytes())
    assert any("of another light than its dataset" in b for b in verify(folder).breaches)
    with writer_of(folder, base, meta) as writer:
        assert not writer.finished
