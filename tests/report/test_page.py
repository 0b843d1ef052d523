"""The report's page in a real browser: what is on the screen, by mouse, by keys and on a phone."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from augment import sensors
from experiments.run import EXPERIMENTS
from pipeline import main
from report.browser import browser as headless
from report.browser import chromium
from report.page.experiment import CAPTIONS
from report.page.histograms import Histograms
from report.page.measure import counts, turned
from report.page.shown import Fineness
from shards.archive import Shard, write_shard
from shards.checksum import file_sha256
from shards.dataset import Dataset, DatasetWriter
from shards.proof import PROOF, read_proof
from shards.sweep import power_folder, write_index
from shards.verify import verify
from tests.shards.conftest import (
    CONFIG,
    HEIGHT,
    WIDTH,
    closed_form_arrays,
    closed_form_meta,
    write_surfaces,
)

HOSTILE = "it <b>is</b> </script><img src=x onerror=\"document.title='run'\"> & broken"
COUNT = 30


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if chromium() is None and "CHROMIUM_REQUIRED" not in os.environ:
        pytest.skip("no Chromium; apt-get install chromium")
    with headless() as opened:
        yield opened


@pytest.fixture
def show(browser) -> Iterator[Callable[..., Any]]:
    """show(file, width): a page of the browser; at the end, nothing was fetched or failed."""
    pages, faults = [], []

    def show(file: Path, width: int = 1280) -> Any:
        page = browser.new_page(viewport={"width": width, "height": 900})
        pages.append(page)
        page.set_default_timeout(60_000)
        page.on("console", lambda said: said.type == "error" and faults.append(said.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on(
            "request",
            lambda asked: (
                asked.url.startswith(("data:", "blob:", "file:")) or faults.append(asked.url)
            ),
        )
        page.goto(file.as_uri())
        return page

    yield show
    for page in pages:
        page.close()
    assert faults == []


@pytest.fixture
def folder(build) -> Path:
    """Thirty subjects that are seen and one that is not."""
    made = {f"box_{k:02d}": {"yaw_deg": [5.0, -20.0]} for k in range(COUNT)}
    return build({**made, "broken": {"failed": HOSTILE}})


def report(folder: Path, *options: object) -> Path:
    assert main(["report", str(folder), "--jobs", "1", *map(str, options)]) == 0
    return folder / "report.html"


def cards(page: Any) -> list[str]:
    return page.locator(".card h3").all_text_contents()


def picture(page: Any, place: str) -> np.ndarray:
    return np.asarray(
        Image.open(io.BytesIO(page.locator(place).screenshot())).convert("RGB")
    ).astype(int)


def drawn(page: Any, place: str, is_it: Callable[[np.ndarray], bool]) -> np.ndarray:
    """The picture that a place comes to show: WebGL takes its time, the more on a busy machine."""
    for _ in range(60):
        seen = picture(page, place)
        if is_it(seen):
            return seen
        page.wait_for_timeout(500)
    raise AssertionError(f"{place} never shows what it should")


def differs(before: np.ndarray, by: float) -> Callable[[np.ndarray], bool]:
    return lambda seen: np.abs(seen - before).max(axis=-1).mean() > by


def is_orange(seen: np.ndarray) -> bool:
    """Of the box's colour, but for the paper."""
    orange = (np.abs(seen[..., 0] - 2 * seen[..., 1] * 0.85) < 60) & (seen.ptp(axis=-1) > 50)
    return bool(0.02 < orange.mean() < 0.9)


def test_it_shows_what_the_dataset_holds(folder, show):
    page = show(report(folder))
    assert page.title() == "dataset: report"
    summary = page.locator("#summary").inner_text()
    dataset = Dataset(folder)
    train, test = len(dataset.subjects("train")), len(dataset.subjects("test"))
    for told in (f"{COUNT}\nsubjects", f"{train} / {test}", "60\nviews", "1\nset aside", "CC0-1.0"):
        assert told in summary
    assert dataset.description["config_sha256"] in summary
    assert "30 s\nof one worker's time to render" in summary
    assert "to make the subjects" not in summary  # none of them says it
    assert "Nobody has proven this dataset" in page.locator("#proof").inner_text()
    assert HOSTILE in page.locator("#failures").inner_text()
    first = page.locator(".card").first
    assert "view 0, yaw 5°" in first.inner_text()
    maps = first.locator("img")
    words = maps.evaluate_all("all => all.map(one => one.alt)")
    assert words[:2] == ["box_00: RGB front", "box_00: RGB back"]
    assert {
        f"box_00: {w}" for w in ("depth back", "normals front", "thickness", "body, back")
    } < set(words)
    assert maps.evaluate_all("all => all.every(one => one.complete && one.naturalWidth > 20)")


