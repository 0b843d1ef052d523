"""A branch's networks at work: alone by heart, in half precision, kept apart, and from a file."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from trainer import learner as learners
from trainer.branch import Back, Branch, Front
from trainer.checkpoint import CheckpointError
from trainer.errors import errors
from trainer.learner import Learner, Precision
from trainer.losses import BackWeights, FrontWeights
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.training import CHECKPOINT, TrainConfig, Training
from trainer.views import DepthRange, Sample, Views, ViewsConfig

SIZE = ViewsConfig(size=(64, 48))
JUDGE = DiscriminatorConfig(width=8)
SEEDS = 3
"""Learners whose losses are averaged where one alone is chance."""
FRONT = Front(net=FrontNetConfig(width=8))
JUDGED_FRONT = Front(net=FrontNetConfig(width=8), normal_gan=JUDGE)
BACK = Back(generator=BackNetConfig(width=8), discriminator=JUDGE)
BRANCHES = {"front": FRONT, "back": BACK}
JUDGED = {"front": JUDGED_FRONT, "back": BACK}

every_branch = pytest.mark.parametrize("branch", BRANCHES.values(), ids=BRANCHES)
every_judged_branch = pytest.mark.parametrize("branch", JUDGED.values(), ids=JUDGED)
both_precisions = pytest.mark.parametrize("precision", ["float32", "bfloat16"])


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def views(data: Path) -> Views:
    return Views(data, "train", SIZE, varied=False)


@pytest.fixture(scope="module")
def batch(views: Views) -> Sample:
    """A view of each of the four subjects to learn from."""
    return Sample(*map(torch.stack, zip(*(views[i] for i in (0, 2, 4, 6)), strict=True)))


@pytest.fixture(scope="module")
def span(views: Views) -> DepthRange:
    return views.depth_range()


@pytest.fixture(scope="module", params=["front", "back"])
def scholar(request: pytest.FixtureRequest, batch: Sample, span: DepthRange) -> Learner:
    """A learner that had 300 steps on four views."""
    torch.set_num_threads(1)
    branch = Front(net=FrontNetConfig(width=16)) if request.param == "front" else BACK
    made = new(branch, span, rate=0.003)
    for _ in range(300):
        made.step(batch)
    return made


def new(
    branch: Branch,
    span: DepthRange,
    rate: float = 1e-3,
    precision: Precision = "float32",
    seed: int = 0,
) -> Learner:
    torch.manual_seed(seed)
    return Learner(branch, span, rate, precision=precision)


def kept(state: dict[str, dict]) -> dict[str, dict]:
    """A state as a file would keep it."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


def tensors(value: Any) -> list[Tensor]:
    """All of a state's."""
    if isinstance(value, Tensor):
        return [value]
    parts = value.values() if isinstance(value, dict) else value
    return [t for p in parts for t in tensors(p)] if isinstance(value, (dict, list)) else []


def same(one: Any, other: Any) -> bool:
    """Whether two states agree to the bit."""
    return all(torch.equal(a, b) for a, b in zip(tensors(one), tensors(other), strict=True))


def weights(learner: Learner, name: str) -> Tensor:
    """All of a network's, as one vector."""
    return torch.cat([p.detach().flatten() for p in learner.networks[name].parameters()])


def gradients(network: nn.Module) -> list[Tensor | None]:
    return [None if p.grad is None else p.grad.clone() for p in network.parameters()]


def test_four_views_are_learned_by_heart(scholar: Learner, batch: Sample) -> None:
    """The front to 3 mm and 3 degrees, of 9 and 18 that its sensor is off; the back to 10 and 8.

    The back's are of 38 mm and 19 degrees, and it has to please its discriminator besides.
    """
    found = errors(scholar, [batch])
    bounds = (3, 3, 9, 18) if scholar.branch.side == "front" else (10, 8, 38, 19)
    depth_mm, normal_deg, given_mm, given_deg = bounds
    assert found["given_mm"] > given_mm
    assert found["given_deg"] > given_deg
    assert found["depth_mm"] < depth_mm
    assert found["normal_deg"] < normal_deg


