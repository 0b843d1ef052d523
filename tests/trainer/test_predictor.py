"""A checkpoint at use on whole views."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from trainer import checkpoint
from trainer.branch import Back, Branch, Front
from trainer.checkpoint import Checkpoint, CheckpointError
from trainer.learner import Learner
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.predictor import GivenView, Predictor
from trainer.record import to_record
from trainer.training import TrainConfig
from trainer.views import Crop, DepthRange, Sample, Views, ViewsConfig

SPAN = DepthRange(1.5, 2.6)
BRANCHES: dict[str, Branch] = {
    "front": Front(FrontNetConfig(width=8)),
    "back": Back(BackNetConfig(width=8), DiscriminatorConfig(width=8)),
}


def saved(folder: Path, branch: Branch, size: tuple[int, int]) -> tuple[Path, Learner]:
    """A checkpoint of a branch that learned nothing, and its learner."""
    torch.manual_seed(0)
    learner = Learner(branch, SPAN, 1e-3)
    for parameter in learner.networks["generator"].parameters():
        torch.nn.init.normal_(parameter, std=0.05)
    plain = {**asdict(TrainConfig(views=ViewsConfig(size=size))), "branch": to_record(branch)}
    path = folder / f"{branch.name}.pt"
    record = json.loads(json.dumps(plain))
    checkpoint.save(path, Checkpoint(record, SPAN, learner.state(), [], {}))
    return path, learner


def given(views: Views, index: int) -> GivenView:
    subject, view = views.place(index)
    maps = views.dataset.shard(subject).view(view)
    pixel = views.dataset.shard(subject).meta["camera"]["pixel_size"]
    names = ("rgb_front", "depth_sensor", "body_depth_back", "mask")
    return GivenView(*(maps[name] for name in names), pixel)


@pytest.mark.parametrize("side", ["front", "back"])
def test_it_predicts_what_the_learner_does_in_the_whole_views_grid(
    data: Path, tmp_path: Path, side: str
) -> None:
    size = (68, 72)  # larger than any silhouette
    path, learner = saved(tmp_path, BRANCHES[side], size)
    views = Views(data, "test", ViewsConfig(size=size), varied=False)
    predictor = Predictor(path, BRANCHES[side].side)
    for index in range(len(views)):
        view = given(views, index)
        found = predictor.depth(view)
        assert found.shape == view.mask.shape
        assert ((found > 0) == view.mask).all()
        sample = Sample(*(part[None] for part in views[index]))
        expected = learner.predict(sample)[0, 0][sample.mask[0, 0]].numpy()
        np.testing.assert_allclose(found[view.mask], expected, atol=1e-6)


def test_a_person_larger_than_the_crop_that_was_learned_from_is_seen_whole(
    data: Path, tmp_path: Path
) -> None:
    path, _ = saved(tmp_path, BRANCHES["front"], (16, 16))
    views = Views(data, "test", ViewsConfig(), varied=False)
    view = given(views, 0)
    assert ((Predictor(path, "front").depth(view) > 0) == view.mask).all()


def test_its_middle_is_that_of_the_depths_it_learned(tmp_path: Path) -> None:
    path, _ = saved(tmp_path, BRANCHES["back"], (64, 64))
    predictor = Predictor(path, "back")
    assert predictor.middle == pytest.approx(2.05)
    assert predictor.needs_body
    assert not Predictor(saved(tmp_path, BRANCHES["front"], (64, 64))[0], "front").needs_body


def test_what_it_cannot_do_without_is_named(data: Path, tmp_path: Path) -> None:
    path, _ = saved(tmp_path, BRANCHES["back"], (64, 64))
    with pytest.raises(CheckpointError, match=r"of the back branch; give one of the front"):
        Predictor(path, "front")
    predictor = Predictor(path, "back")
    view = given(Views(data, "test", ViewsConfig(), varied=False), 0)
    nothing = np.zeros_like(view.sensor)
    for change, said in (
        ({"mask": np.zeros_like(view.mask)}, "there is nobody"),
        ({"sensor": nothing}, "the sensor read nothing"),
        ({"body_back": nothing}, "no body lies in the silhouette"),
    ):
        with pytest.raises(ValueError, match=said):
            predictor.depth(view._replace(**change))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("size", [(30, 40), (10, 12), (10, 40)])
def test_a_crop_laid_back_is_the_image_where_the_window_was(
    size: tuple[int, int], mirrored: bool
) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(1, 255, (40, 50, 3), dtype=np.uint8)
    mask = np.zeros((40, 50), bool)
    mask[5:28, 31:49] = True
    crop = Crop(mask, size, mirrored, None)
    back = crop.laid_back(crop.cut(image[crop.rectangle]), mask.shape)
    there = back.any(axis=2)
    np.testing.assert_array_equal(back[there], image[there])
    rows, columns = (min(n, m) for n, m in zip(size, (23, 18), strict=True))
    assert there.sum() == rows * columns
    assert (there & ~mask).sum() == 0
