"""Views as the networks get them, against the shards that they come from."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader, DistributedSampler

from augment import sensors
from shards.dataset import Dataset
from trainer.views import DepthRange, Views, ViewsConfig

SMALL = ViewsConfig(size=(64, 48), flip=False, noise="stored")


def plain(data: Path, **changes: object) -> Views:
    """The training views as they are stored."""
    config = ViewsConfig(**{"size": (64, 48), "flip": False, "noise": "stored", **changes})
    return Views(data, "train", config, varied=True)


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


def test_holes_take_the_nearest_reading_of_their_row(data: Path) -> None:
    sample = plain(data)[3]
    inside, body = sample.mask[0].numpy(), sample.body[0].numpy()
    coarse = sample.coarse[0].numpy()
    assert (body & inside).sum() < inside.sum()
    back = Dataset(data).shard(plain(data).place(3)[0])["body_depth_back"][plain(data).place(3)[1]]
    np.testing.assert_array_equal(np.sort(coarse[body]), np.sort(back[back > 0]))
    for i, j in np.argwhere(inside & ~body):
        at = np.flatnonzero(body[i])
        if len(at):
            assert coarse[i, j] in coarse[i, at[np.abs(at - j) == np.abs(at - j).min()]]
        else:
            assert coarse[i, j] == pytest.approx(sample.back[0].numpy()[inside].mean(), rel=1e-5)
    assert not coarse[~inside].any()


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