def test_half_precision_predicts_what_full_precision_does(
    scholar: Learner, batch: Sample, span: DepthRange
) -> None:
    """Of the same weights, to 2 mm at every pixel of the front and 0.2 in the mean.

    The back's corrections are larger, and so is their rounding: 6 mm and 0.6. What either is off
    from the true surface stays the same to a tenth of a millimetre and of a degree.
    """
    half = Learner(scholar.branch, span, 1e-3, precision="bfloat16")
    half.load_state(kept(scholar.state()))
    off = 1000 * (half.predict(batch) - scholar.predict(batch)).abs()[batch.mask]
    most, mean = (2.0, 0.2) if scholar.branch.side == "front" else (6.0, 0.6)
    assert 0 < off.max() < most
    assert off.mean() < mean
    ours, theirs = errors(half, [batch]), errors(scholar, [batch])
    for name in ("depth_mm", "normal_deg"):
        assert ours[name] == pytest.approx(theirs[name], abs=0.1)


@every_judged_branch
@both_precisions
def test_a_step_computes_in_its_precision_and_keeps_32_bits(
    branch: Branch, precision: Precision, batch: Sample, span: DepthRange
) -> None:
    learner = new(branch, span, precision=precision)
    before = {name: weights(learner, name) for name in learner.networks}
    computed = set()
    for network in learner.networks.values():
        for module in network.modules():
            if isinstance(module, (nn.Conv2d, nn.Linear)):
                module.register_forward_hook(lambda m, given, made: computed.add(made.dtype))
    for _ in range(2):
        for name, term in learner.step(batch).items():
            assert term.dtype == torch.float32, name
            assert term.isfinite(), name
    assert computed == {getattr(torch, precision)}
    assert {t.dtype for t in tensors(learner.state())} == {torch.float32}
    for name, old in before.items():
        assert weights(learner, name).isfinite().all()
        assert not torch.equal(weights(learner, name), old), name
    depth = learner.predict(batch)
    assert depth.dtype == torch.float32
    assert depth.isfinite().all()
    assert not depth[~batch.mask].any()


@every_branch
def test_half_precision_learns_as_full_precision_does(
    branch: Branch, batch: Sample, span: DepthRange
) -> None:
    """To a sixth of the losses after fifty steps, the mean of some: one may go another way."""
    names = ("depth", "normal" if branch is FRONT else "silhouette")
    sums = {precision: dict.fromkeys(names, 0.0) for precision in ("float32", "bfloat16")}
    for precision, total in sums.items():
        for seed in range(SEEDS):
            learner = new(branch, span, precision=precision, seed=seed)
            terms = [learner.step(batch) for _ in range(50)][-1]
            for name in names:
                total[name] += float(terms[name])
    full, half = sums.values()
    first = new(branch, span).step(batch)
    for name in names:
        assert full[name] < 0.9 * SEEDS * first[name], name
        assert half[name] == pytest.approx(full[name], rel=0.16), name


@both_precisions
@every_branch
def test_untrained_networks_return_exactly_the_depth_that_they_are_given(
    branch: Branch, precision: Precision, batch: Sample, span: DepthRange
) -> None:
    given = branch.given(batch)
    predicted = new(branch, span, precision=precision).predict(batch)
    round_trip = torch.where(batch.mask, span.metres(span.normalised(given)), 0)
    assert torch.equal(predicted, round_trip)
    torch.testing.assert_close(predicted, given, atol=1e-6, rtol=0)  # a thousandth of a millimetre


@every_judged_branch
def test_a_rate_of_0_stands_still_and_twice_the_rate_goes_twice_as_far(
    branch: Branch, batch: Sample, span: DepthRange
) -> None:
    learner = new(branch, span)
    learner.step(batch)
    start = kept(learner.state())
    moved = {}
    for rate in (0.0, 1e-4, 2e-4):
        learner = new(branch, span, rate=0.5)
        learner.load_state(kept(start))
        learner.set_rate(rate)
        before = {name: weights(learner, name) for name in learner.networks}
        learner.step(batch)
        moved[rate] = {name: weights(learner, name) - old for name, old in before.items()}
    for name in learner.networks:
        assert not moved[0.0][name].any()
        assert moved[1e-4][name].any()
    # The generator's gradient depends on how far the discriminator went before.
    once, twice = moved[1e-4]["discriminator"], moved[2e-4]["discriminator"]
    torch.testing.assert_close(twice, 2 * once, atol=2e-7, rtol=1e-3)


@every_judged_branch
def test_a_learner_goes_on_from_its_state_to_the_bit(
    branch: Branch, batch: Sample, span: DepthRange
) -> None:
    first = new(branch, span)
    for _ in range(2):
        first.step(batch)
    state = kept(first.state())
    assert set(state) == {"generator", "generator_adam", "discriminator", "discriminator_adam"}
    torch.manual_seed(1)
    second = Learner(branch, span, 1e-3)
    assert not same(second.state()["generator"], state["generator"])
    second.load_state(state)
    for learner in (first, second):
        for _ in range(2):
            learner.step(batch)
    assert same(first.state(), second.state())
    assert torch.equal(first.predict(batch), second.predict(batch))


