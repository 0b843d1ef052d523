"""The index of a light sweep."""

from __future__ import annotations

from pathlib import Path

import pytest

from shards.manifest import DatasetError
from shards.sweep import (
    INDEX,
    base_folder,
    is_sweep,
    lock_sweep,
    power_folder,
    read_index,
    read_shared,
    write_index,
)


@pytest.mark.parametrize(
    ("power", "name"),
    [(2000, "2000W"), (100.0, "0100W"), (12.5, "0012.5W"), (5000, "5000W"), (0.1, "0000.1W")],
)
def test_folders_of_whole_watts_sort_as_the_powers_do(power, name):
    assert power_folder(power) == name


def test_no_two_powers_share_a_folder():
    powers = [1000.0, 1000.0000001, 1e-7, 1.5e-7, 1e8, 100, 10, 1]
    assert len({power_folder(power) for power in powers}) == len(powers)


def test_the_index_gives_back_what_was_written(tmp_path):
    sweep, data = tmp_path / "a" / "sweep", tmp_path / "data"
    assert not is_sweep(sweep)
    with lock_sweep(sweep):
        write_index(sweep, data, {"exposure": 0.06}, [])
        with pytest.raises(DatasetError, match="holds no power yet"):
            read_index(sweep)
        write_index(sweep, data, {"exposure": 0.06}, [100, 2000.0, 500])
    assert is_sweep(sweep)
    powers = {2000.0: sweep / "2000W", 500.0: sweep / "0500W", 100.0: sweep / "0100W"}
    assert read_index(sweep) == powers
    assert list(read_index(sweep)) == list(powers)
    assert read_shared(sweep) == ({"exposure": 0.06}, list(powers))
    with pytest.raises(DatasetError, match="with --data where it lies now"):
        base_folder(sweep)
    data.mkdir()
    assert base_folder(sweep).samefile(data)


def test_what_an_interrupted_writer_left_is_no_hindrance_and_a_thesis_is(tmp_path):
    (tmp_path / f".{INDEX}.host.1.tmp").touch()
    with lock_sweep(tmp_path), pytest.raises(DatasetError, match="is in use by another"):
        lock_sweep(tmp_path)
    lock_sweep(tmp_path).close()
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(DatasetError, match=r"is not empty and holds no sweep\.json"):
        lock_sweep(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "nonsense",
        "[" * 100_000,
        '{"data": "a", "shared": {}, "powers": [{"power": -1}]}',
        '{"data": "a", "shared": {}, "powers": [{"power": NaN}]}',
        '{"data": "a", "shared": {}, "powers": [{"power": "much"}]}',
        '{"data": "a", "shared": {}, "powers": 7}',
        '{"data": 1, "shared": {}, "powers": [{"power": 1}]}',
        '{"data": "a", "shared": [], "powers": [{"power": 1}]}',
        '{"data": "a", "shared": {}}',
    ],
)
def test_what_is_no_index_is_named(tmp_path: Path, text):
    (tmp_path / INDEX).write_text(text)
    for use in (read_index, base_folder, read_shared):
        with pytest.raises(DatasetError, match=r"is no index of a sweep; delete it"):
            use(tmp_path)


def test_a_folder_without_an_index(tmp_path):
    with pytest.raises(DatasetError, match=r"holds no sweep\.json; name a folder of a sweep"):
        read_index(tmp_path)
