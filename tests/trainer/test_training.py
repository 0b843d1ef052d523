"""Real trainings of minutes' worth in seconds: they learn, stop, go on, and say what is wrong."""

from __future__ import annotations

import json
import math
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from shards.archive import write_shard
from shards.dataset import Dataset, DatasetWriter
from shards.lock import LOCK, lock_folder
from shards.manifest import DatasetError
from trainer import checkpoint
from trainer.branch import Back, Branch, Front
from trainer.checkpoint import CheckpointError
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.training import (
    BOARD,
    CHECKPOINT,
    HISTORY,
    PICTURE,
    DivergedError,
    TrainConfig,
    Training,
)
from trainer.views import Sample, Views, ViewsConfig

FRONT = Front(net=FrontNetConfig(width=8))
BACK = Back(generator=BackNetConfig(width=8), discriminator=DiscriminatorConfig(width=8))


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def training(data: Path, output: Path, branch: Branch, epochs: int, **changes: object) -> Training:
    config = TrainConfig(
        branch=branch,
        views=ViewsConfig(size=(64, 48)),
        epochs=epochs,
        batch=4,
        **changes,  # type: ignore[arg-type]
    )
    return Training(config, data, output)


@pytest.mark.parametrize("branch", [FRONT, BACK])
def test_it_learns(data: Path, tmp_path: Path, branch: Branch) -> None:
    """On ellipsoids it has not seen: a share of what it was given."""
    epochs = 30 if branch is BACK else 150
    made = training(data, tmp_path / "run", branch, epochs)
    figures = made.run()
    assert figures["depth_ratio"] < 0.75
    assert figures["normal_ratio"] < 0.75
    lines = (tmp_path / "run" / HISTORY).read_text().splitlines()
    assert len(lines) == epochs
    assert json.loads(lines[-1])["depth_mm"] == figures["depth_mm"]


def test_every_epoch_sees_other_noise_in_another_order_at_its_own_rate(
    data: Path, tmp_path: Path
) -> None:
    made = training(data, tmp_path, FRONT, 2, decay="cosine")
    seen: list[tuple[Sample, float]] = []
    step = made.learner.step

    def spied(batch: Sample) -> dict[str, torch.Tensor]:
        (group,) = made.learner.optimizers["generator"].param_groups
        seen.append((batch, group["lr"]))
        return step(batch)

    made.learner.step = spied  # type: ignore[method-assign]
    made.run()
    steps = len(seen) // 2
    rates = [0.5e-3 * (1 + math.cos(math.pi * k / len(seen))) for k in range(len(seen))]
    assert [rate for _, rate in seen] == pytest.approx(rates)
    epochs = [[batch for batch, _ in part] for part in (seen[:steps], seen[steps:])]
    orders = [torch.cat([batch.index for batch in epoch]).tolist() for epoch in epochs]
    assert sorted(orders[0]) == sorted(orders[1]) == list(range(8))
    assert orders[0] != orders[1]
    # Sorted, a view's noise is the same whether it was mirrored or not.
    noises = [
        {
            int(index): (sensor - front).flatten().sort().values
            for batch in epoch
            for index, sensor, front in zip(batch.index, batch.sensor, batch.front, strict=True)
        }
        for epoch in epochs
    ]
    assert not any(torch.equal(noises[0][index], noises[1][index]) for index in range(8))


class _Slow(Views):
    def __getitem__(self, index: int) -> Sample:
        time.sleep(0.3)
        return super().__getitem__(index)