def test_what_the_subjects_took_is_added_up(build):
    folder = build({f"box_{k}": {"parameters": {}} for k in range(3)})
    text = report(folder).read_text()
    assert "<b>94 s</b>of one worker&#x27;s time to make the subjects" in text
    assert "<b>3 s</b>of one worker&#x27;s time to render" in text


def test_nothing_offers_to_send_it_away(folder, show):
    """plotly's bar would upload a chart to its makers' server."""
    page = show(report(folder))
    page.locator(".card").first.get_by_role("button", name="in 3D").click()
    page.wait_for_selector("#solid[data-drawn]")
    page.locator("#solid").hover()
    assert page.locator(".modebar-btn").count() == 0
    page.keyboard.press("Escape")
    page.locator("#histograms").scroll_into_view_if_needed()
    page.wait_for_selector("#histogram-yaw .main-svg")
    page.locator("#histogram-yaw").hover()
    assert page.locator(".modebar-btn").count() == 0


def test_the_pictures_are_the_maps(folder, show):
    """The box is orange from the front, and half as bright from the back."""
    page = show(report(folder))
    colors = [
        np.median(picture(page, f'img[alt="box_00: RGB {side}"]')[80:110, 40:60], axis=(0, 1))
        for side in ("front", "back")
    ]
    np.testing.assert_allclose(colors[0], (200, 120, 40), atol=6)
    np.testing.assert_allclose(colors[1], (100, 60, 20), atol=6)


def test_pages_and_filters(folder, show):
    page = show(report(folder))
    assert cards(page) == [f"box_{k:02d}" for k in range(12)]
    assert page.locator("#previous").is_disabled()
    page.click("#next")
    assert page.evaluate("document.activeElement.id") == "next"
    assert page.locator("#gallery").bounding_box()["y"] == pytest.approx(0, abs=1)
    page.click("#next")
    assert page.evaluate("document.activeElement.id") == "previous"  # there is no next
    assert cards(page) == [*(f"box_{k:02d}" for k in range(24, COUNT)), "broken"]
    assert page.locator("#where").inner_text() == "of 3: subjects 25 to 31 of 31"
    assert page.locator("#page").input_value() == "3"
    assert page.locator("#next").is_disabled()
    page.select_option("#group", "test")
    assert cards(page) == Dataset(folder).subjects("test")
    page.select_option("#group", "failed")
    assert cards(page) == ["broken"]
    assert HOSTILE in page.locator(".card").inner_text()
    page.select_option("#group", label="set aside: subjects (1)")
    assert cards(page) == ["broken"]
    page.select_option("#group", "all")
    for part in ("& BROKEN", "set aside"):  # of a reason, of what it is
        page.fill("#search", part)
        assert cards(page) == ["broken"]
    page.fill("#search", "BOX_1")
    assert cards(page) == [f"box_{k}" for k in range(10, 20)]
    page.fill("#search", "nobody")
    assert cards(page) == []
    assert page.locator("#where").inner_text() == "no subject"
    assert page.title() == "dataset: report"  # what a reason says was never run


