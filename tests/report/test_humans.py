"""The card of a set: its figures, and every bound that can be broken."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from report import humans as report
from report.humans import card, most_alike, pose_of, read_human, text
from shards.dataset import Dataset

POSES = ("stand", "walk", "squat", "deep_bow")


def parameters(k: int, kinds: tuple[str, ...] = ("tee", "trousers")) -> dict[str, Any]:
    """What a build writes of human k; every draw differs from human to human."""
    draw = np.random.default_rng(k).uniform
    return {
        "body": {
            "model": "anny",
            "age_years": float(draw(18, 75)),
            "height_m": float(draw(1.5, 1.9)),
            "phenotype": {"gender": float(draw()), "weight": float(draw())},
            "pose": {"name": POSES[k % 4], "hard": k % 4 == 3},
            "pose_parameters": {"trunk": [float(draw(-20, 20)) for _ in range(3)]},
        },
        "outfit": {
            "top": {"kind": kinds[0], "sleeve": float(draw(0.4, 1.9))},
            "outer": {"opening": float(draw())} if k % 2 else None,
        },
        "look": {"hair_style": "short" if k % 3 else "bun", "skin": [float(draw())] * 3},
        "drapes": {
            "garments": [
                {
                    "garment": kind,
                    "material": {"bending": 0.05},
                    "through_share": 0.001 * (k % 5),
                    "fold_deg": 10.0 + k,
                    "fold_pixels": 9000,
                    "soft_and_loose": k % 2 == 0,
                }
                for kind in kinds
            ],
            "failed": [f"the cloth did not settle: it moves {30 + k} mm a frame"] * (k % 2),
        },
        "triangles": 150_000 + k,
    }


def entries(count: int) -> dict[str, dict[str, Any]]:
    return {
        f"open_{k:04d}": {"parameters": parameters(k), "seconds": 2.0 + k} for k in range(count)
    }


def figures(folder: Path) -> dict[str, Any]:
    return card(Dataset(folder))


def test_the_card_holds_the_figures_of_the_set(build: Any) -> None:
    found = figures(build(entries(6)))
    assert found["humans"] == 6
    assert found["poses"] == {"deep_bow": 1, "squat": 1, "stand": 2, "walk": 2}
    assert found["hard_poses"] == ["deep_bow"]
    assert found["humans_in_hard_poses"] == 1
    assert found["triangles"] == {"min": 150_000, "median": 150_002.5, "max": 150_005}
    assert found["seconds_to_render"] == {"min": 2.0, "median": 4.5, "max": 7.0}
    assert found["garments"]["tee"] == {
        "count": 6,
        "soft_and_loose": 3,
        "through_share": {"median": 0.0015, "worst": 0.004},
        "fold_deg": {"min": 10.0, "median": 12.5, "max": 15.0},
    }
    assert found["classes"]["soft and loose"]["fold_deg"]["median"] == 12.0
    assert found["classes"]["stiff or close"]["count"] == 6
    assert found["drapes_thrown_away"] == 3
    assert found["reasons"] == {"the cloth did not settle: it moves # mm a frame": 3}
    assert found["broken"] == []
    shown = text(found)
    assert "deep bow* 1" in shown
    assert "3 x the cloth did not settle" in shown
    assert "all bounds are kept" in shown


def test_garments_that_were_not_measured_are_told(build: Any) -> None:
    given = entries(2)
    given["open_0001"]["parameters"]["drapes"]["garments"] = []
    found = figures(build(given))
    assert found["humans_without_measured_garments"] == 1
    assert "no garment was measured of 1 humans" in text(found)


def broken(given: dict[str, Any], what: str) -> str:
    """Break one bound of human 2; the words that have to name it."""
    human = given["open_0002"]
    drawn = human["parameters"]
    if what == "through":
        drawn["drapes"]["garments"][1]["through_share"] = 0.005
        return "open_0002: 0.50% of the trousers is inside the body"
    if what == "nan":
        drawn["drapes"]["garments"][1]["through_share"] = float("nan")
        return "open_0002: nan% of the trousers is inside the body"
    if what == "few":
        drawn["triangles"] = 99_999
        return "open_0002 has 99999 triangles"
    if what == "many":
        drawn["triangles"] = 400_001
        return "open_0002 has 400001 triangles"
    if what == "draws":
        twin = copy.deepcopy(given["open_0000"]["parameters"])
        twin["body"]["age_years"] += 0.4
        human["parameters"] = twin
        return "open_0000 and open_0002 have almost the same draws"
    human[what] = b"open_0000"
    return f"open_0000 and open_0002 have the same {what}"


@pytest.mark.parametrize("what", ["through", "nan", "few", "many", "draws", "surface", "texture"])
def test_each_broken_bound_is_named_and_ends_with_1(
    build: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], what: str
) -> None:
    given = entries(4)
    named = broken(given, what)
    folder = build(given)
    monkeypatch.setattr(sys, "argv", ["report.humans", str(folder)])
    assert report.main() == 1
    said = capsys.readouterr().out
    assert f"BROKEN: {named}" in said
    assert said.count("BROKEN") == 1


def test_a_whole_set_ends_with_0_and_writes_the_card(
    build: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = build(entries(4))
    output = folder.parent / "card.json"
    monkeypatch.setattr(sys, "argv", ["report.humans", str(folder), "--output", str(output)])
    assert report.main() == 0
    assert json.loads(output.read_text()) == json.loads(json.dumps(figures(folder)))
    assert "the two most alike, open_" in capsys.readouterr().out


def test_the_most_alike_are_found_and_told_by_aspect(build: Any) -> None:
    given = entries(8)
    twin = copy.deepcopy(given["open_0006"]["parameters"])
    twin["body"]["pose"] = {"name": "deep_bow", "hard": True}
    twin["body"]["pose_parameters"] = given["open_0003"]["parameters"]["body"]["pose_parameters"]
    given["open_0005"]["parameters"] = twin
    dataset = Dataset(build(given))
    humans = [read_human(dataset, subject) for subject in dataset.subjects()]
    pair = most_alike(humans)
    assert pair is not None
    assert (pair.first, pair.second) == ("open_0005", "open_0006")
    assert {k for k, v in pair.aspects.items() if v > 0} == {"pose"}
    assert 0.05 < pair.distance <= 0.25
    assert not pair.alike
    # Against every pair, the slow way.
    others = [report._pair(humans, a, b) for a in range(8) for b in range(a + 1, 8)]
    assert pair.distance == min(other.distance for other in others)
    assert most_alike(humans[:1]) is None


def test_differences_are_shares_of_the_spread_and_names_count_whole(build: Any) -> None:
    given = entries(3)
    # The middle one lies halfway between the others in the one number that differs.
    for k, subject in enumerate(given):
        drawn = given[subject]["parameters"] = parameters(0)
        drawn["body"]["height_m"] = 1.6 + 0.1 * k
    given["open_0002"]["parameters"]["look"]["hair_style"] = "long"
    dataset = Dataset(build(given))
    humans = [read_human(dataset, subject) for subject in dataset.subjects()]
    assert report._pair(humans, 0, 1).aspects == {"body": 0.5, "pose": 0, "outfit": 0, "look": 0}
    assert report._pair(humans, 0, 2).aspects == {"body": 1, "pose": 0, "outfit": 0, "look": 1}


def test_a_pose_may_be_a_name_or_a_name_with_its_kind() -> None:
    assert pose_of({"pose": "walk"}) == ("walk", False)
    assert pose_of({"pose": "kneel", "hard": True}) == ("kneel", True)
    assert pose_of({"pose": {"name": "kneel", "hard": True}}) == ("kneel", True)
    assert pose_of({}) == ("-", False)


@pytest.mark.parametrize("missing", ["parameters", "triangles", "garment", "text"])
def test_what_is_no_open_humans_set_is_named_in_one_line(
    build: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], missing: str
) -> None:
    given = entries(2)
    drawn = given["open_0001"]["parameters"]
    if missing == "parameters":
        del given["open_0001"]["parameters"]
    elif missing == "garment":
        del drawn["drapes"]["garments"][0]["garment"]
    elif missing == "triangles":
        del drawn["triangles"]
    folder = build(given)
    if missing == "text":
        (folder / "subjects" / "open_0001" / "parameters.json").write_text("{")
    monkeypatch.setattr(sys, "argv", ["report.humans", str(folder)])
    assert report.main() == 2
    said = capsys.readouterr().err
    assert "open_0001" in said
    assert said.count("\n") == 1
