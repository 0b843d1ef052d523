"""The branches as they are chosen and trained: Tables 3 and 4 by their columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from trainer.branch import FAR, Back, Front
from trainer.learner import Learner
from trainer.losses import FrontWeights
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.views import Sample, Views, ViewsConfig

PLAIN, ATTENTION = FrontNetConfig(width=8, attention=False), FrontNetConfig(width=8)
JUDGE = DiscriminatorConfig(width=8)
BACK = {"generator": BackNetConfig(width=8), "discriminator": JUDGE}

TABLE_3 = {
    "U-Net": Front(net=PLAIN),
    "U-Net+nGAN": Front(net=PLAIN, normal_gan=JUDGE),
    "U-Net+CA": Front(net=ATTENTION),
}
TABLE_4 = {
    "nGAN": Back(**BACK, source="sensor"),
    "SMPL+dGAN": Back(**BACK, judged_by="depth"),
    "SMPL+nGAN": Back(**BACK),
}
ABLATIONS = TABLE_3 | TABLE_4 | {"Eq. 5": Back(**BACK, silhouette="predicted")}

JUDGED = {"gan", "matching", "discriminator"}
TERMS = {
    "U-Net": {"depth", "normal"},
    "U-Net+nGAN": {"depth", "normal", *JUDGED},
    "U-Net+CA": {"depth", "normal"},
    "nGAN": {"depth", "silhouette", *JUDGED},
    "SMPL+dGAN": {"depth", "silhouette", *JUDGED},
    "SMPL+nGAN": {"depth", "silhouette", *JUDGED},
    "Eq. 5": {"depth", "silhouette", *JUDGED},
}


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def views(data: Path) -> Views:
    return Views(data, "train", ViewsConfig(size=(64, 48)), varied=False)


@pytest.fixture(scope="module")
def batch(views: Views) -> Sample:
    """Two views of one subject and one of another."""
    return Sample(*map(torch.stack, zip(*(views[i] for i in range(3)), strict=True)))


@pytest.fixture
def learner(request: pytest.FixtureRequest, views: Views) -> Learner:
    """Of the ablation that a test names."""
    torch.manual_seed(0)
    return Learner(ABLATIONS[request.param], views.depth_range(), 1e-3)


every_learner = pytest.mark.parametrize("learner", ABLATIONS, indirect=True)


def five(maps: Tensor) -> list[Tensor]:
    """Features in the place of VGG19's five layers."""
    return [maps[..., :: 2**k, :: 2**k] for k in range(5)]


def seen_by(learner: Learner, name: str, batch: Sample) -> list[tuple[Tensor, ...]]:
    """What a network is given, each time that it is called in a step."""
    calls: list[tuple[Tensor, ...]] = []
    network = learner.networks[name]
    hook = network.register_forward_pre_hook(lambda _, maps: calls.append(maps))
    learner.step(batch)
    hook.remove()
    return calls


@pytest.mark.parametrize(("learner", "terms"), TERMS.items(), indirect=["learner"])
@pytest.mark.parametrize("vgg", [None, five])
def test_an_ablation_learns_with_its_own_terms(
    learner: Learner, terms: set[str], vgg: Any, batch: Sample
) -> None:
    learner.vgg = vgg
    networks = learner.networks
    assert set(networks) == {"generator", *(["discriminator"] if terms & JUDGED else [])}
    before = {n: [p.clone() for p in network.parameters()] for n, network in networks.items()}
    for _ in range(2):  # the first step moves the generator's last convolution alone, which is 0
        found = learner.step(batch)
        assert set(found) == (terms if vgg is None else terms | {"vgg"})
        for term in found.values():
            assert term.shape == ()
            assert term.isfinite()
            assert not term.requires_grad
    for name, network in networks.items():
        for old, new in zip(before[name], network.parameters(), strict=True):
            assert not torch.equal(old, new), name
            assert new.isfinite().all(), name


@every_learner
def test_attention_is_where_the_table_has_it(learner: Learner) -> None:
    attended = any("attention" in name for name in learner.networks["generator"].state_dict())
    assert attended == (learner.branch == TABLE_3["U-Net+CA"])


@pytest.mark.parametrize("learner", TABLE_3, indirect=True)
def test_the_fronts_network_sees_colour_and_the_sensors_depth(
    learner: Learner, batch: Sample
) -> None:
    ((rgb, depth, valid, mask),) = seen_by(learner, "generator", batch)
    torch.testing.assert_close(rgb, 2 * batch.rgb - 1)
    inside = learner.span.normalised(batch.sensor[batch.mask])
    torch.testing.assert_close(depth[batch.mask], inside)
    assert (depth[~batch.mask] == FAR).all()
    assert torch.equal(mask, batch.mask)
    assert torch.equal(valid, batch.valid)