def test_it_turns_in_three_dimensions(folder, show):
    page = show(report(folder))
    page.locator(".card").nth(1).get_by_role("button", name="in 3D").click()
    page.wait_for_selector('#solid[data-drawn="box_01 surface"]')
    assert page.locator("#solid-title").inner_text() == "box_01"
    front = drawn(page, "#solid", is_orange)
    page.get_by_role("button", name="Turn right").click()
    page.wait_for_selector('#solid[data-eye="30 4 1.90"]')
    turned = drawn(page, "#solid", differs(front, 2))
    page.select_option("#kind", "body")
    page.wait_for_selector('#solid[data-drawn="box_01 body"]')
    body = drawn(page, "#solid", differs(turned, 2))
    page.select_option("#kind", "sensor")
    page.wait_for_selector('#solid[data-drawn="box_01 sensor"]')
    sensor = drawn(page, "#solid", differs(body, 2))
    drag(page, 150, 0)
    drawn(page, "#solid", differs(sensor, 1))
    # Buttons go on from where the mouse has brought it.
    dragged = float(page.locator("#solid").get_attribute("data-eye").split()[0])
    assert dragged != 30
    page.get_by_role("button", name="Turn right").click()
    turn = float(page.locator("#solid").get_attribute("data-eye").split()[0])
    assert (turn - dragged) % 360 == pytest.approx(30, abs=1)
    eye = page.locator("#solid").evaluate("plot => plot.layout.scene.camera.eye")
    assert np.degrees(np.arctan2(eye["x"], -eye["y"])) % 360 == pytest.approx(turn, abs=1)
    assert page.locator("#seen").inner_text().startswith(f"turned {turn:.0f}°")
    # So they do from above and from near; and what was moved aside comes back to the middle.
    before = place_of(page)
    drag(page, 0, 60)
    page.mouse.wheel(0, -100)
    page.wait_for_timeout(500)
    moved = place_of(page)
    assert moved[1] > before[1] + 3
    assert moved[2] == pytest.approx(before[2] / np.exp(0.25), abs=0.02)
    page.get_by_role("button", name="Turn left").click()
    after = place_of(page)
    assert ((moved[0] - after[0]) % 360, *after[1:]) == pytest.approx((30, *moved[1:]), abs=1)
    pull(page, 80, 0, "right")
    page.wait_for_timeout(500)
    assert place_of(page) == pytest.approx(after, abs=1)
    page.get_by_role("button", name="Turn left").click()
    center = page.locator("#solid").evaluate("plot => plot.layout.scene.camera.center")
    assert center == {"x": 0, "y": 0, "z": 0}


def pull(page: Any, right: int, down: int, button: str) -> None:
    """Move the mouse from the middle of the 3D view with a button held."""
    box = page.locator("#solid").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down(button=button)
    page.mouse.move(x + right, y + down, steps=8)
    page.wait_for_timeout(100)
    page.mouse.up(button=button)


def drag(page: Any, right: int, down: int) -> None:
    """Turn the 3D view by the mouse; a busy machine loses what the mouse does meanwhile."""
    before = place_of(page)
    for _ in range(10):
        pull(page, right, down, "left")
        for _ in range(10):
            if place_of(page) != before:
                return
            page.wait_for_timeout(200)
    raise AssertionError("the mouse turns nothing")


def place_of(page: Any) -> tuple[float, float, float]:
    """Degrees about and above, and how far."""
    turn, tilt, far = map(float, page.locator("#solid").get_attribute("data-eye").split())
    return turn, tilt, far


def test_what_a_subject_lacks_is_not_offered(build, show):
    """A scan has no body, and a sensor may have seen nothing."""
    nothing = np.zeros((HEIGHT, WIDTH))
    names = ("body_depth_front", "body_depth_back", "depth_sensor")
    folder = build({"bare": {"maps": dict.fromkeys(names, nothing)}, "whole": {}})
    page = show(report(folder))
    page.get_by_role("button", name="Turn whole in 3D").click()
    page.wait_for_selector('#solid[data-drawn="whole surface"]')
    page.select_option("#kind", "body")
    page.click("#close")
    page.get_by_role("button", name="Turn bare in 3D").click()
    page.wait_for_selector('#solid[data-drawn="bare surface"]')
    assert page.locator("#kind option:disabled").count() == 2


def tab_to(page: Any, what: str) -> None:
    """Press Tab until what has the focus holds an id or a text."""
    for _ in range(40):
        page.keyboard.press("Tab")
        if what in page.evaluate("[document.activeElement.id, document.activeElement.textContent]"):
            return
    raise AssertionError(f"Tab does not reach {what}")


def test_histograms_are_drawn_when_they_are_seen(folder, show):
    page = show(report(folder))
    page.locator("#failures").scroll_into_view_if_needed()
    page.locator("#histograms").scroll_into_view_if_needed()
    for name in ("depth", "thickness", "yaw", "coverage"):
        page.wait_for_selector(f"#histogram-{name} .main-svg")
    yaw = page.locator("#histogram-yaw")
    assert "Yaw of all views" in yaw.inner_text()
    # Two yaws, half of the views each, in bins of two degrees.
    bars = yaw.evaluate("plot => [plot.data[0].x, plot.data[0].y]")
    seen = [(x, y) for x, y in zip(*bars, strict=True) if y]
    assert seen == [(-19, 0.25), (5, 0.25)]
    # And in words, for who hears the page.
    told = "median 4.0, nine tenths from -19.8 to 5.8"
    assert yaw.get_attribute("aria-label") == f"Histogram: Yaw of all views, degrees; {told}"
    assert told in page.locator("#histograms").inner_text()


