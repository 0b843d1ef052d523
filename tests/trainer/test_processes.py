"""Two processes that learn together: the same steps as one that has the whole batch.

This file is also what the two run: torchrun starts it with a folder, see `_learn_together`.
"""

from __future__ import annotations

import copy
import gc
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, distributed
from torch.optim import SGD, Adam

from shards.lock import LOCK
from trainer import checkpoint, processes
from trainer.branch import Back, Branch, Front
from trainer.learner import Learner
from trainer.losses import FrontWeights
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.training import BOARD, CHECKPOINT, HISTORY, PICTURE, TrainConfig, Training
from trainer.views import DepthRange, Sample, ViewsConfig

ROOT = Path(__file__).parents[2]
TIMEOUT = 240
"""Seconds after which processes that wait for each other are ended; they need about ten."""

JUDGE = DiscriminatorConfig(width=8)
BRANCHES: dict[str, Branch] = {
    "front": Front(net=FrontNetConfig(width=8)),
    "judged front": Front(net=FrontNetConfig(width=8), normal_gan=JUDGE),
    "back": Back(generator=BackNetConfig(width=8), discriminator=JUDGE),
}
SPAN = DepthRange(1.6, 2.4)
BEFORE, STEPS = 3, 4
"""Steps of one process before the comparison, so that no weight is still 0; steps compared."""
RATE = 1e-5
"""Of the steps compared."""

every_branch = pytest.mark.parametrize("name", BRANCHES)


def whole_batch() -> Sample:
    """Four ellipsoids, of which the second process's two are far smaller than the first's."""
    height, width, pixel = 64, 48, 0.02
    rng = torch.Generator().manual_seed(0)
    i, j = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    scale = torch.tensor([1.0, 0.9, 0.35, 0.3]).view(4, 1, 1, 1)
    x = (j + 0.5 - width / 2) * pixel / (0.4 * scale)
    y = (i + 0.5 - height / 2) * pixel / (0.55 * scale)
    bulge = (1 - x**2 - y**2).clamp_min(0).sqrt() * 0.2 * scale
    mask = bulge > 0

    def inside(maps: Tensor) -> Tensor:
        return torch.where(mask, maps, 0).float()

    noise = 0.01 * torch.randn(bulge.shape, generator=rng)
    return Sample(
        rgb=inside(torch.rand(4, 3, height, width, generator=rng)),
        sensor=inside(2 - bulge + noise),
        valid=mask,
        front=inside(2 - bulge),
        back=inside(2 + bulge),
        coarse=inside(2 + 0.7 * bulge),
        body=bulge > 0.05 * scale,
        mask=mask,
        pixel_size=torch.full((4,), pixel),
        index=torch.arange(4),
    )


def half(batch: Sample, number: int) -> Sample:
    """The part of a batch that one of two processes has."""
    return Sample(*(part.chunk(2)[number] for part in batch))


def gradients(learner: Learner) -> dict[str, list[Tensor]]:
    """After a step: that of each weight, by network."""
    return {
        name: [weight.grad.clone() for weight in network.parameters()]
        for name, network in learner.networks.items()
    }


def weights(learner: Learner) -> dict[str, list[Tensor]]:
    """Of each network."""
    return {
        name: [weight.detach().clone() for weight in network.parameters()]
        for name, network in learner.networks.items()
    }


def learn(
    learner: Learner, state: dict[str, dict], batch: Sample
) -> tuple[dict[str, list[Tensor]], dict[str, list[Tensor]], dict[str, Tensor]]:
    """From a state: the first step's gradients, the weights after all steps, the first terms."""
    learner.optimizers = {n: Adam(net.parameters()) for n, net in learner.networks.items()}
    learner.load_state(copy.deepcopy(state))
    # Adam moves a weight as far for a gradient that is rounding alone as for any other: what is
    # left of that after some steps says nothing of how well the processes agree.
    learner.optimizers = {
        name: SGD(network.parameters(), lr=RATE) for name, network in learner.networks.items()
    }
    terms = learner.step(batch)
    first = gradients(learner)
    for _ in range(STEPS - 1):
        learner.step(batch)
    return first, weights(learner), terms