@pytest.mark.parametrize("branch", [JUDGED_FRONT, BACK])
def test_networks_do_the_same_whether_they_learn_or_not(
    branch: Branch, batch: Sample, span: DepthRange
) -> None:
    learner = new(branch, span)
    learner.step(batch)
    found = []
    for mode in (True, False):
        for network in learner.networks.values():
            network.train(mode)
        judged = learner.surface(learner.predict(batch), batch).normal
        with torch.no_grad():
            found.append([learner.predict(batch), *learner.networks["discriminator"](judged)])
    assert all(map(torch.equal, *found))


@pytest.mark.parametrize(
    ("of", "to"), [(FRONT, BACK), (FRONT, JUDGED_FRONT), (FRONT, Front(net=FrontNetConfig(16)))]
)
def test_a_state_of_other_networks_is_refused(of: Branch, to: Branch, span: DepthRange) -> None:
    with pytest.raises(ValueError, match=r"\Anetworks of another program \(.*\)\Z"):
        new(to, span).load_state(new(of, span).state())


@every_judged_branch
def test_neither_network_has_a_gradient_of_the_others_loss(
    branch: Branch, batch: Sample, span: DepthRange
) -> None:
    """The gradients as each optimiser is about to step: the other's are as they were."""
    learner = new(branch, span)
    judge, generator = (learner.networks[name] for name in ("discriminator", "generator"))
    seen: dict[str, list[Tensor | None]] = {"generator": gradients(generator)}
    order = []

    def judge_steps(*_: Any) -> None:
        order.append("discriminator")
        seen["discriminator"] = gradients(judge)
        assert all(p.requires_grad for p in judge.parameters())
        assert_same(gradients(generator), seen["generator"])

    def generator_steps(*_: Any) -> None:
        order.append("generator")
        seen["generator"] = gradients(generator)
        assert_same(gradients(judge), seen["discriminator"])

    def assert_same(found: list[Tensor | None], expected: list[Tensor | None]) -> None:
        for ours, theirs in zip(found, expected, strict=True):
            assert (ours is None) == (theirs is None)
            assert ours is None or torch.equal(ours, theirs)

    learner.optimizers["discriminator"].register_step_pre_hook(judge_steps)
    learner.optimizers["generator"].register_step_pre_hook(generator_steps)
    for _ in range(3):
        learner.step(batch)
    assert order == 3 * ["discriminator", "generator"]
    for found in seen.values():  # each has one of its own, at every weight
        assert all(g is not None and g.any() for g in found)


@pytest.mark.parametrize(
    "branch",
    [
        Front(
            net=FrontNetConfig(width=8),
            gamma=FrontWeights(depth=0, normal=0, vgg=0, gan=5, matching=0),
            normal_gan=JUDGE,
        ),
        Back(
            generator=BackNetConfig(width=8),
            discriminator=JUDGE,
            beta=BackWeights(depth=0, gan=5, matching=0, silhouette=0, vgg=0),
        ),
    ],
)
def test_a_discriminator_alone_can_teach_the_generator(
    branch: Branch, batch: Sample, span: DepthRange
) -> None:
    """Its parameters stand still for the generator, but its gradient goes through."""
    learner = new(branch, span)
    before = weights(learner, "generator")
    learner.step(batch)
    assert not torch.equal(weights(learner, "generator"), before)


@pytest.fixture(scope="module")
def trained(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Training]:
    """Trainings of one epoch, each done once."""
    done: dict[tuple[str, Precision], Training] = {}

    def train(name: str, precision: Precision = "float32") -> Training:
        torch.set_num_threads(1)
        if (name, precision) not in done:
            config = TrainConfig(
                branch=BRANCHES[name], views=SIZE, epochs=1, batch=4, precision=precision
            )
            made = Training(config, data, tmp_path_factory.mktemp("trained") / "run")
            made.run()
            done[name, precision] = made
        return done[name, precision]

    return train


@both_precisions
@pytest.mark.parametrize("name", BRANCHES)
def test_a_loaded_learner_predicts_to_the_bit_what_the_trainings_does(
    name: str, precision: Precision, trained: Callable[..., Training], batch: Sample
) -> None:
    training = trained(name, precision)
    loaded = learners.load(training.output / CHECKPOINT)
    assert loaded.branch == training.config.branch
    assert loaded.span == training.learner.span
    assert same(loaded.state(), training.learner.state())
    predicted = training.learner.predict(batch)
    assert not torch.allclose(predicted, loaded.branch.given(batch), atol=1e-5)
    assert torch.equal(loaded.predict(batch), predicted)