def test_a_thousand_subjects(build, show):
    """Any of them is found in a step or two, and the page shows no more at once than twelve."""
    failed = {f"lost_{k:03d}": {"failed": "no body was found"} for k in range(150)}
    page = show(report(build({f"box_{k:03d}": {} for k in range(1000)} | failed)))
    assert len(cards(page)) == 12
    assert page.locator("#where").inner_text() == "of 96: subjects 1 to 12 of 1150"
    page.fill("#page", "84")
    page.locator("#page").blur()
    assert cards(page)[:4] == ["box_996", "box_997", "box_998", "box_999"]
    page.fill("#page", "1000")
    page.locator("#page").blur()
    assert page.locator("#page").input_value() == "96"
    assert cards(page)[-1] == "lost_149"
    page.fill("#search", "box_77")
    assert cards(page) == [f"box_{k}" for k in range(770, 780)]
    assert page.locator(".card img").first.evaluate("picture => picture.decode()") is None
    # So many failures take no more of the page than a screen has.
    table = page.locator("#failures .long")
    assert table.bounding_box()["height"] <= 0.6 * 900 + 1
    table.focus()
    page.keyboard.press("End")
    page.wait_for_timeout(1000)
    assert table.evaluate("box => box.scrollTop") > 1000


def test_by_keys_alone(folder, show):
    page = show(report(folder))
    page.locator("#group").focus()
    tab_to(page, "Turn in 3D")
    page.keyboard.press("Enter")
    page.wait_for_selector('#solid[data-drawn="box_00 surface"]')
    assert page.locator("#solid-dialog").is_visible()
    tab_to(page, "Turn left")
    page.keyboard.press("Enter")
    page.wait_for_selector('#solid[data-eye="330 4 1.90"]')
    tab_to(page, "solid")
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "+"):
        page.keyboard.press(key)
    page.wait_for_selector('#solid[data-eye="30 24 1.52"]')
    for _ in range(9):
        page.keyboard.press("ArrowDown")
        page.keyboard.press("-")
    page.wait_for_selector('#solid[data-eye="30 -80 4.00"]')
    page.keyboard.press("Escape")
    assert page.locator("#solid-dialog").is_hidden()
    opener = "document.activeElement.getAttribute('aria-label')"
    assert page.evaluate(opener) == "Turn box_00 in 3D"


LONG = "no surface in " + "/a/folder/whose/name/has/no/end" * 6


def fits(page: Any) -> bool:
    """Whether nothing has to be moved sideways to be read."""
    sideways = (
        "[document.scrollingElement, ...document.querySelectorAll('.wide, dialog')]"
        ".filter(one => one.scrollWidth > one.clientWidth + 1).map(one => one.innerText)"
    )
    return page.evaluate(sideways) == [] and not broken_words(page)


def broken_words(page: Any) -> list[str]:
    """Numbers and words that stand alone and are broken over lines."""
    return page.evaluate(
        "[...document.querySelectorAll('td:not(.text), tbody th')].filter(one => {"
        "const range = document.createRange(); range.selectNodeContents(one);"
        "const lines = new Set([...range.getClientRects()].map(box => Math.round(box.bottom)));"
        "return lines.size > 1 && !one.textContent.trim().includes(' ');"
        "}).map(one => one.innerText)"
    )


def test_it_is_read_at_a_phone_s_width(build, show):
    folder = build({"box_0": {}, "broken": {"failed": LONG}})
    assert main(["verify", str(folder)]) == 1  # and its breaches name long paths
    page = show(report(folder), 360)
    assert LONG in page.locator("#failures").inner_text()
    assert fits(page)
    page.locator(".card").first.get_by_role("button", name="in 3D").click()
    page.wait_for_selector("#solid[data-drawn]")
    place, window = (page.locator(f"#solid{more}").bounding_box() for more in ("", "-dialog"))
    assert place["width"] > 250
    assert place["height"] > 250
    assert window["y"] >= 0
    assert window["y"] + window["height"] <= 900
    assert place["y"] + place["height"] <= window["y"] + window["height"]
    assert fits(page)
    assert not page.evaluate("[...document.images].some(one => !one.alt)")


