"""The branches written down as plain values and read again, and what is refused."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from trainer.branch import Back, Branch, Front
from trainer.losses import BackWeights, FrontWeights
from trainer.networks.back import BackNetConfig
from trainer.networks.discriminator import DiscriminatorConfig
from trainer.networks.front import FrontNetConfig
from trainer.record import from_record, to_record

# The columns of Tables 3 and 4.
ABLATIONS = {
    "U-Net": Front(net=FrontNetConfig(attention=False)),
    "U-Net+nGAN": Front(
        net=FrontNetConfig(attention=False), normal_gan=DiscriminatorConfig(width=8)
    ),
    "U-Net+CA": Front(),
    "nGAN": Back(source="sensor"),
    "SMPL+dGAN": Back(judged_by="depth"),
    "SMPL+nGAN": Back(),
}

# Nothing is as by default: a key that got lost on the way would show.
CHANGED: dict[str, Branch] = {
    "front": Front(
        net=FrontNetConfig(width=16, attention=False, detail=False),
        gamma=FrontWeights(depth=2.5, normal=3, vgg=4, gan=0, matching=6),
        normal_gan=DiscriminatorConfig(width=24, strided=3),
    ),
    "back": Back(
        generator=BackNetConfig(width=24, detail=False),
        discriminator=DiscriminatorConfig(width=16, strided=2),
        beta=BackWeights(depth=2.5, gan=3, matching=4, silhouette=0, vgg=6),
        source="sensor",
        judged_by="depth",
    ),
    "back of the body alone": Back(silhouette="predicted"),
}


@pytest.mark.parametrize("branch", [*ABLATIONS.values(), *CHANGED.values()])
def test_a_branch_survives_json(branch: Branch) -> None:
    record = to_record(branch)
    there = from_record(json.loads(json.dumps(record)))
    assert there == branch
    assert type(there) is type(branch)
    assert to_record(there) == record


@pytest.mark.parametrize("kind", [Front, Back])
def test_nothing_of_the_changed_branches_is_as_by_default(kind: type[Branch]) -> None:
    default = asdict(kind())
    changed = [asdict(branch) for branch in CHANGED.values() if type(branch) is kind]
    for key, value in default.items():
        others = [record[key] for record in changed if record[key] != value]
        assert others, key
        if isinstance(value, dict):
            assert not [name for name in value if others[0][name] == value[name]], key


def test_records_of_the_ablations_differ() -> None:
    assert len({json.dumps(to_record(branch)) for branch in ABLATIONS.values()}) == len(ABLATIONS)


def test_what_a_record_leaves_out_is_the_papers_method() -> None:
    net = FrontNetConfig(width=32, attention=True, detail=True)
    assert from_record({"name": "front"}) == Front(net=net, normal_gan=None)
    assert from_record({"name": "back"}) == Back(
        generator=BackNetConfig(width=32, detail=True),
        discriminator=DiscriminatorConfig(width=64, strided=4),
        source="body",
        silhouette="given",
        judged_by="normals",
    )


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
