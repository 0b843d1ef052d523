"""The branches as they are chosen, written down and trained: Tables 3 and 4 by their columns."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from trainer.branch import FAR, Back, Branch, Front, from_record, to_record
from trainer.learner import Learner
from trainer.losses import BackWeights, FrontWeights
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
ABLATIONS = TABLE_3 | TABLE_4

JUDGED = {"gan", "matching", "discriminator"}
TERMS = {
    "U-Net": {"depth", "normal"},
    "U-Net+nGAN": {"depth", "normal", *JUDGED},
    "U-Net+CA": {"depth", "normal"},
    "nGAN": {"depth", "silhouette", *JUDGED},
    "SMPL+dGAN": {"depth", "silhouette", *JUDGED},
    "SMPL+nGAN": {"depth", "silhouette", *JUDGED},
}

# Nothing as it is by default: a key that got lost on the way would show.
CHANGED = {
    "front": Front(
        net=FrontNetConfig(width=16, attention=False, detail=False),
        gamma=FrontWeights(depth=2.5, normal=3, vgg=4, gan=0, matching=6),
        normal_gan=DiscriminatorConfig(width=24, strided=3),
    ),
    "back": Back(
        generator=BackNetConfig(width=24),
        discriminator=DiscriminatorConfig(width=16, strided=2),
        beta=BackWeights(depth=2.5, gan=3, matching=4, silhouette=0, vgg=6),
        source="sensor",
        judged_by="depth",
    ),
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


@pytest.mark.parametrize("branch", [*ABLATIONS.values(), *CHANGED.values(), Front(), Back()])
def test_a_branch_survives_json(branch: Branch) -> None:
    record = to_record(branch)
    there = from_record(json.loads(json.dumps(record)))
    assert there == branch
    assert type(there) is type(branch)
    assert to_record(there) == record


@pytest.mark.parametrize("branch", CHANGED.values(), ids=CHANGED)
def test_nothing_of_the_changed_branches_is_as_by_default(branch: Branch) -> None:
    default = asdict(type(branch)())
    for key, value in asdict(branch).items():
        assert value != default[key]
        if isinstance(value, dict) and isinstance(default[key], dict):
            assert not [name for name in value if value[name] == default[key][name]], key


def test_records_of_the_ablations_differ_and_the_papers_method_is_the_default() -> None:
    assert len({json.dumps(to_record(branch)) for branch in ABLATIONS.values()}) == len(ABLATIONS)
    small = {"net": {"width": 8}}
    assert from_record({"name": "front", **small}) == TABLE_3["U-Net+CA"]
    small = {"generator": {"width": 8}, "discriminator": {"width": 8}}
    assert from_record({"name": "back", **small}) == TABLE_4["SMPL+nGAN"]


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


@pytest.mark.parametrize("learner", TABLE_4, indirect=True)
def test_the_backs_network_sees_its_source_alone(learner: Learner, batch: Sample) -> None:
    ((maps,),) = seen_by(learner, "generator", batch)
    of_body = learner.branch.source == "body"
    assert maps.shape[1] == (2 if of_body else 4)
    given = batch.coarse if of_body else batch.sensor
    torch.testing.assert_close(maps[:, :1][batch.mask], learner.span.normalised(given[batch.mask]))
    assert (maps[:, :1][~batch.mask] == FAR).all()
    if of_body:
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


EVIL = {"class_path": "planted.Evil", "init_args": {"width": 8}}
FRONT_RECORD, BACK_RECORD = {"name": "front"}, {"name": "back"}


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module that can be imported, and a file that a network's width can be read from."""
    (tmp_path / "planted.py").write_text("class Evil:\n    def __init__(self, width=8): ...\n")
    (tmp_path / "planted.yaml").write_text("width: 16\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "record",
    [
        {**EVIL},
        {"name": "planted.Evil"},
        {"name": "trainer.branch.Front"},
        {**FRONT_RECORD, **EVIL},
        {**FRONT_RECORD, "net": EVIL},
        {**FRONT_RECORD, "net": {**EVIL, "width": 8}},
        {**FRONT_RECORD, "net": {"width": EVIL}},
        {**FRONT_RECORD, "gamma": EVIL},
        {**FRONT_RECORD, "normal_gan": EVIL},
        {**FRONT_RECORD, "normal_gan": {"class_path": "planted.Evil"}},
        {**FRONT_RECORD, "normal_gan": "planted.Evil"},
        {**BACK_RECORD, "generator": EVIL},
        {**BACK_RECORD, "discriminator": EVIL},
        {**BACK_RECORD, "source": EVIL},
        {**FRONT_RECORD, "net": "planted.yaml"},
        {**FRONT_RECORD, "normal_gan": "planted.yaml"},
        {**BACK_RECORD, "discriminator": "planted.yaml"},
    ],
)
def test_a_record_imports_and_reads_nothing(record: dict[str, Any], planted: Path) -> None:
    with pytest.raises(ValueError, match=r"\A.+\Z"):  # one line
        from_record(record)
    assert "planted" not in sys.modules