def test_the_proof_is_of_the_dataset_as_it_stands(tmp_path, show):
    folder = tmp_path / "sound"
    with DatasetWriter(folder, CONFIG, ["box"], 7, {"numpy": np.__version__}) as writer:
        write_surfaces(folder)
        written = write_shard(
            writer.shard_path("box"), closed_form_arrays(), closed_form_meta("box")
        )
        writer.add("box", *written, 1.0, "CC0-1.0")
        writer.finish()
    assert main(["verify", str(folder)]) == 0
    dataset = Dataset(folder)
    kept, made = read_proof(dataset), verify(folder)
    assert kept is not None
    assert (kept.breaches, kept.figures) == (made.breaches, made.figures)
    page = show(report(folder))
    said = page.locator("#proof").inner_text()
    assert "Sound when it was verified" in said
    assert "The worst of 1 subjects" in said
    assert "proof: 0 pixels of the silhouette off" in page.locator(".card").inner_text()
    manifest = folder / "manifest.jsonl"
    manifest.write_text(manifest.read_text().replace('"seconds": 1.0', '"seconds": 2.0'))
    assert read_proof(dataset) is None  # of another manifest
    assert "Nobody has proven" in show(report(folder)).locator("#proof").inner_text()
    (folder / PROOF).write_text('{"manifest_sha256": 3}')
    assert read_proof(dataset) is None


def test_what_is_unsound_is_told(folder, show):
    assert main(["verify", str(folder)]) == 1  # its surfaces are none
    page = show(report(folder))
    said = page.locator("#proof").inner_text()
    assert re.search(r"\d+ breaches", said)
    assert "holds no triangles" in said


def test_a_training_s_curves(tmp_path, show):
    epochs = [
        {"loss_depth": 1 / k, "given_mm": 6.0, "depth_mm": 5.0 / k, "depth_ratio": 5 / 6 / k}
        for k in range(1, 6)
    ]
    (tmp_path / "history.jsonl").write_text("".join(json.dumps(e) + "\n" for e in epochs))
    Image.new("RGB", (300, 200), (10, 200, 10)).save(tmp_path / "test.png")
    page = show(report(tmp_path))
    page.wait_for_selector("#curve-ratio .main-svg")
    drawn = page.locator("#curve-loss").evaluate("plot => plot.data[0].y")
    assert drawn == [epoch["loss_depth"] for epoch in epochs]
    named = page.locator("#curve-mm").evaluate("plot => plot.data.map(one => one.name)")
    assert named == ["given_mm", "depth_mm"]
    assert "Epochs: 5" in page.locator("header").inner_text()
    assert re.search(r"depth_mm\s+1\s+1", page.locator("#figures").inner_text())
    np.testing.assert_allclose(picture(page, "img.picture")[100, 100], (10, 200, 10), atol=3)
    said = page.locator("#curve-mm").get_attribute("aria-label")
    assert "given_mm from 6 to 6; depth_mm from 5 to 1" in said
    assert fits(show(tmp_path / "report.html", 360))


def test_a_training_that_diverged_or_was_torn(tmp_path, show, capsys):
    epochs = ['{"loss_depth": 2.0}', '{"loss_depth": NaN}', '{"loss_depth": 1.5, "depth_mm": 3}']
    (tmp_path / "history.jsonl").write_text("\n".join([*epochs, '{"loss_de']))
    page = show(report(tmp_path))
    page.wait_for_selector("#curve-loss .main-svg")
    assert page.locator("#curve-loss").evaluate("plot => plot.data[0].y") == [2.0, None, 1.5]
    (tmp_path / "history.jsonl").write_text("torn\n" + epochs[0])
    assert main(["report", str(tmp_path)]) == 2
    assert "history.jsonl line 1 is no epoch" in capsys.readouterr().err


def test_captions_are_of_the_experiments():
    assert set(CAPTIONS) == set(EXPERIMENTS)


def test_a_torn_result_is_named(tmp_path, capsys):
    (tmp_path / "results").mkdir()
    (tmp_path / "study.json").write_text("{}")
    (tmp_path / "results" / "table1.json").write_text('{"a": ')
    assert main(["report", str(tmp_path)]) == 2
    assert "table1.json is torn" in capsys.readouterr().err


def test_an_experiment_s_tables_and_figures(tmp_path, show):
    results = tmp_path / "results"
    results.mkdir()
    (tmp_path / "study.json").write_text('{"seeds": [0, 1]}')
    (results / "table4.json").write_text('{"columns": ["CD"]}')
    head = "| | CD | P2S | L2 |\n|---|---:|---:|---:|\n"
    told = f"{head}| U-Net+nGAN | 0.0897 | 0.1227 | 0.4836 |\n\n<script>no</script>\n"
    (results / "table4.md").write_text(told)
    (results / "fig9.json").write_text("{}")
    Image.new("RGB", (300, 200), (10, 10, 200)).save(results / "fig9.png")
    page = show(report(tmp_path))
    cells = ["U-Net+nGAN", "0.0897", "0.1227", "0.4836"]
    assert page.locator("#table4 td").all_text_contents() == cells
    assert "<script>no</script>" in page.locator("#table4").inner_text()
    assert not broken_words(show(tmp_path / "report.html", 360))
    np.testing.assert_allclose(picture(page, "#fig9 img")[100, 100], (10, 10, 200), atol=3)


