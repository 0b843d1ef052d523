"""Views as the networks get them, against the shards that they come from."""

from __future__ import annotations

import copy
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader, DistributedSampler

from augment import sensors
from shards.archive import write_shard
from shards.dataset import Dataset, DatasetWriter
from trainer.filling import filled
from trainer.normals import normals
from trainer.views import DepthRange, Sample, Views, ViewsConfig

SMALL = ViewsConfig(size=(64, 48), flip=False, noise="stored")


def plain(data: Path, **changes: object) -> Views:
    """The training views as they are stored."""
    config = ViewsConfig(**{"size": (64, 48), "flip": False, "noise": "stored", **changes})
    return Views(data, "train", config, varied=True)


def mask_of(views: Views, index: int) -> np.ndarray:
    """(H, W) of a view, uncropped."""
    subject, view = views.place(index)
    return views.dataset.shard(subject)["mask"][view]


def rectangle(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns that a silhouette takes."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def sides(mask: np.ndarray) -> tuple[int, int]:
    """How many they are."""
    rows, columns = rectangle(mask)
    return rows.stop - rows.start, columns.stop - columns.start


def corner(views: Views, index: int) -> tuple[int, int]:
    """Row and column, in the silhouette's rectangle, of a window that lies wholly in it.

    It is found by its colours, which are different at all pixels.
    """
    subject, view = views.place(index)
    shard = views.dataset.shard(subject)
    whole = shard["rgb_front"][view][rectangle(shard["mask"][view])].transpose(2, 0, 1)
    window = (views[index].rgb.numpy() * 255).round().astype("u1")
    places = np.lib.stride_tricks.sliding_window_view(whole, window.shape)[0]
    ((row, column),) = np.argwhere((places == window).all(axis=(2, 3, 4)))
    return int(row), int(column)


def same(one: Sample, other: Sample) -> bool:
    """To the bit."""
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


def open_files(folder: Path) -> list[Path]:
    """What this process has open of a folder."""
    links = Path("/proc/self/fd").iterdir()
    targets = [link.readlink() for link in links if link.is_symlink()]
    return [target for target in targets if target.is_relative_to(folder.resolve())]


def test_splits_are_by_subject(data: Path) -> None:
    train, test = (Views(data, split, SMALL, varied=False) for split in ("train", "test"))
    assert len(train) == 8
    assert len(test) == 2
    assert not set(train.subjects) & set(test.subjects)
    assert [train.place(i) for i in (0, 1, 2)] == [
        (train.subjects[0], 0), (train.subjects[0], 1), (train.subjects[1], 0)
    ]  # fmt: skip
    for wrong in (-1, 8):
        with pytest.raises(IndexError, match="not among 0 to 7"):
            train[wrong]


def test_a_crop_holds_the_silhouette_and_its_maps_unchanged(data: Path) -> None:
    views = plain(data)
    for index in range(len(views)):
        subject, view = views.place(index)
        whole = Dataset(data).shard(subject).view(view)
        sample = views[index]
        inside = sample.mask[0].numpy()
        assert inside.shape == (64, 48)
        assert inside.sum() == whole["mask"].sum()
        for name, member in (("front", "depth_front"), ("back", "depth_back")):
            found = getattr(sample, name)[0].numpy()
            np.testing.assert_array_equal(found[inside], whole[member][whole["mask"]])
            assert not found[~inside].any()
        np.testing.assert_array_equal(
            sample.rgb.numpy().transpose(1, 2, 0)[inside],
            whole["rgb_front"][whole["mask"]] / np.float32(255),
        )
        assert sample.rgb.dtype == sample.front.dtype == torch.float32
        assert float(sample.pixel_size) == pytest.approx(0.02)
        assert int(sample.index) == index
        # The rectangle's middle is the window's, to half a pixel.
        for axis, length in ((1, 64), (0, 48)):
            used = np.flatnonzero(inside.any(axis=axis))
            assert abs((used[0] + used[-1] + 1) / 2 - length / 2) <= 0.5


def test_a_window_larger_than_the_image_is_padded_and_a_smaller_one_cuts(data: Path) -> None:
    large = plain(data, size=(200, 300))[0]
    assert large.mask.shape == (1, 200, 300)
    assert large.mask.sum() == plain(data)[0].mask.sum()
    small = plain(data, size=(16, 16))[0]
    assert small.mask.all()


def test_what_the_body_leaves_bare_is_filled_in_from_its_depth(data: Path) -> None:
    bare = 0
    for index in range(8):
        sample = plain(data)[index]
        inside, body = sample.mask[0].numpy(), sample.body[0].numpy()
        coarse = sample.coarse[0].numpy()
        subject, view = plain(data).place(index)
        back = Dataset(data).shard(subject)["body_depth_back"][view]
        np.testing.assert_array_equal(np.sort(coarse[body]), np.sort(back[back > 0]))
        rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
        person = np.ix_(rows, columns)  # the crop's mask has no empty row or column within
        bared = np.where(body, coarse, np.float32(0))
        np.testing.assert_array_equal(coarse[person], filled(bared[person], inside[person]))
        bare += int((inside & ~body).sum())
        assert not coarse[~inside].any()
    assert bare > 1000


def test_what_the_sensor_missed_is_filled_in_mirrored_or_not(data: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    base = Dataset(data)
    with DatasetWriter(tmp_path, {}, base.subjects(), 0, {"numpy": np.__version__}) as writer:
        for name in base.subjects():
            shard = base.shard(name)
            maps = {member: shard[member] for member in shard.names}
            holes = rng.random(maps["mask"].shape) < 0.7
            holes[:, ::7] = True
            maps["depth_sensor"] = np.where(holes, np.float32(0), maps["depth_sensor"])
            written = write_shard(writer.shard_path(name), maps, shard.meta)
            writer.add(name, *written, 0.1, "CC0-1.0")
        writer.finish()
    views, flipped = plain(tmp_path), plain(tmp_path, flip=True)
    turned = 0
    for index in range(len(views)):
        here, there = views[index], flipped[index]
        subject, view = views.place(index)
        own = base.shard(subject)
        read = views.dataset.shard(subject)["depth_sensor"][view][own["mask"][view]]
        inside, valid, found = (part[0].numpy() for part in (here.mask, here.valid, here.sensor))
        np.testing.assert_array_equal(np.where(valid, found, 0)[inside], read)
        assert not valid[~inside].any()
        assert not found[~inside].any()
        assert (found[inside] > 0).all()
        truth = here.front[0].numpy()
        # The sensor's noise, and what an ellipsoid's rim falls off by in a few pixels.
        assert np.median(np.abs(found - truth)[inside & ~valid]) < 0.02
        if not torch.equal(here.rgb, there.rgb):
            turned += 1
            assert torch.equal(here.sensor.flip(-1), there.sensor)
            assert torch.equal(here.valid.flip(-1), there.valid)
    assert turned


def test_the_sensor_is_stored_or_drawn_anew_each_epoch(data: Path) -> None:
    stored, redrawn = plain(data), plain(data, noise="redrawn")
    subject, view = stored.place(0)
    shard = Dataset(data).shard(subject)
    inside = stored[0].mask
    own = shard["depth_sensor"][view][shard["mask"][view]]
    np.testing.assert_array_equal(stored[0].sensor[inside].numpy(), own)
    seen = {stored[0].sensor.numpy().tobytes()}
    for epoch in range(3):
        redrawn.set_epoch(epoch)
        sample = redrawn[0]
        seen.add(sample.sensor.numpy().tobytes())
        assert torch.equal(sample.sensor, redrawn[0].sensor)
        error = (sample.sensor - sample.front)[inside].numpy()
        sigma = sensors.read(shard.view(view), shard.meta, view).sigma[shard["mask"][view]]
        assert (error / sigma).std() == pytest.approx(1, abs=0.1)
    assert len(seen) == 4
    unvaried = Views(data, "train", ViewsConfig(size=(64, 48)), varied=False)
    assert torch.equal(unvaried[0].sensor, stored[0].sensor)


def test_a_flip_mirrors_every_map_and_half_of_the_views(data: Path) -> None:
    views, flipped = plain(data, size=(64, 49)), plain(data, size=(64, 49), flip=True)
    turned = 0
    for epoch in range(20):
        flipped.set_epoch(epoch)
        for index in range(len(views)):
            here, there = views[index], flipped[index]
            if not torch.equal(here.rgb, there.rgb):
                turned += 1
                for name in ("rgb", "sensor", "front", "back", "coarse", "mask", "valid", "body"):
                    assert torch.equal(getattr(here, name).flip(-1), getattr(there, name)), name
    assert 55 < turned < 105


def test_loader_workers_and_samplers_do_not_show(data: Path) -> None:
    views = plain(data, noise="redrawn", flip=True)
    views.set_epoch(4)
    alone = [views[i] for i in range(len(views))]
    for workers in (0, 2):
        loader = DataLoader(views, batch_size=2, num_workers=workers, shuffle=True)
        for batch in loader:
            for k, index in enumerate(batch.index.tolist()):
                assert torch.equal(batch.sensor[k], alone[index].sensor)
                assert torch.equal(batch.rgb[k], alone[index].rgb)
    parts = [DistributedSampler(views, 2, rank, shuffle=False) for rank in range(2)]
    assert sorted(i for part in parts for i in part) == list(range(len(views)))


def test_depths_are_normalised_by_the_datasets_own_range(data: Path) -> None:
    views = plain(data)
    span = views.depth_range()
    depths = torch.cat(
        [torch.cat([s.front[s.mask], s.back[s.mask]]) for s in map(views.__getitem__, range(8))]
    )
    normal = span.normalised(depths)
    assert normal.abs().max() < 1
    assert normal.max() - normal.min() > 1
    torch.testing.assert_close(span.metres(normal), depths)
    nearer = DepthRange(1.0, 2.3)
    # NormalGAN's own: millimetres, 2 (d - 1000) / 1300 - 1.
    assert nearer.normalised(torch.tensor(1.65)) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("size", [(0, 64), (64,), (64, 9000)])
def test_a_wrong_size_is_named(size: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"views\.size: .*; give rows and columns"):
        ViewsConfig(size=size)


def test_an_empty_split_is_named(data: Path, tmp_path: Path) -> None:
    shutil.copytree(data, tmp_path / "data")
    manifest = tmp_path / "data" / "manifest.jsonl"
    manifest.write_text(manifest.read_text().replace('"test"', '"train"'))
    with pytest.raises(ValueError, match="no subject in its test split"):
        Views(tmp_path / "data", "test", SMALL, varied=False)


def test_the_extent_is_the_largest_silhouettes(data: Path) -> None:
    for split in ("train", "test"):
        views = Views(data, split, SMALL, varied=False)
        found = [sides(mask_of(views, index)) for index in range(len(views))]
        assert views.extent() == (max(r for r, _ in found), max(c for _, c in found))
    assert len(set(found)) > 1
    views.resize(views.extent())
    for index in range(len(views)):
        assert views[index].mask.sum() == mask_of(views, index).sum()


@pytest.mark.parametrize("least", [(16, 16), (300, 16), (300, 400)])
def test_whole_people_are_shown_in_crops_no_smaller_than_configured(
    data: Path, least: tuple[int, int]
) -> None:
    views = Views(data, "train", ViewsConfig(size=least), varied=False)
    rows, columns = views.extent()
    views.show_whole()
    assert views.config.size == (max(rows, least[0]), max(columns, least[1]))


def test_another_size_holds_from_then_on(data: Path) -> None:
    views = plain(data)
    before = views[2]
    views.resize((50, 71))
    assert views[2].rgb.shape == (3, 50, 71)
    assert views[2].sensor.shape == (1, 50, 71)
    assert views.config == ViewsConfig(size=(50, 71), flip=False, noise="stored")
    with pytest.raises(ValueError, match=r"views\.size: .*; give rows and columns"):
        views.resize((50, 8))
    views.resize((64, 48))
    assert same(views[2], before)


def test_a_window_smaller_than_the_silhouette_lies_anywhere_in_it(data: Path) -> None:
    views = plain(data)
    rows, columns = sides(mask_of(views, 0))
    views.resize((rows - 3, columns - 2))
    seen = []
    for epoch in range(120):
        views.set_epoch(epoch)
        seen.append(corner(views, 0))
    every = {(row, column) for row in range(4) for column in range(3)}
    assert set(seen) == every
    # By chance each has 10: neither is a place preferred nor do they take turns.
    assert all(2 <= seen.count(place) <= 22 for place in every)
    assert seen[:12] != seen[12:24]
    views.set_epoch(0)
    assert corner(views, 0) == seen[0]
    other = Views(data, "train", views.config, varied=True, seed=1)
    places = []
    for epoch in range(12):
        other.set_epoch(epoch)
        places.append(corner(other, 0))
    assert places != seen[:12]


def test_it_lies_in_every_silhouette_and_elsewhere_in_each(data: Path) -> None:
    views = plain(data, size=(40, 17))
    seen = set()
    for index in range(len(views)):
        rows, columns = sides(mask_of(views, index))
        assert rows > 40
        assert columns > 17
        row, column = corner(views, index)
        assert row <= rows - 40
        assert column <= columns - 17
        seen.add((row / (rows - 40), column / (columns - 17)))
    assert len(seen) == len(views)


def test_along_an_axis_with_room_to_spare_it_stays_centred(data: Path) -> None:
    views = plain(data, size=(40, 48))
    first = set()
    for epoch in range(10):
        views.set_epoch(epoch)
        inside = views[0].mask[0].numpy()
        assert inside.any(axis=1).all()
        used = np.flatnonzero(inside.any(axis=0))
        assert abs((used[0] + used[-1] + 1) / 2 - 24) <= 1.5  # of the rows that are seen
        first.add(views[0].rgb.numpy().tobytes())
    assert len(first) > 3


@pytest.mark.parametrize("less", [(0, 0), (1, 1), (2, 3), (3, 2), (8, 9)])
def test_unvaried_it_is_the_middle_in_every_epoch(data: Path, less: tuple[int, int]) -> None:
    views = Views(data, "train", SMALL, varied=False)
    for index in range(len(views)):
        rows, columns = sides(mask_of(views, index))
        views.resize((rows - less[0], columns - less[1]))
        places = set()
        for epoch in range(4):
            views.set_epoch(epoch)
            places.add(corner(views, index))
        ((row, column),) = places
        assert abs(row - less[0] / 2) <= 0.5
        assert abs(column - less[1] / 2) <= 0.5


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_workers_that_outlive_an_epoch_know_of_the_next(data: Path, context: str) -> None:
    """Whether they inherit the views or are sent them; noise, flips and places change."""
    views = plain(data, size=(40, 17), noise="redrawn", flip=True)
    loader = DataLoader(
        views, batch_size=1, num_workers=2, persistent_workers=True, multiprocessing_context=context
    )
    before: list[Sample] = []
    for epoch in (3, 4):
        views.set_epoch(epoch)
        alone = [views[index] for index in range(len(views))]
        found = [Sample(*(part[0] for part in batch)) for batch in loader]
        assert all(map(same, found, alone))
        assert not any(map(same, before, found))
        before = found


def test_a_copy_for_another_process_holds_no_file(data: Path) -> None:
    views = plain(data)
    views.set_epoch(5)
    mine = [views[index] for index in range(len(views))]
    for shard in views._shards:
        assert shard["mask"].any()  # so its file is mapped
    before = len(open_files(data))
    assert before >= len(views.subjects)
    twin = copy.deepcopy(views)  # by the state that pickling takes too
    assert all(shard._map is None for shard in twin._shards)
    assert len(open_files(data)) <= before
    assert twin.epoch == 5
    assert all(same(twin[index], mine[index]) for index in range(len(views)))


def test_however_many_subjects_there_are_few_files_are_open(data: Path) -> None:
    views = plain(data, noise="redrawn")
    already = len(open_files(data))
    views.extent()
    views.depth_range()
    samples = [views[index] for index in range(len(views))]
    assert len(open_files(data)) - already <= 1
    assert samples[0].mask.any()


def test_normals_of_a_flipped_view_are_flipped_and_x_negated(data: Path) -> None:
    views, flipped = plain(data), plain(data, flip=True)
    turned = 0
    for index in range(len(views)):
        here, there = views[index], flipped[index]
        if torch.equal(here.rgb, there.rgb):
            continue
        turned += 1
        subject, view = views.place(index)
        shard = Dataset(data).shard(subject)
        for side in ("front", "back"):
            ours, mirrored = (
                normals(getattr(s, side)[None], s.pixel_size, s.mask[None], side)[0]
                for s in (here, there)
            )
            expected = ours.flip(-1) * torch.tensor([-1.0, 1.0, 1.0]).view(3, 1, 1)
            torch.testing.assert_close(mirrored, expected, rtol=0, atol=1e-5)
            # They are the surface's too: those that are stored, mirrored.
            stored = shard[f"normal_{side}"][view][shard["mask"][view]].astype("f4")
            wanted = torch.zeros_like(ours)
            wanted[:, here.mask[0]] = torch.from_numpy(stored.T)
            wanted = wanted.flip(-1) * torch.tensor([-1.0, 1.0, 1.0]).view(3, 1, 1)
            steep = wanted[2].abs() < 0.6
            cosine = (mirrored * wanted).sum(0)[there.mask[0] & ~steep]
            assert len(cosine) > 300
            assert cosine.min() > 0.99
    assert 0 < turned < len(views)


def test_a_power_of_a_light_sweep_differs_from_its_base_in_colour_alone(
    data: Path, tmp_path: Path
) -> None:
    """Its sensor's readings, redrawn ones too, are those under the base's lamp."""
    base = Dataset(data)
    shutil.copytree(data, tmp_path / "data")
    moved = Dataset(tmp_path / "data")
    with DatasetWriter(
        tmp_path / "0050W", {"power": 50}, base.subjects(), 0, {"numpy": np.__version__}, moved
    ) as writer:
        for name in moved.subjects():
            shard = moved.shard(name)
            entry = moved.manifest[name]
            named = {"shard": f"base/{entry.file}", "contents": shard.contents}
            meta = {**shard.meta, "base": {**named, "sha256": entry.sha256}}
            meta["light"] = {**meta["light"], "power": 50.0}
            colors = {side: shard[side] // 2 for side in ("rgb_front", "rgb_back")}
            written = write_shard(writer.shard_path(name), colors, meta, base=shard)
            writer.add(name, *written, 0.1, "CC0-1.0")
        writer.finish()
    for noise in ("stored", "redrawn"):
        bright, dim = (plain(each, noise=noise) for each in (data, tmp_path / "0050W"))
        assert dim.subjects == bright.subjects
        assert dim.depth_range() == bright.depth_range()
        assert dim.extent() == bright.extent()
        for views in (bright, dim):
            views.set_epoch(2)
        for index in (0, 5):
            one, other = bright[index], dim[index]
            assert not torch.equal(one.rgb, other.rgb)
            assert same(one._replace(rgb=other.rgb), other)
            halves = (one.rgb * 255).round() // 2
            torch.testing.assert_close(other.rgb, halves / 255)


def test_a_crop_is_a_part_of_the_whole_person_filled_in_alike(data: Path, tmp_path: Path) -> None:
    """What a small window lacks comes from beyond it, as in a large one."""
    base = Dataset(data)
    rng = np.random.default_rng(1)
    with DatasetWriter(tmp_path, {}, base.subjects(), 0, {"numpy": np.__version__}) as writer:
        for name in base.subjects():
            shard = base.shard(name)
            maps = {member: shard[member] for member in shard.names}
            for member in ("depth_sensor", "body_depth_back"):
                left = rng.random(maps["mask"].shape) < 0.02
                maps[member] = np.where(left, maps[member], np.float32(0))
            written = write_shard(writer.shard_path(name), maps, shard.meta)
            writer.add(name, *written, 0.1, "CC0-1.0")
        writer.finish()
    whole, small = plain(tmp_path), plain(tmp_path, size=(16, 16))
    for index in range(len(whole)):
        here, part = whole[index], small[index]
        for name in ("sensor", "coarse", "valid", "body", "front", "rgb"):
            windows = getattr(here, name).unfold(1, 16, 1).unfold(2, 16, 1)
            same = (windows == getattr(part, name)[:, None, None]).all(-1).all(-1).all(0)
            assert same.any(), name
        assert (part.sensor[part.mask] > 0).all()
        assert (part.coarse[part.mask] > 0).all()