def test_the_share_of_time_that_is_waited_for_data_is_told(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares = []
    for name, views in (("quick", Views), ("slow", _Slow)):
        monkeypatch.setattr("trainer.training.Views", views)
        made = training(data, tmp_path / name, FRONT, 1)
        if name == "quick":
            step = made.learner.step
            made.learner.step = lambda batch, step=step: (time.sleep(1), step(batch))[1]
        shares.append(made.run()["waiting"])
    assert shares[0] < 0.3 < 0.8 < shares[1] <= 1


@pytest.mark.parametrize("branch", [FRONT, BACK])
def test_interrupted_and_resumed_equals_uninterrupted_to_the_bit(
    data: Path, tmp_path: Path, branch: Branch
) -> None:
    training(data, tmp_path / "whole", branch, 4).run()
    training(data, tmp_path / "parts", branch, 2).run()
    rest = training(data, tmp_path / "parts", branch, 4)
    assert rest.done == 2
    rest.run()
    whole, parts = (checkpoint.load(tmp_path / n / CHECKPOINT) for n in ("whole", "parts"))
    assert len(whole.metrics) == len(parts.metrics) == 4

    def tensors(value: object) -> list[torch.Tensor]:
        if isinstance(value, torch.Tensor):
            return [value]
        parts = value.values() if isinstance(value, dict) else value
        return [t for p in parts for t in tensors(p)] if isinstance(value, (dict, list)) else []

    pairs = list(zip(tensors(whole.state), tensors(parts.state), strict=True))
    assert len(pairs) > 100
    assert all(torch.equal(a, b) for a, b in pairs)
    timed = ("seconds", "waiting", "test_seconds")
    for one, other in zip(whole.metrics, parts.metrics, strict=True):
        assert {k: v for k, v in one.items() if k not in timed} == {
            k: v for k, v in other.items() if k not in timed
        }


def test_an_untrained_branch_gives_back_what_it_was_given(data: Path, tmp_path: Path) -> None:
    for branch in (FRONT, BACK):
        made = training(data, tmp_path / branch.name, branch, 1)
        batch = Sample(*(part[None] for part in made.test_views[0]))
        predicted, given = made.learner.predict(batch), branch.given(batch)
        torch.testing.assert_close(predicted, given, atol=1e-6, rtol=0)


def test_a_checkpoint_of_another_schema_or_none_is_refused(data: Path, tmp_path: Path) -> None:
    training(data, tmp_path, FRONT, 1).run()
    path = tmp_path / CHECKPOINT
    whole = path.read_bytes()
    found = torch.load(path, weights_only=True)
    torch.save({**found, "schema": 7}, path)
    with pytest.raises(CheckpointError, match="has schema 7, this program reads 3; train again"):
        training(data, tmp_path, FRONT, 1)
    for torn in (whole[: len(whole) // 2], b"", b"text"):
        path.write_bytes(torn)
        with pytest.raises(CheckpointError, match="is no checkpoint, or a torn one"):
            checkpoint.load(path)
    with pytest.raises(CheckpointError, match="is missing"):
        checkpoint.load(tmp_path / "none.pt")


def test_what_a_killed_training_left_half_written_is_in_nobodys_way(
    data: Path, tmp_path: Path
) -> None:
    """A kill during the first checkpoint leaves its temporary file, and what was told before it."""
    run = tmp_path / "run"
    run.mkdir()
    (run / f".{CHECKPOINT}.host.1.tmp").write_bytes(b"half")
    (run / HISTORY).write_text("{}\n")
    (run / PICTURE).touch()
    training(data, run, FRONT, 1).run()
    assert {path.name for path in run.iterdir()} == {*(CHECKPOINT, HISTORY, PICTURE, BOARD, LOCK)}
    assert len((run / HISTORY).read_text().splitlines()) == 1


def test_a_loss_that_is_no_number_is_told(data: Path, tmp_path: Path) -> None:
    made = training(data, tmp_path / "run", FRONT, 1)
    for weight in made.learner.networks["generator"].parameters():
        torch.nn.init.constant_(weight, torch.nan)
    with pytest.raises(DivergedError, match=r"in epoch 1 a loss was not finite .* in a new folder"):
        made.run()
    assert not (tmp_path / "run" / CHECKPOINT).exists()


def test_another_configuration_or_folder_is_refused(data: Path, tmp_path: Path) -> None:
    training(data, tmp_path / "run", FRONT, 1).run()
    with pytest.raises(
        CheckpointError,
        match=r"of another configuration \(learning_rate is 0\.001 there and 0\.01 here\)",
    ):
        training(data, tmp_path / "run", FRONT, 1, learning_rate=0.01)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(ValueError, match=r"is not empty and holds no checkpoint\.pt"):
        training(data, tmp_path / "full", FRONT, 1)


@pytest.mark.parametrize(
    "wrong", [{"epochs": 0}, {"batch": 0}, {"learning_rate": 0.0}, {"seed": -1}]
)
def test_a_wrong_setting_is_named(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: "):
        TrainConfig(**wrong)  # type: ignore[arg-type]


def test_more_epochs_may_follow_unless_the_rate_was_laid_out_for_them(
    data: Path, tmp_path: Path
) -> None:
    training(data, tmp_path / "plain", FRONT, 1).run()
    assert training(data, tmp_path / "plain", FRONT, 2).done == 1
    training(data, tmp_path / "decay", FRONT, 1, decay="cosine").run()
    with pytest.raises(CheckpointError, match=r"\(epochs is 1 there and 2 here\)"):
        training(data, tmp_path / "decay", FRONT, 2, decay="cosine")


def test_fewer_epochs_than_stand_are_refused(data: Path, tmp_path: Path) -> None:
    training(data, tmp_path, FRONT, 2).run()
    with pytest.raises(
        ValueError, match=r"\Aepochs: 1, but .*checkpoint\.pt has 2 behind it; give"
    ):
        training(data, tmp_path, FRONT, 1)
    assert training(data, tmp_path, FRONT, 2).run()["depth_mm"] > 0


def test_one_training_at_a_time_in_a_folder_and_none_while_its_data_are_built(
    data: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    made = training(data, run, FRONT, 1)
    with lock_folder(run), pytest.raises(DatasetError, match="is in use by another build"):
        made.run()
    copy = tmp_path / "data"
    shutil.copytree(data, copy)
    waits = training(copy, tmp_path / "other", FRONT, 1)
    with lock_folder(copy), pytest.raises(DatasetError, match="a build is writing"):
        waits.run()
    assert not (tmp_path / "other").exists()
    waits.run()
    # What was opened before another one trained here knows too little to go on.
    late = training(data, run, FRONT, 2)
    made.run()
    with pytest.raises(CheckpointError, match="another training went on here meanwhile"):
        late.run()
    assert len(checkpoint.load(run / CHECKPOINT).metrics) == 1


def test_the_rate_falls_by_half_a_cosine(data: Path, tmp_path: Path) -> None:
    made = training(data, tmp_path, FRONT, 4, decay="cosine")
    rates = [made._rate(step, 2) for step in range(8)]
    assert rates[0] == 1e-3
    assert rates[4] == pytest.approx(0.5e-3)
    assert rates[7] == pytest.approx(1e-3 * 0.5 * (1 + math.cos(math.pi * 7 / 8)))
    assert rates == sorted(rates, reverse=True)


def test_a_damaged_state_is_refused(data: Path, tmp_path: Path) -> None:
    training(data, tmp_path, FRONT, 1).run()
    path = tmp_path / CHECKPOINT
    found = torch.load(path, weights_only=True)
    del found["state"]["generator"]["decoder.head.bias"]
    torch.save(found, path)
    with pytest.raises(CheckpointError, match=r"cannot be used: .*decoder\.head\.bias.*again\Z"):
        training(data, tmp_path, FRONT, 2)


def test_a_back_without_bodies_is_made_from_the_front_or_not_at_all(
    data: Path, tmp_path: Path
) -> None:
    bare = tmp_path / "bare"
    base = Dataset(data)
    with DatasetWriter(bare, {}, base.subjects(), 0, {}) as writer:
        for name in base.subjects():
            shard = base.shard(name)
            maps = {member: shard[member] for member in shard.names}
            maps["body_depth_back"] = np.zeros_like(maps["body_depth_back"])
            written = write_shard(writer.shard_path(name), maps, shard.meta)
            writer.add(name, *written, 0.1, "CC0-1.0")
        writer.finish()
    with pytest.raises(
        ValueError, match=r"has no body to refine, nor have 4 more; .*source sensor"
    ):
        training(bare, tmp_path / "run", BACK, 1)
    assert training(bare, tmp_path / "run", replace(BACK, source="sensor"), 1).run()["depth_mm"] > 0