@pytest.mark.parametrize("record", [None, [], "front", 3, {}, [["name", "front"]]])
def test_what_is_no_record_is_refused(record: Any) -> None:
    with pytest.raises(ValueError, match=r"\A.*branch.*\Z"):
        from_record(record)


@pytest.mark.parametrize("name", [None, "", "side", "Front", "FRONT", 0, True, [], {}, ["front"]])
def test_an_unknown_name_is_refused_and_the_known_are_listed(name: Any) -> None:
    with pytest.raises(ValueError, match=r"\Abranch .* is none of front, back\Z"):
        from_record({"name": name})


@pytest.mark.parametrize(
    ("record", "key"),
    [
        ({**FRONT_RECORD, "depth": 1}, "depth"),
        ({**FRONT_RECORD, "generator": {}}, "generator"),
        ({**FRONT_RECORD, "side": "back"}, "side"),
        ({**FRONT_RECORD, "net.width": 8}, "net.width"),
        ({**FRONT_RECORD, "init_args": {}}, "init_args"),
        ({**FRONT_RECORD, "branch": {}}, "branch"),
        ({**FRONT_RECORD, "nett": {}}, "nett"),
        ({**FRONT_RECORD, "__path__": "x"}, "__path__"),
        ({**FRONT_RECORD, "net": {"widht": 8}}, "widht"),
        ({**FRONT_RECORD, "net": {"init_args": {}}}, "init_args"),
        ({**BACK_RECORD, "net": {}}, "net"),
        ({**BACK_RECORD, "beta": {"normal": 20.0}}, "normal"),
        ({**BACK_RECORD, "discriminator": {"dict_kwargs": {}}}, "dict_kwargs"),
        ({**FRONT_RECORD, 3: 4}, "3"),
    ],
)
def test_an_unknown_key_is_refused_and_named(record: dict[Any, Any], key: str) -> None:
    with pytest.raises(ValueError, match=rf"\A.*{key}.*\Z"):
        from_record(record)


@pytest.mark.parametrize(
    ("record", "key"),
    [
        ({**FRONT_RECORD, "net": None}, "net"),
        ({**FRONT_RECORD, "net": []}, "net"),
        ({**FRONT_RECORD, "net": 8}, "net"),
        ({**FRONT_RECORD, "net": {"width": "8"}}, "width"),
        ({**FRONT_RECORD, "net": {"width": 8.0}}, "width"),
        ({**FRONT_RECORD, "net": {"width": True}}, "width"),
        ({**FRONT_RECORD, "net": {"width": None}}, "width"),
        ({**FRONT_RECORD, "net": {"width": [8]}}, "width"),
        ({**FRONT_RECORD, "net": {"width": 12}}, "width"),
        ({**FRONT_RECORD, "net": {"attention": 1}}, "attention"),
        ({**FRONT_RECORD, "net": {"attention": "no"}}, "attention"),
        ({**FRONT_RECORD, "gamma": {"depth": "1"}}, "depth"),
        ({**FRONT_RECORD, "gamma": {"depth": None}}, "depth"),
        ({**FRONT_RECORD, "gamma": {"depth": -1.0}}, "depth"),
        ({**FRONT_RECORD, "gamma": {"depth": float("nan")}}, "depth"),
        ({**FRONT_RECORD, "normal_gan": False}, "normal_gan"),
        ({**FRONT_RECORD, "normal_gan": {"strided": 5}}, "strided"),
        ({**BACK_RECORD, "discriminator": None}, "discriminator"),
        ({**BACK_RECORD, "beta": [10, 5, 20, 20, 1]}, "beta"),
        ({**BACK_RECORD, "source": "front"}, "source"),
        ({**BACK_RECORD, "source": None}, "source"),
        ({**BACK_RECORD, "judged_by": ["depth"]}, "judged_by"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_with_its_key(
    record: dict[str, Any], key: str
) -> None:
    with pytest.raises(ValueError, match=rf"\A.*{key}.*\Z"):
        from_record(record)
