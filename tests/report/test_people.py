"""The contact sheet: each subject twice, at one scale, on one line, the back turned over."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from report.people import BETWEEN, GAP, PAPER, contact_sheet
from tests.report.conftest import Build

SHAPE = (64, 96)


def figure(width: int, height: int) -> dict[str, np.ndarray]:
    """A rectangle, red in front; behind its left half (seen from the front) is green."""
    mask = np.zeros(SHAPE, dtype=bool)
    mask[4 : 4 + height, 10 : 10 + width] = True
    front, back = np.zeros((*SHAPE, 3), np.uint8), np.zeros((*SHAPE, 3), np.uint8)
    front[mask] = (255, 0, 0)
    back[mask] = (0, 0, 255)
    back[:, : 10 + width // 2][mask[:, : 10 + width // 2]] = (0, 255, 0)
    return {"mask": mask, "rgb_front": front, "rgb_back": back}


def test_front_and_back_stand_beside_each_other_seen_from_their_own_side(build: Build) -> None:
    folder = build({"a": {"maps": figure(40, 50)}})
    page = np.asarray(contact_sheet(folder, [], 0, 300, "rgb"))
    assert page.shape == (50 + BETWEEN, 300, 3)
    left = (300 - 2 * 40 - GAP) // 2
    row = page[BETWEEN + 30]
    assert (row[left : left + 40] == (255, 0, 0)).all()
    assert (row[left + 40 : left + 40 + GAP] == PAPER).all()
    # What is on the left from the front is on the right from behind.
    assert (row[left + 40 + GAP : left + 60 + GAP] == (0, 0, 255)).all()
    assert (row[left + 60 + GAP : left + 80 + GAP] == (0, 255, 0)).all()


def test_subjects_fill_rows_and_stand_on_one_line(build: Build) -> None:
    tall, low = figure(60, 60), figure(60, 20)
    folder = build({"a": {"maps": tall}, "b": {"maps": low}, "c": {"maps": low}})
    pair = 2 * 60 + GAP
    page = np.asarray(contact_sheet(folder, [], 0, 2 * pair + 3 * BETWEEN, "rgb"))
    assert page.shape[0] == 60 + 20 + 2 * BETWEEN
    on_line = (page[60 + BETWEEN - 1] == (255, 0, 0)).all(axis=-1)
    assert on_line.sum() == 2 * 60
    assert not (page[BETWEEN + 20] == (255, 0, 0)).all(axis=-1)[pair:].any()


def test_one_subject_wider_than_the_page_widens_it(build: Build) -> None:
    folder = build({"a": {"maps": figure(70, 50)}})
    assert contact_sheet(folder, ["a"], 0, 100, "normal").width == 140 + GAP + 2 * BETWEEN


def test_a_call_writes_the_sheet_and_a_wrong_one_says_why(build: Build, tmp_path: Path) -> None:
    folder = build({"a": {"maps": figure(40, 50)}})
    output = tmp_path / "people.png"

    def call(*more: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "report.people", str(folder), "--output", str(output)]
        return subprocess.run([*command, *more], capture_output=True, text=True)

    assert call().returncode == 0
    with Image.open(output) as image:
        assert image.width == 2000
    wrong = call("--view", "7")
    assert wrong.returncode == 2
    assert wrong.stderr == "error: a has views 0 to 0, not 7; set --view\n"


def test_an_empty_set_is_refused(build: Build) -> None:
    with pytest.raises(ValueError, match="no finished subject"):
        contact_sheet(build({}), [], 0, 100, "rgb")


def test_the_view_turned_least_is_shown_unless_one_is_asked_for(build: Build) -> None:
    folder = build({"a": {"yaw_deg": [70.0, -1.0, 30.0]}})
    pages = [np.asarray(contact_sheet(folder, [], view, 300, "rgb")) for view in (None, 1, 0)]
    assert np.array_equal(pages[0], pages[1])
    assert pages[0].shape != pages[2].shape or (pages[0] != pages[2]).any()


def test_a_subject_that_is_not_seen_is_named(build: Build) -> None:
    unseen = {**figure(40, 50), "mask": np.zeros(SHAPE, dtype=bool)}
    folder = build({"a": {"maps": figure(40, 50)}, "b": {"maps": unseen}})
    with pytest.raises(ValueError, match="b is not seen in view 0; set --view"):
        contact_sheet(folder, [], None, 300, "rgb")
    assert contact_sheet(folder, ["a"], None, 300, "rgb").width == 300