def photographed(data: Path, folder: Path, powers: dict[float, list[str]]) -> None:
    """A sweep of boxes: watts -> the subjects that the power has; the others were set aside."""
    base = Dataset(data)
    folder.mkdir()
    write_index(folder, data, {}, powers)
    for power, has in powers.items():
        place = folder / power_folder(power)
        names = list(base.manifest)
        with DatasetWriter(place, {"power": power}, names, 7, {}, base) as writer:
            for subject in names:
                if subject not in has:
                    writer.fail(subject, "light", f"too dark at {power:g}")
                    continue
                path = data / "shards" / f"{subject}.npz"
                whole = Shard(path)
                colors = {n: whole[n] // round(2000 / power) for n in ("rgb_front", "rgb_back")}
                refers = {
                    "shard": f"base/shards/{subject}.npz",
                    "contents": whole.contents,
                    "sha256": file_sha256(path),
                }
                light = {"power": power, "position": [0, 0, 0], "exposure": 1.0}
                meta = whole.meta | {"base": refers, "light": light, "color_camera": None}
                written = write_shard(writer.shard_path(subject), colors, meta, base=whole)
                writer.add(subject, *written, 1.0, "CC0-1.0")
            writer.finish()


def test_a_sweep_s_powers(build, show, tmp_path):
    data, folder = build({"box_0": {}, "box_1": {}}), tmp_path / "sweep"
    photographed(data, folder, {2000.0: ["box_0", "box_1"], 100.0: ["box_0", "box_1"]})
    page = show(report(folder))
    assert page.locator("#powers tbody th").all_text_contents() == ["2000 W", "100 W"]
    assert page.locator("#powers td:last-child").all_text_contents() == ["not proven"] * 2
    assert cards(page) == ["box_0", "box_1"]
    assert page.locator("#failures p").inner_text() == "None."
    bright, dark = (
        np.median(picture(page, f'img[alt="box_1 at {power} W"]')[80:110, 40:60], axis=(0, 1))
        for power in (2000, 100)
    )
    np.testing.assert_allclose(bright, (200, 120, 40), atol=6)
    np.testing.assert_allclose(dark, (10, 6, 2), atol=6)
    assert main(["verify", str(folder)]) == 1  # the boxes' surfaces are none
    own = show(report(folder / power_folder(100.0)))  # which is a dataset too
    assert cards(own) == ["box_0", "box_1"]
    assert "Nobody has proven" not in own.locator("#proof").inner_text()
    assert read_proof(Dataset(data)) is not None


def test_a_sweep_s_failures_and_breaches(build, show, tmp_path):
    """Each power has its own, and what one has is shown though another has not."""
    data, folder = build({"box_0": {}, "box_1": {}, "box_2": {}}), tmp_path / "sweep"
    photographed(data, folder, {2000.0: ["box_0"], 100.0: ["box_0", "box_1"], 50.0: []})
    torn = folder / power_folder(100.0) / "shards" / "box_0.npz"
    torn.write_bytes(torn.read_bytes()[:500])
    assert main(["verify", str(folder)]) == 1
    page = show(report(folder, "--jobs", 2))
    rows = page.locator("#powers tbody tr").all_inner_texts()
    assert [row.split()[:4] for row in rows] == [
        ["2000", "W", "1", "2"],
        ["100", "W", "2", "1"],
        ["50", "W", "0", "3"],
    ]
    assert "breach" in rows[1]
    assert "box_0" in page.locator("#powers ul").nth(1).inner_text()
    assert cards(page) == ["box_0", "box_1"]
    assert page.locator(".card").first.locator("img").count() == 1
    assert "box_0.npz" in page.locator(".card").first.inner_text()
    failures = page.locator("#failures tbody tr").all_inner_texts()
    assert len(failures) == 6
    assert "box_2\t50 W\tlight\ttoo dark at 50" in failures


@pytest.mark.parametrize("count", [1, 100, 150, 151, 500, 1000])
def test_more_subjects_are_shown_more_coarsely(count):
    assert Fineness.of(count, 424).scale >= Fineness.of(count + 1, 424).scale
    assert Fineness.of(count, 848).scale == Fineness.of(count, 424).scale / 2
    assert Fineness.of(count, 848).step == Fineness.of(count, 424).step * 2


@pytest.mark.parametrize(("views", "measured"), [(1, 1), (2, 2), (3, 3), (14, 4)])
def test_residuals_are_of_the_view_shown_and_of_three_others(tmp_path, views, measured):
    arrays = closed_form_arrays(1)
    arrays = {name: np.concatenate([array] * views) for name, array in arrays.items()}
    meta = closed_form_meta("box", views) | {"sensor": {"model": "normalgan", "distance": 2.0}}
    shard_path = tmp_path / "box.npz"
    mask = arrays["mask"]
    for i in range(views):
        maps = {n: arrays[n][i] for n in ("depth_front", "normal_front", "rgb_front", "mask")}
        arrays["depth_sensor"][i] = sensors.read(maps, meta, i).depth
    arrays["depth_sensor"][0][np.argwhere(mask[0])[0][0]] = 0
    write_shard(shard_path, arrays, meta)
    found = counts(Shard(shard_path), 0)
    row = mask[0][np.argwhere(mask[0])[0][0]].sum()
    assert found["read"] == measured * mask[0].sum() - row
    assert found["lost"] == row
    assert found["measured"] == sum(found["residual"]) == found["read"]
    assert found["beyond"] == 0
    told = Histograms.of([found]).residuals
    spread = re.search(
        r"residuals lie within (\S+) standard deviations .* 0.0% are larger than 6", told
    )
    assert float(spread[1]) == pytest.approx(1, abs=0.1)
    assert sum(found["thickness"]) == measured * mask[0].sum()
    assert sum(found["depth"]) == 2 * measured * mask[0].sum()


def test_a_sensor_without_a_model_has_no_residuals(folder, show):
    page = show(report(folder))
    said = page.locator("#histograms").inner_text()
    assert "lost 0 (0.0%)" in said
    assert "There are no residuals" in said
    assert page.locator(".plot").count() == 4  # and none of residuals


def broken(folder: Path, arrays: dict[str, Any], meta: dict[str, Any]) -> None:
    """Write box_0's shard as no builder would: None leaves a member or an entry out."""
    path = folder / "shards" / "box_0.npz"
    shard = Shard(path)
    told = {name: value for name, value in (shard.meta | meta).items() if value is not None}
    members = {name: np.array(shard[name]) for name in shard.names} | arrays
    kept = {name: array for name, array in members.items() if array is not None}
    np.savez(path, **kept, meta=np.array(json.dumps(told)))


@pytest.mark.parametrize(
    ("arrays", "meta"),
    [
        ({"yaw_deg": np.array([np.nan, 0], np.float32)}, {}),
        ({"yaw_deg": np.array([], np.float32)}, {}),
        ({"depth_back": np.full((2, HEIGHT, WIDTH), -1, np.float32)}, {}),
        ({"depth_sensor": None}, {}),
        ({"body_depth_back": None}, {}),
        ({"rgb_front": None}, {}),
        ({"mask": None}, {}),
        ({}, {"camera": None}),
        ({}, {"sensor": None}),
        ({}, {"licence": None}),
        ({}, {"camera": {"pixel_size": "much"}}),
        ({}, {"sensor": [1]}),
        ({"depth_front": np.zeros((2, 3, 3), np.float32)}, {}),
    ],
    ids=str,
)
def test_whatever_one_shard_lacks_the_others_are_shown(build, arrays, meta, capsys):
    folder = build({"box_0": {"yaw_deg": [0.0, 9.0]}, "box_1": {"yaw_deg": [0.0, 9.0]}})
    broken(folder, arrays, meta)
    text = report(folder).read_text()
    assert re.search(r'"id":"box_0"[^}]*"what":"cannot be shown","reason":"[^"]*box_0.npz', text)
    assert re.search(r'"id":"box_1"[^}]*"record"', text)
    assert "<b>1</b>cannot be shown" in text
    assert text.count("box_0.npz") == 2  # told once in the gallery and once among the failures


def test_a_view_that_is_measured_alone_may_be_the_broken_one(build):
    folder = build({"box_0": {"yaw_deg": [0.0, 9.0]}, "box_1": {}})
    depth = np.array(Shard(folder / "shards" / "box_0.npz")["depth_front"])
    depth[1, 20] = np.nan
    broken(folder, {"depth_front": depth}, {})
    text = report(folder).read_text()
    assert re.search(r'"id":"box_0"[^}]*"reason":"[^"]*view 1 holds what is no number', text)


def test_yaws_all_round_are_counted():
    none = dict.fromkeys(("read", "lost", "measured", "beyond"), 0)
    kept = {"depth": [1], "thickness": [1], "residual": [0], "coverage": [0.5]}
    yaw_deg = {"yaw_deg": turned(np.array([270, 0, -190], "<f4"))}
    plots = Histograms.of([{**none, **kept, **yaw_deg}]).plots
    yaw = next(one for one in plots if one.name == "yaw")
    assert sum(yaw.values) == 3
    assert [yaw.first + yaw.width * k for k, n in enumerate(yaw.values) if n] == [-90, 0, 170]


def test_of_a_damaged_dataset_all_else_is_shown(build, show):
    names = [f"box_{k}" for k in range(5)]
    folder = build({name: {} for name in names})
    shards = folder / "shards"
    (shards / "box_0.npz").unlink()
    (shards / "box_1.npz").write_bytes(b"torn")
    for name, change in (("box_2", {"mask": False}), ("box_3", {"depth_front": np.nan})):
        shard = Shard(shards / f"{name}.npz")
        arrays = {n: np.array(shard[n]) for n in shard.names}
        for member, value in change.items():
            arrays[member][:] = value
        write_shard(shards / f"{name}.npz", arrays, shard.meta)
    page = show(report(folder))
    assert cards(page) == names
    page.select_option("#group", "failed")
    assert cards(page) == names[:4]
    assert "view 0 shows nothing" in page.locator(".card").nth(2).inner_text()


def test_a_dataset_of_failures_alone(build, show):
    folder = build({"broken": {"failed": HOSTILE}})
    page = show(report(folder))
    assert cards(page) == ["broken"]
    page.locator("#histograms").scroll_into_view_if_needed()
    assert "There is no subject to measure" in page.locator("#histograms").inner_text()
    page.wait_for_timeout(300)


def test_what_is_asked_for_last_is_drawn(build, show):
    """Though what was asked for first takes longer; and a black picture is one."""
    folder = build({"dark": {"maps": {"rgb_front": np.zeros((HEIGHT, WIDTH, 3))}}, "light": {}})
    page = show(report(folder))
    opens = "document.querySelectorAll('.card button')"
    page.evaluate(
        f"{opens}[0].click(); document.getElementById('kind').value = 'sensor';"
        "document.getElementById('kind').dispatchEvent(new Event('change'));"
    )
    page.wait_for_selector('#solid[data-drawn="dark sensor"]')
    page.wait_for_timeout(500)
    kinds = page.locator("#solid").evaluate("plot => plot.data.map(one => one.type)")
    assert kinds == ["scatter3d"]
    page.click("#close")
    page.evaluate(f"{opens}[1].click(); document.querySelector('[data-move]').click();")
    page.evaluate("document.getElementById('close').click()")
    page.wait_for_timeout(500)
    page.evaluate("document.getElementById('kind').value = 'surface'")
    page.evaluate(f"{opens}[0].click()")
    page.wait_for_selector('#solid[data-drawn="dark surface"]')


def test_a_part_is_photographed_from_its_heading(folder, tmp_path):
    if chromium() is None:
        pytest.skip("no Chromium")
    page, output = report(folder), tmp_path / "part.png"

    def photograph(*options: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "report.browser", *map(str, options)]
        return subprocess.run(
            [*command, "--output", str(output)], capture_output=True, text=True, check=False
        )

    assert photograph(page, "--part", "failures").returncode == 0
    seen = np.asarray(Image.open(output).convert("L"))
    assert seen.shape[1] == 1280
    assert 80 < seen.shape[0] < 400  # a heading and one row, and nothing of the histograms
    assert (seen < 100).any()
    assert photograph(page, "--height", 300).returncode == 0
    assert Image.open(output).size == (1280, 300)
    wrong = photograph(page, "--part", 'a"b')
    assert (wrong.returncode, wrong.stderr) == (2, f"error: {page} has no part 'a\"b'\n")
    assert "make it with python pipeline.py" in photograph(tmp_path / "none.html").stderr


def test_a_folder_that_cannot_be_written_is_told_first(folder, capsys, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: False)
    assert main(["report", str(folder)]) == 2
    assert "give another place with --output" in capsys.readouterr().err


def test_what_is_none_is_told_in_one_line(tmp_path, capsys):
    assert main(["report", str(tmp_path)]) == 2
    assert "holds no dataset, sweep, training or experiment" in capsys.readouterr().err