def other_branch(found: dict[str, Any], **changes: Any) -> None:
    found["config"]["branch"].update(changes)


def first_weight(found: dict[str, Any], value: Any) -> None:
    weights = found["state"]["generator"]
    weights[next(iter(weights))] = value


REFUSED: dict[str, Callable[[dict[str, Any]], Any]] = {
    # Its configuration names other networks.
    "wider": lambda found: other_branch(found, net={"width": 16, "attention": True}),
    "without attention": lambda found: other_branch(found, net={"width": 8, "attention": False}),
    "judged": lambda found: other_branch(found, normal_gan={"width": 8, "strided": 4}),
    "other branch": lambda found: found["config"].update(branch={"name": "back"}),
    "unknown branch": lambda found: other_branch(found, name="side"),
    "unknown key": lambda found: other_branch(found, depth=3),
    "class to import": lambda found: other_branch(found, net={"class_path": "this.Evil"}),
    "no record": lambda found: found["config"].update(branch="front"),
    # Parts of it are missing or of another kind.
    "no branch": lambda found: found["config"].pop("branch"),
    "no configuration": lambda found: found.update(config=None),
    "no rate": lambda found: found["config"].pop("learning_rate"),
    "no figures": lambda found: found.update(metrics=None),
    "no dataset": lambda found: found.update(data=[]),
    "a part less": lambda found: found.pop("data"),
    "no state": lambda found: found.update(state=None),
    "no generator": lambda found: found["state"].pop("generator"),
    "no optimiser": lambda found: found["state"].update(generator_adam=None),
    "empty optimiser": lambda found: found["state"].update(generator_adam={}),
    "no weights": lambda found: found["state"].update(generator=torch.zeros(3)),
    "a weight that is none": lambda found: first_weight(found, 3),
    "a weight of another shape": lambda found: first_weight(found, torch.zeros(3)),
    "a weight too many": lambda found: found["state"]["generator"].update(more=torch.zeros(1)),
    "half a range": lambda found: found.update(range=[2.0]),
    "a range of text": lambda found: found.update(range="ab"),
    "a range of nothing": lambda found: found.update(range=[2.0, 2.0]),
    "a range of words": lambda found: found.update(range=["1.0", "2.0"]),
    "a range without end": lambda found: found.update(range=[1.0, float("inf")]),
    "no number in the range": lambda found: found.update(range=[float("nan"), 2.0]),
    # It is of another program.
    "other schema": lambda found: found.update(schema=1),
    "more keys": lambda found: found.update(more=2),
    "nothing": lambda found: found.clear(),
}


@pytest.mark.parametrize("change", REFUSED.values(), ids=REFUSED)
def test_a_checkpoint_of_other_networks_is_refused_in_one_line(
    change: Callable[[dict[str, Any]], Any], trained: Callable[..., Training], tmp_path: Path
) -> None:
    found = torch.load(trained("front").output / CHECKPOINT, weights_only=True)
    path = tmp_path / "changed.pt"
    torch.save(found, path)
    learners.load(path)
    change(found)
    torch.save(found, path)
    with pytest.raises(CheckpointError, match=rf"\A{re.escape(str(path))} .+\Z") as caught:
        learners.load(path)
    assert len(str(caught.value)) < 300


class Mischief:
    """What a file makes when it is read without care."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Callable[[Path], None], tuple[Path]]:
        return Path.mkdir, (self.folder,)


def test_a_file_that_is_no_checkpoint_is_refused_in_one_line_and_not_run(
    trained: Callable[..., Training], tmp_path: Path
) -> None:
    whole = (trained("front").output / CHECKPOINT).read_bytes()
    path, mischief = tmp_path / "foreign.pt", tmp_path / "mischief"
    evil = io.BytesIO()
    torch.save(Mischief(mischief), evil)
    torn = (whole[: len(whole) // 2], whole[:-100], b"", b"text", b"PK\x03\x04")
    for found in (*torn, evil.getvalue()):
        path.write_bytes(found)
        with pytest.raises(CheckpointError, match=rf"\A{re.escape(str(path))} is no .*\Z"):
            learners.load(path)
    assert not mischief.exists()
    torch.save([1, 2], path)
    with pytest.raises(CheckpointError, match=rf"\A{re.escape(str(path))} has schema None.*\Z"):
        learners.load(path)
    with pytest.raises(CheckpointError, match=r"\A.*none\.pt is missing; train first\Z"):
        learners.load(tmp_path / "none.pt")
