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
from report import likeness
from report.human import pose_of, read_human, shown
from report.humans import card, text
from report.likeness import most_alike
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
            "failed": [f"squat: the cloth did not settle: it moves {30 + k} mm a frame"] * (k % 2),
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
        "freed_share": None,
        "fold_deg": {"min": 10.0, "median": 12.5, "max": 15.0},
    }
    assert found["classes"]["soft and loose"]["fold_deg"]["median"] == 12.0
    assert found["classes"]["stiff or close"]["count"] == 6
    assert found["drapes_thrown_away"] == 3
    assert found["drapes_thrown_away_share"] == round(3 / 9, 4)
    assert found["seconds_to_make"] == {"min": 31.5, "median": 31.5, "max": 31.5, "sum": 189.0}
    assert found["reasons"] == {"the cloth did not settle: it moves # mm a frame": 3}
    assert found["broken"] == []
    said = text(found)
    assert "deep bow* 1" in said
    assert "3 x the cloth did not settle" in said
    assert "3 thrown away, 33.3% of all draws, of 3 humans" in said
    assert "189 s of all workers" in said
    assert "all bounds are kept" in said
    assert "laid, not draped" not in said


def test_reasons_are_counted_whatever_the_pose_and_poses_by_themselves(build: Any) -> None:
    given = entries(2)
    given["open_0000"]["parameters"]["drapes"]["failed"] = [
        "sit: the cloth exploded",
        "sit: the cloth is torn: 1 % of its edges are over 2.05 times as long",
        "deep_bow: the cloth exploded",
        "the cloth solver ended with 1: killed",
    ]
    given["open_0001"]["parameters"]["drapes"]["failed"] = []
    found = figures(build(given))
    assert found["reasons"] == {
        "the cloth exploded": 2,
        "the cloth is torn: # % of its edges are over # times as long": 1,
        "the cloth solver ended with #: killed": 1,
    }
    assert found["poses_that_failed"] == {"sit": 2, "deep_bow": 1}
    assert "most in sit 2, deep bow 1" in text(found)


def test_what_was_not_measured_is_left_out_and_shown_as_a_dash(build: Any) -> None:
    given = entries(4)
    for human in given.values():
        hidden, other = human["parameters"]["drapes"]["garments"]
        hidden["fold_deg"] = None
        other["freed_share"] = 0.01
    given["open_0001"]["parameters"]["drapes"]["garments"][1]["freed_share"] = 0.03
    found = figures(build(given))
    assert found["garments"]["tee"]["fold_deg"] is None
    assert found["garments"]["trousers"]["freed_share"] == {"median": 0.01, "worst": 0.03}
    lines = {line.split()[0]: line.split() for line in text(found).splitlines() if line}
    assert lines["tee"][-3:] == ["-", "-", "-"]
    assert lines["trousers"][5:7] == ["1.00%", "3.00%"]
    assert found["broken"] == []


def test_cloth_that_was_laid_is_told(build: Any) -> None:
    given = entries(3)
    given["open_0000"]["parameters"]["drapes"]["cloth"] = "laid"
    given["open_0001"]["parameters"]["drapes"]["cloth"] = "draped"
    found = figures(build(given))
    assert found["humans_laid"] == 1
    assert "laid, not draped, on 1 humans" in text(found)


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
    if what == "freed":
        drawn["drapes"]["garments"][1]["freed_share"] = 0.0301
        return "open_0002: 3.01% of the trousers was laid back on the skin"
    if what == "fold":
        drawn["drapes"]["garments"][0]["fold_deg"] = 9.9
        return "open_0002: the soft and loose tee folds by 9.9°"
    if what == "memory":
        human["cost"] = {"seconds": 31.5, "peak_memory_mb": 2001}
        return "1 humans took over 2000 MB to make, open_0002 2001 MB"
    if what == "set aside":
        human["failed"] = "open_0002: no cloth stayed on"
        return "open_0002 was set aside: no cloth stayed on"
    if what == "draws":
        twin = copy.deepcopy(given["open_0000"]["parameters"])
        twin["body"]["age_years"] += 0.4
        human["parameters"] = twin
        return "open_0000 and open_0002 have almost the same draws"
    human[what] = b"open_0000"
    return f"open_0000 and open_0002 have the same {what}"


BOUNDS = ["through", "nan", "few", "many", "freed", "fold", "memory", "set aside"]


@pytest.mark.parametrize("what", [*BOUNDS, "draws", "surface", "texture"])
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


def test_a_stiff_or_hidden_garment_may_be_smooth(build: Any) -> None:
    given = entries(3)
    given["open_0001"]["parameters"]["drapes"]["garments"][0]["fold_deg"] = 2.0
    given["open_0002"]["parameters"]["drapes"]["garments"][0]["fold_deg"] = None
    assert figures(build(given))["broken"] == []


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
    others = [likeness._pair(humans, a, b) for a in range(8) for b in range(a + 1, 8)]
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
    assert likeness._pair(humans, 0, 1).aspects == {"body": 0.5, "pose": 0, "outfit": 0, "look": 0}
    assert likeness._pair(humans, 0, 2).aspects == {"body": 1, "pose": 0, "outfit": 0, "look": 1}


