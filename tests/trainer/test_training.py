"""Real trainings of minutes' worth in seconds: they learn, stop, go on, and say what is wrong."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
import torch

from trainer import checkpoint
from trainer.back import BackNetConfig
from trainer.branch import Back, Branch, Front
from trainer.checkpoint import CheckpointError
from trainer.discriminator import DiscriminatorConfig
from trainer.front import FrontNetConfig
from trainer.losses import FrontWeights
from trainer.training import CHECKPOINT, HISTORY, TrainConfig, Training
from trainer.views import ViewsConfig

# At eight views the depth of Eq. 10, in metres, is learned slowly: the normals weigh 20 times.
FRONT = Front(net=FrontNetConfig(width=8), gamma=FrontWeights(depth=100.0))
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
    record = {**asdict(config), "branch": {"name": branch.name, **asdict(branch)}}
    return Training(config, record, data, output)


@pytest.mark.parametrize("branch", [FRONT, BACK])
def test_it_learns(data: Path, tmp_path: Path, branch: Branch) -> None:
    """On ellipsoids it has not seen: a share of what it was given."""
    epochs = 30 if branch is BACK else 150
    made = training(data, tmp_path / "run", branch, epochs)
    figures = made.run()
    assert min(of_epoch["depth_ratio"] for of_epoch in made.history) < 0.75
    assert figures["normal_ratio"] < 0.75
    lines = (tmp_path / "run" / HISTORY).read_text().splitlines()
    assert len(lines) == epochs
    assert json.loads(lines[-1])["depth_mm"] == figures["depth_mm"]
    assert 0 <= figures["waiting"] <= 1


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
    assert whole["epoch"] == parts["epoch"] == 4

    def tensors(value: object) -> list[torch.Tensor]:
        if isinstance(value, torch.Tensor):
            return [value]
        parts = value.values() if isinstance(value, dict) else value
        return [t for p in parts for t in tensors(p)] if isinstance(value, (dict, list)) else []

    pairs = list(zip(tensors(whole["state"]), tensors(parts["state"]), strict=True))
    assert len(pairs) > 100
    assert all(torch.equal(a, b) for a, b in pairs)
    timed = ("seconds", "waiting")
    for one, other in zip(whole["metrics"], parts["metrics"], strict=True):
        assert {k: v for k, v in one.items() if k not in timed} == {
            k: v for k, v in other.items() if k not in timed
        }


def test_an_untrained_branch_gives_back_what_it_was_given(data: Path, tmp_path: Path) -> None:
    for branch in (FRONT, BACK):
        made = training(data, tmp_path / branch.name, branch, 1)
        batch = next(iter(made._loader(made.test_views, 0, False)))
        predicted, given = made.learner.predict(batch), made.learner.given(batch)
        torch.testing.assert_close(predicted, given, atol=1e-6, rtol=0)


def test_a_checkpoint_of_another_schema_or_none_is_refused(data: Path, tmp_path: Path) -> None:
    training(data, tmp_path, FRONT, 1).run()
    path = tmp_path / CHECKPOINT
    whole = path.read_bytes()
    found = torch.load(path, weights_only=True)
    torch.save({**found, "schema": 7}, path)
    with pytest.raises(CheckpointError, match="has schema 7, this program reads 1; train again"):
        training(data, tmp_path, FRONT, 1)
    for torn in (whole[: len(whole) // 2], b"", b"text"):
        path.write_bytes(torn)
        with pytest.raises(CheckpointError, match="is no checkpoint, or a torn one"):
            checkpoint.load(path)
    with pytest.raises(CheckpointError, match="is missing"):
        checkpoint.load(tmp_path / "none.pt")


def test_another_configuration_or_folder_is_refused(data: Path, tmp_path: Path) -> None:
    training(data, tmp_path / "run", FRONT, 1).run()
    with pytest.raises(CheckpointError, match=r"of another configuration \(learning_rate\)"):
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