@pytest.mark.parametrize("learner", [*TABLE_4, "Eq. 5"], indirect=True)
def test_the_backs_network_sees_its_source_alone(learner: Learner, batch: Sample) -> None:
    ((maps, corrected, where),) = seen_by(learner, "generator", batch)
    of_body = learner.branch.source == "body"
    assert maps.shape[1] == (2 if of_body else 4)
    given = batch.coarse if of_body else batch.sensor
    own = batch.mask if learner.branch.silhouette == "given" else batch.body
    torch.testing.assert_close(maps[:, :1][own], learner.span.normalised(given[own]))
    assert (maps[:, :1][~own] == FAR).all()
    assert torch.equal(where, own)
    # What is corrected was filled in beside the body, whether that is seen or not.
    torch.testing.assert_close(corrected[batch.mask], learner.span.normalised(given[batch.mask]))
    if of_body:
        assert (batch.mask & ~batch.body).any()
        assert torch.equal(maps[:, 1:] > 0, batch.body)
        assert (maps[:, 1:].abs() == 1).all()
    else:
        torch.testing.assert_close(maps[:, 1:], 2 * batch.rgb - 1)
    # The other source's maps, and the answer, are without effect.
    sources = {
        "body": {"coarse": batch.coarse + 0.1, "body": ~batch.body},
        "sensor": {"sensor": batch.sensor + 0.1, "rgb": 1 - batch.rgb},
    }
    own = sources.pop(learner.branch.source)
    (other,) = sources.values()
    answer = {"front": batch.front + 0.1, "back": batch.back + 0.1}
    predicted = learner.predict(batch)
    assert torch.equal(learner.predict(batch._replace(**other, **answer)), predicted)
    for name, value in own.items():
        assert not torch.equal(learner.predict(batch._replace(**{name: value})), predicted), name


@pytest.mark.parametrize("learner", ["Eq. 5"], indirect=True)
def test_the_silhouette_has_to_be_learned_from_the_body(learner: Learner, batch: Sample) -> None:
    """It is L_P's target: a network that is given it would learn nothing by that loss."""
    seen: list[Tensor] = []
    encoder = learner.networks["generator"].encoder
    encoder.register_forward_pre_hook(lambda _, given: seen.append(given[0].detach()))
    learner.predict(batch)
    wider = torch.nn.functional.max_pool2d(batch.mask.float(), 5, 1, 2) > 0
    assert (wider != batch.mask).any()
    learner.predict(batch._replace(mask=wider))
    assert torch.equal(*seen)


@pytest.mark.parametrize("learner", [n for n in TERMS if TERMS[n] & JUDGED], indirect=True)
def test_the_discriminator_sees_both_surfaces_and_nothing_outside_of_the_mask(
    learner: Learner, batch: Sample
) -> None:
    branch = learner.branch
    given = learner.predict(batch)
    calls = seen_by(learner, "discriminator", batch)
    assert len(calls) == 2  # to learn, and to judge for the generator
    of_depth = branch == TABLE_4["SMPL+dGAN"]
    for (maps,) in calls:
        fake, real = maps.detach().chunk(2)
        assert fake.shape == (len(batch.mask), 1 if of_depth else 3, 64, 48)
        outside = ~batch.mask.expand_as(fake)
        assert not fake[outside].any()
        assert not real[outside].any()
        for seen, depth in ((fake, given), (real, branch.true(batch))):
            if of_depth:
                expected = torch.where(batch.mask, learner.span.normalised(depth), 0)
            else:
                expected = learner.surface(depth, batch).normal
                # Out of the surface, towards whoever looks at this side of it.
                sign = 1 if branch.side == "front" else -1
                assert (sign * seen[:, 2:][batch.mask]).mean() > 0.3
            torch.testing.assert_close(seen, expected, atol=1e-3, rtol=0)


@pytest.mark.parametrize("name", ["gan", "matching"])
def test_a_coefficient_that_nothing_would_use_is_refused(name: str) -> None:
    idle = FrontWeights(**{name: 3.0})
    with pytest.raises(
        ValueError, match=rf"\Abranch\.gamma\.{name}: .*; give branch\.normal_gan too\Z"
    ):
        Front(gamma=idle)
    assert Front(gamma=idle, normal_gan=JUDGE).gamma == idle


def test_a_silhouette_that_is_seen_anyway_is_not_to_be_predicted() -> None:
    with pytest.raises(ValueError, match=r"\Abranch\.silhouette: .* sensor's depth shows it"):
        Back(source="sensor", silhouette="predicted")
