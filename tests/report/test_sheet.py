"""The picture of a dataset: which subjects, their sizes at one scale, their labels."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

import report.sheet
from report.sheet import COLUMNS, HEADER, LABEL, LIMIT, MARGIN, PAPER, sheet, spread
from shards.archive import Shard, write_shard
from tests.report.conftest import Build

SHAPE = (64, 96)
RED = (255, 0, 0)
ROW = LABEL + 2 * MARGIN


def figure(width: int, height: int) -> dict[str, Any]:
    """A red rectangle, that many pixels large."""
    mask = np.zeros(SHAPE, dtype=bool)
    mask[4 : 4 + height, 10 : 10 + width] = True
    rgb = np.where(mask[..., None], np.array(RED, np.uint8), 0)
    bare = np.zeros(SHAPE, np.float32)
    return {
        "mask": mask,
        "rgb_front": rgb,
        "depth_front": np.where(mask, 2.4, 0),
        "depth_back": np.where(mask, 2.6, 0),
        "depth_sensor": np.where(mask, 2.4, 0),
        "body_depth_front": bare,
        "body_depth_back": bare,
    }


def set_pixel_size(folder: Path, subject: str, pixel_size: float) -> None:
    """Say that the subject was taken with pixels of that many metres."""
    path = folder / "shards" / f"{subject}.npz"
    shard = Shard(path)
    arrays = {name: np.array(shard[name]) for name in shard.names}
    shard.meta["camera"]["pixel_size"] = pixel_size
    write_shard(path, arrays, shard.meta)


def red_boxes(page: Image.Image) -> list[tuple[int, int]]:
    """Width and height of the red rectangles in the first column, from above."""
    pixels = np.asarray(page)[:, : page.width // len(COLUMNS)].astype(int)
    red = (pixels[..., 0] > 200) & (pixels[..., 1] < 100)
    edges = np.flatnonzero(np.diff(red.any(axis=1).astype(int), prepend=0, append=0))
    spans = zip(edges[::2], edges[1::2], strict=True)
    return [(int(red[a:b].any(axis=0).sum()), int(b - a)) for a, b in spans]


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, tuple[float, ...]]]:
    """What is written on pages from now on, and its box in pixels."""
    found = []
    write = ImageDraw.ImageDraw.text

    def record(draw: ImageDraw.ImageDraw, xy: tuple[float, float], text: str, **more: Any) -> None:
        box = draw.textbbox(xy, text, font=more["font"], anchor=more["anchor"])
        found.append((text, box))
        write(draw, xy, text, **more)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", record)
    return found


def test_subjects_of_one_pixel_size_are_drawn_pixel_for_pixel(build: Build) -> None:
    folder = build({"a": {"maps": figure(40, 50)}, "b": {"maps": figure(20, 25)}})
    page = sheet(folder, ["a", "b"], 0)
    assert red_boxes(page) == [(40, 50), (20, 25)]
    assert page.height == HEADER + 2 * ROW + 50 + 25


def test_all_rows_have_the_scale_of_the_largest_pixel(build: Build) -> None:
    # Both fill 50 rows of their frames, but b is less than half as high as a.
    folder = build({"a": {"maps": figure(40, 50)}, "b": {"maps": figure(40, 50)}})
    set_pixel_size(folder, "a", 0.035)
    set_pixel_size(folder, "b", 0.014)
    assert red_boxes(sheet(folder, ["a", "b"], 0)) == [(40, 50), (16, 20)]
    assert red_boxes(sheet(folder, ["b"], 0)) == [(40, 50)]


def test_rows_are_labelled_with_id_and_height(
    build: Build, texts: list[tuple[str, tuple[float, ...]]]
) -> None:
    folder = build({"a": {"maps": figure(40, 50)}, "b": {"maps": figure(40, 50)}})
    set_pixel_size(folder, "a", 0.035)
    set_pixel_size(folder, "b", 0.014)
    sheet(folder, ["a", "b"], 0)
    assert [text for text, _ in texts[len(COLUMNS) :]] == ["a, 1.75 m", "b, 0.70 m"]


@pytest.mark.parametrize("width", [2, 80])
def test_titles_and_labels_overlap_nothing(
    build: Build, texts: list[tuple[str, tuple[float, ...]]], width: int
) -> None:
    page = sheet(build({"a": {"maps": figure(width, 50)}}), ["a"], 0)
    titles = [box for _, box in texts[: len(COLUMNS)]]
    assert titles[0][0] >= 0
    assert titles[-1][2] <= page.width
    assert all(left[2] + MARGIN <= right[0] for left, right in pairwise(titles))
    ((_, label),) = texts[len(COLUMNS) :]
    assert max(box[3] for box in titles) <= HEADER <= label[1]
    assert label[3] <= HEADER + LABEL
    assert (np.asarray(page)[HEADER + LABEL : HEADER + LABEL + MARGIN] == PAPER).all()


def test_a_body_beside_the_silhouette_is_drawn_whole_and_counts_for_no_height(
    build: Build, texts: list[tuple[str, tuple[float, ...]]]
) -> None:
    maps = figure(40, 50)
    maps["body_depth_back"] = maps["body_depth_back"].copy()
    maps["body_depth_back"][2:60, 20:30] = 2.5
    folder = build({"a": {"maps": maps}})
    set_pixel_size(folder, "a", 0.02)
    page = sheet(folder, ["a"], 0)
    assert page.height == HEADER + ROW + 58
    assert texts[-1][0] == "a, 1.00 m"


def test_a_large_picture_is_drawn_smaller(build: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = build({"a": {"maps": figure(80, 60)}, "b": {"maps": figure(80, 30)}})
    whole = sheet(folder, ["a", "b"], 0)
    most = round(0.85 * whole.width * whole.height)
    monkeypatch.setattr(report.sheet, "LARGEST", most)
    page = sheet(folder, ["a", "b"], 0)
    assert 0.9 * most < page.width * page.height <= most
    (_, high), (_, low) = red_boxes(page)
    assert 30 < high < 60
    assert high == pytest.approx(2 * low, abs=1)


def test_more_subjects_than_a_picture_can_show_are_refused(
    build: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report.sheet, "LARGEST", 1000)
    with pytest.raises(ValueError, match="2 subjects are too many"):
        sheet(build({"a": {"maps": figure(80, 40)}}), ["a", "a"], 0)


def test_a_subject_that_is_not_seen_is_named(build: Build) -> None:
    unseen = {**figure(40, 50), "mask": np.zeros(SHAPE, dtype=bool)}
    folder = build({"a": {"maps": unseen}})
    with pytest.raises(ValueError, match="a is not seen in view 0; set --view"):
        sheet(folder, ["a"], 0)


def test_the_subjects_are_spread_from_the_first_to_the_last() -> None:
    names = [f"{k:03}" for k in range(526)]
    shown = spread(names, LIMIT)
    assert (len(set(shown)), shown[0], shown[-1]) == (LIMIT, "000", "525")
    steps = np.diff([int(name) for name in shown])
    assert steps.max() - steps.min() <= 1
    assert spread(names, 1) == ["000"]
    assert spread(names[:3], LIMIT) == names[:3]


def call(folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Run the command line; it writes sheet.png beside the dataset."""
    output = folder.parent / "sheet.png"
    command = [sys.executable, "-m", "report.sheet", str(folder), "--output", str(output)]
    return subprocess.run([*command, *more], capture_output=True, text=True)