def off(found: list[Tensor], expected: list[Tensor]) -> float:
    """The largest difference, relative to the largest expected value."""
    most = max(float(value.abs().max()) for value in expected)
    return max(float((a - b).abs().max()) for a, b in zip(found, expected, strict=True)) / most


def _learn_together(folder: Path) -> None:
    """One of two processes: what it finds out about both, and what it learns from its half."""
    torch.set_num_threads(1)
    before = processes.count(), processes.rank()
    device = processes.join(torch.device("cpu"))
    again = processes.join(device)
    me = processes.rank()
    mine = torch.tensor([1.0, 10.0]) * (me + 1)
    asked = mine.clone().requires_grad_()
    found: dict[str, Any] = {
        "before": before,
        "device": [str(device), str(again)],
        "joined": (processes.count(), me),
        "backend": distributed.get_backend(),
        "total": processes.total(mine),
        "mean": processes.mean(mine),
        "mine": mine,
        "graph": processes.total(asked).requires_grad or processes.mean(asked).requires_grad,
    }
    given = torch.load(folder / "given.pt", weights_only=True)
    batch = half(Sample(*given["batch"]), me)
    for name, branch in BRANCHES.items():
        torch.manual_seed(me)  # each draws other weights: the first's are to be everyone's
        learner = Learner(branch, SPAN, 1e-3)
        found[f"{name} drawn"] = weights(learner)
        found[name] = learn(learner, given[name], batch)
        found[f"{name} terms"] = {k: processes.mean(term) for k, term in found[name][2].items()}
    # Who still holds the group when Python ends is aborted by gloo's threads now and then.
    del learner
    gc.collect()
    processes.leave()
    found["left"] = (processes.count(), processes.rank())
    torch.save(found, folder / f"{me}.pt")