def fabric(pattern: str, weave: str = "plain") -> dict[str, Any]:
    colours = {name: [0.1, 0.2, 0.3] for name in ("base", "second", "third")}
    return {"pattern": pattern, "weave": weave, "repeat": 0.03, "wear": 0.5, **colours}


LOOK = {
    **{name: [0.5] * 3 for name in ("skin", "motif", "motif_second", "headwear_motif", "collar")},
    **{name: [0.5] * 3 for name in ("lining", "buttons", "metal", "belt", "laces", "shoe_panels")},
    "front_print": 7,
    "back_print": 8,
    "headwear": "none",
    "headwear_fabric": fabric("plain"),
    "top": fabric("plain"),
    "bottom": fabric("tartan"),
    "outer": None,
}
PLAIN = {
    "top": {"kind": "dress", "front": "nothing", "back": "nothing", "tucked": False, "hem": -0.4},
    "bottom": None,
    "outer": None,
    "footwear": "boots",
}


def test_only_what_shows_counts_as_a_draw() -> None:
    bare = shown(LOOK, PLAIN)
    assert set(bare) == {"skin", "headwear", "top", "shoe_panels"}
    assert set(bare["top"]) == {"pattern", "weave", "base"}
    dressed = {
        "top": {"kind": "tee", "front": "print", "back": "print", "tucked": True, "hem": 0.0},
        "bottom": {"kind": "trousers", "belt": True, "waist": 0.12},
        "outer": {"kind": "jacket", "front": "buttons", "back": "nothing"},
        "footwear": "sneakers",
    }
    look = {**LOOK, "headwear": "cap", "outer": fabric("plain", "twill")}
    assert set(look) - set(shown(look, dressed)) == {"front_print", "back_print", "lining"}
    assert set(shown(look, dressed)["outer"]) == set(fabric("plain")) - {"third", "repeat"}
    assert "third" in shown(look, dressed)["bottom"]
    # A jacket hides what is on the back of the top, and a hanging top the belt.
    dressed["top"] = {**dressed["top"], "front": "pocket", "tucked": False}
    assert {"motif", "belt", "metal"}.isdisjoint(shown(look, dressed))


def test_seeds_and_clothes_that_are_not_worn_make_no_difference(build: Any) -> None:
    given = entries(3)
    for k, human in enumerate(given.values()):
        drawn = human["parameters"] = parameters(0)
        drawn["body"]["height_m"] = 1.6 + 0.1 * k
        drawn["look"] = {**LOOK, "front_print": k, "motif": [0.1 * k] * 3}
        drawn["outfit"] = PLAIN
    dataset = Dataset(build(given))
    pair = most_alike([read_human(dataset, subject) for subject in dataset.subjects()])
    assert pair is not None
    assert pair.aspects == {"body": 0.5, "pose": 0, "outfit": 0, "look": 0}


def test_a_draw_that_neither_has_does_not_make_them_alike(build: Any) -> None:
    given = entries(3)
    for k, human in enumerate(given.values()):
        drawn = human["parameters"] = parameters(0)
        drawn["outfit"] = {"hem": float(k), "outer": {"opening": 0.1, "hem": 0.2} if k else None}
    given["open_0001"]["parameters"]["outfit"]["outer"] = None
    dataset = Dataset(build(given))
    humans = [read_human(dataset, subject) for subject in dataset.subjects()]
    assert likeness._pair(humans, 0, 1).aspects["outfit"] == 0.5
    assert likeness._pair(humans, 1, 2).aspects["outfit"] == round((0.5 + 1 + 1) / 3, 4)


def test_a_pose_may_be_a_name_or_a_name_with_its_kind() -> None:
    assert pose_of({"pose": "walk"}) == ("walk", False)
    assert pose_of({"pose": "kneel", "hard": True}) == ("kneel", True)
    assert pose_of({"pose": {"name": "kneel", "hard": True}}) == ("kneel", True)
    assert pose_of({}) == ("-", False)


MISSING = ["parameters", "triangles", "garment", "text", "cost", "seconds", "list", "surface"]


@pytest.mark.parametrize("missing", MISSING)
def test_what_is_no_open_humans_set_is_named_in_one_line_with_its_cure(
    build: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], missing: str
) -> None:
    given = entries(2)
    drawn = given["open_0001"]["parameters"]
    if missing == "garment":
        del drawn["drapes"]["garments"][0]["garment"]
    elif missing == "triangles":
        del drawn["triangles"]
    elif missing == "seconds":
        given["open_0001"]["cost"] = {"peak_memory_mb": 1900}
    elif missing == "list":
        given["open_0001"]["cost"] = ["seconds"]
    folder = build(given)
    home = folder / "subjects" / "open_0001"
    file = "parameters.json"
    if missing in ("parameters", "cost"):
        file = f"{missing}.json"
        (home / file).unlink()
    elif missing == "surface":
        file = "open_0001.obj"
        (home / file).unlink()
    elif missing == "text":
        (home / file).write_text("{")
    elif missing in ("seconds", "list"):
        file = "cost.json"
    monkeypatch.setattr(sys, "argv", ["report.humans", str(folder)])
    assert report.main() == 2
    said = capsys.readouterr().err
    assert str(home / file) in said
    assert f"delete {home} and build the subject again" in said
    assert said.count("\n") == 1