def test_a_call_draws_a_bounded_number_and_says_so(build: Build) -> None:
    subjects = [f"s{k:02}" for k in range(LIMIT + 2)]
    folder = build({subject: {"maps": figure(40, 50)} for subject in subjects})

    def rows(*more: str) -> tuple[int, str]:
        result = call(folder, *more)
        assert result.returncode == 0, result.stderr
        with Image.open(folder.parent / "sheet.png") as image:
            return (image.height - HEADER) // (ROW + 50), result.stderr

    drawn, said = rows()
    assert drawn == LIMIT
    assert said.startswith(f"{LIMIT} of {LIMIT + 2} subjects")
    assert "--subjects" in said
    assert "--limit N" in said
    assert rows("--limit", "3")[0] == 3
    assert rows("--limit", "100") == (LIMIT + 2, "")
    assert rows("--subjects", "s03", "s01") == (2, "")
    assert rows("--subjects", *subjects) == (LIMIT + 2, "")
    assert rows("--subjects", *subjects, "--limit", "5")[0] == 5


def test_wrong_calls_are_one_line_that_says_what_to_do(build: Build) -> None:
    folder = build({"a": {"maps": figure(40, 50)}})
    for more, line in (
        (("--limit", "0"), "--limit is 0; give a whole number above 0"),
        (("--view", "7"), "a has views 0 to 0, not 7; set --view"),
        (("--subjects", "b"), f"{folder} has no finished subject 'b'"),
    ):
        result = call(folder, *more)
        assert (result.returncode, result.stderr) == (2, f"error: {line}\n")


def test_an_empty_dataset_is_refused(build: Build) -> None:
    folder = build({"a": {"failed": "it is torn"}})
    assert json.loads((folder / "failures.jsonl").read_text())["subject"] == "a"
    result = call(folder)
    assert result.returncode == 2
    assert result.stderr == f"error: {folder} holds no finished subject; build it first\n"