def torchrun(*command: object, count: int = 2) -> subprocess.CompletedProcess[str]:
    """Start processes by the real torchrun, on a port of its own choice; none outlives the call."""
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": str(ROOT),
        "CUDA_VISIBLE_DEVICES": "",
    }
    arguments = ["--standalone", "--nproc-per-node", count, *command]
    started = subprocess.Popen(
        [sys.executable, "-m", "torch.distributed.run", *map(str, arguments)],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        output, errors = started.communicate(timeout=TIMEOUT)
    finally:
        if started.poll() is None:
            os.killpg(started.pid, signal.SIGKILL)
            started.wait()
    return subprocess.CompletedProcess(started.args, started.returncode, output, errors)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def alone() -> dict[str, Learner]:
    """A learner of each branch, in one process, some steps old."""
    torch.set_num_threads(1)
    learners = {}
    for name, branch in BRANCHES.items():
        torch.manual_seed(0)
        learners[name] = Learner(branch, SPAN, 1e-3)
        for _ in range(BEFORE):
            learners[name].step(whole_batch())
    return learners


@pytest.fixture(scope="module")
def states(alone: dict[str, Learner]) -> dict[str, dict[str, dict]]:
    """What the learners knew then."""
    return {name: copy.deepcopy(learner.state()) for name, learner in alone.items()}


@pytest.fixture(scope="module")
def together(
    states: dict[str, dict[str, dict]], tmp_path_factory: pytest.TempPathFactory
) -> list[dict[str, Any]]:
    """What each of two processes found, which learn from there."""
    folder = tmp_path_factory.mktemp("together")
    torch.save({**states, "batch": list(whole_batch())}, folder / "given.pt")
    done = torchrun(__file__, folder)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    return [torch.load(folder / f"{rank}.pt", weights_only=True) for rank in range(2)]


def test_one_process_is_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    cpu, values = torch.device("cpu"), torch.tensor([1.0, 2.0], requires_grad=True)
    for world in (None, "1"):  # as torchrun with one process says
        if world is not None:
            monkeypatch.setenv("WORLD_SIZE", world)
        assert processes.join(cpu) == cpu
        assert not distributed.is_initialized()
        assert (processes.count(), processes.rank()) == (1, 0)
        assert processes.total(values) is values
        assert processes.mean(values) is values
        processes.leave()


def test_more_processes_than_gpus_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    there = torch.cuda.device_count()
    monkeypatch.setenv("WORLD_SIZE", str(there + 2))
    monkeypatch.setenv("LOCAL_RANK", str(there))
    with pytest.raises(ValueError, match=rf"\A{there} GPUs .*--nproc-per-node {there}\Z"):
        processes.join(torch.device("cuda"))
    assert not distributed.is_initialized()


def test_two_processes_meet_count_add_and_part(together: list[dict[str, Any]]) -> None:
    for rank, found in enumerate(together):
        assert found["before"] == (1, 0)
        assert found["device"] == ["cpu", "cpu"]
        assert found["backend"] == "gloo"
        assert found["joined"] == (2, rank)
        assert found["mine"].tolist() == [1 + rank, 10 + 10 * rank]  # is left as it was
        assert found["total"].tolist() == [3, 30]
        assert found["mean"].tolist() == [1.5, 15]
        assert not found["graph"]
        assert found["left"] == (1, 0)


@every_branch
def test_all_begin_with_the_firsts_weights(together: list[dict[str, Any]], name: str) -> None:
    torch.manual_seed(0)
    expected = weights(Learner(BRANCHES[name], SPAN, 1e-3))
    for found in together:
        for network, drawn in found[f"{name} drawn"].items():
            assert all(map(torch.equal, drawn, expected[network])), network


@every_branch
def test_two_halves_have_the_whole_batchs_gradient(
    alone: dict[str, Learner],
    states: dict[str, dict[str, dict]],
    together: list[dict[str, Any]],
    name: str,
) -> None:
    batch = whole_batch()
    pixels = [half(batch, number).mask.sum() for number in range(2)]
    assert pixels[0] > 5 * pixels[1]
    expected, _, terms = learn(alone[name], states[name], batch)
    separate = [learn(alone[name], states[name], half(batch, number))[0] for number in range(2)]
    first, second = (found[name][0] for found in together)
    assert set(first) == set(alone[name].networks)
    for network, whole in expected.items():
        assert all(gradient.any() for gradient in whole), network
        assert off(first[network], whole) < 1e-5, network
        assert all(map(torch.equal, first[network], second[network])), network
        # The mean of what each would do by itself is another step.
        pairs = zip(*(one[network] for one in separate), strict=True)
        assert off([(a + b) / 2 for a, b in pairs], whole) > 0.02, network
    for found in together:
        means = found[f"{name} terms"]
        assert set(means) == set(terms)
        for term, value in terms.items():
            assert means[term] == pytest.approx(float(value), rel=1e-5), term


@every_branch
def test_weights_stay_equal_and_near_those_of_one_process(
    alone: dict[str, Learner],
    states: dict[str, dict[str, dict]],
    together: list[dict[str, Any]],
    name: str,
) -> None:
    start = {network: list(states[name][network].values()) for network in alone[name].networks}
    _, expected, _ = learn(alone[name], states[name], whole_batch())
    first, second = (found[name][1] for found in together)
    for network, ours in expected.items():
        assert all(map(torch.equal, first[network], second[network])), network
        went, apart = (
            torch.cat([(a - b).flatten() for a, b in zip(ours, other, strict=True)])
            for other in (start[network], first[network])
        )
        assert went.norm() > 0
        assert apart.norm() < 1e-3 * went.norm(), network


# The real command, on the ellipsoids.

CONFIG = TrainConfig(
    branch=Front(net=FrontNetConfig(width=8), gamma=FrontWeights(depth=2.0)),
    views=ViewsConfig(size=(64, 48)),
    epochs=2,
    batch=4,
)
YAML = """
branch:
  class_path: Front
  init_args:
    net:
      width: 8
    gamma:
      depth: 2.0
views:
  size: [64, 48]
epochs: 2
batch: 4
"""
TIMES = {"seconds", "waiting", "test_seconds"}


def train(data: Path, run: Path, **changes: object) -> subprocess.CompletedProcess[str]:
    """`pipeline.py train`, as a user would start it in two processes."""
    config = run.with_suffix(".yaml")
    config.write_text(YAML)
    options = [word for name, value in changes.items() for word in (f"--{name}", value)]
    where = ("--data", data, "--output", run, "--workers", 0)
    return torchrun("pipeline.py", "train", "--config", config, *where, *options)


def history(run: Path) -> list[dict[str, float]]:
    """A line for each epoch, but for how long it took."""
    lines = (run / HISTORY).read_text().splitlines()
    return [{k: v for k, v in json.loads(line).items() if k not in TIMES} for line in lines]


def assert_near(found: list[dict[str, float]], expected: list[dict[str, float]]) -> None:
    assert len(found) == len(expected)
    for ours, theirs in zip(found, expected, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-3)


@pytest.fixture(scope="module")
def by_one(data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, float]]:
    """The history of the same training in one process."""
    torch.set_num_threads(1)
    run = tmp_path_factory.mktemp("one") / "run"
    Training(CONFIG, data, run).run()
    return history(run)


def test_the_command_trains_in_two_processes_as_in_one_which_can_go_on_with_it(
    data: Path, tmp_path: Path, by_one: list[dict[str, float]]
) -> None:
    run = tmp_path / "run"
    done = train(data, run)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in run.iterdir()} == {*(CHECKPOINT, HISTORY, PICTURE, BOARD, LOCK)}
    assert len(list((run / BOARD).iterdir())) == 1  # written by one of them
    found = checkpoint.load(run / CHECKPOINT)
    assert len(found.metrics) == 2
    assert_near(history(run), by_one)
    assert by_one[1]["loss_normal"] < by_one[0]["loss_normal"]
    # Said once, by the first.
    result, figures = done.stdout.splitlines()
    assert result == f"2 epochs in {run / CHECKPOINT}"
    assert figures.startswith(f"test depth off by {found.metrics[1]['depth_mm']:.2f} mm")
    assert len(re.findall(r"^front: 8 views .* 2 x cpu", done.stderr, re.MULTILINE)) == 1
    assert len(re.findall(r"^ +epoch \d/2:", done.stderr, re.MULTILINE)) == 2
    assert "Warning" not in done.stderr
    # One process takes it up where two stopped.
    rest = Training(TrainConfig(**{**vars(CONFIG), "epochs": 3}), data, run)
    assert rest.done == 2
    rest.run()
    assert_near(history(run)[:2], by_one)
    assert len(history(run)) == 3


def test_two_processes_go_on_where_one_stopped(
    data: Path, tmp_path: Path, by_one: list[dict[str, float]]
) -> None:
    run = tmp_path / "run"
    Training(TrainConfig(**{**vars(CONFIG), "epochs": 1}), data, run).run()
    (before,) = history(run)
    done = train(data, run)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("1 of 2 epochs stand already") == 1
    assert history(run)[0] == before
    assert_near(history(run), by_one)


def test_a_batch_that_two_cannot_share_is_refused(data: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    done = train(data, run, batch=3)
    assert done.returncode != 0
    assert not done.stdout
    said = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert set(said) == {"error: batch: 3 for 2 processes; give a multiple of that"}
    before_torchrun = done.stderr.partition("torch/distributed/elastic")[0]
    assert "Traceback" not in before_torchrun
    assert not run.exists()


if __name__ == "__main__":
    _learn_together(Path(sys.argv[1]))
