"""The browser that pages are tried with; and a picture of a page, as it shows it.

python -m report.browser out/demo/report.html --output page.png
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from report import command

NAMES = ("chromium", "chromium-browser", "google-chrome")
# It asks nobody for anything, needs no GPU, and may be started by root.
QUIET = ["--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-sync"]
QUIET += ["--disable-component-update", "--disable-quic", "--enable-unsafe-swiftshader"]

WIDTH = 1280
"""Pixels of a picture."""


def chromium() -> str | None:
    """The path of Chromium, if it is installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)


@contextmanager
def browser() -> Iterator[Any]:
    """A headless Chromium, of Playwright's kind.

    Raises:
        FileNotFoundError: there is none.
    """
    from playwright.sync_api import sync_playwright

    path = chromium()
    if path is None:
        raise FileNotFoundError("no Chromium is installed; apt-get install chromium")
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=path, args=QUIET)
        try:
            yield opened
        finally:
            opened.close()


def photograph(page: Path, part: str, height: int, output: Path) -> None:
    """A part of a report, from its heading on.

    Args:
        page: the report.
        part: a heading, as the page's first line names it.
        height: of the picture at most, pixels.
        output: PNG to write.

    Raises:
        ValueError: the page has no such part.
        FileNotFoundError: there is no Chromium, or no page.
    """
    if not page.is_file():
        raise FileNotFoundError(f"there is no {page}; make it with python pipeline.py report")
    with browser() as opened:
        tab = opened.new_page(viewport={"width": WIDTH, "height": height})
        tab.goto(page.resolve().as_uri())
        place = tab.evaluate_handle("part => document.getElementById(part)", part).as_element()
        if place is None:
            raise ValueError(f"{page} has no part '{part}'")
        place.scroll_into_view_if_needed()
        for plot in place.query_selector_all(".plot"):
            plot.wait_for_selector(".main-svg")
        box = place.evaluate(
            "part => [part.getBoundingClientRect().top + window.scrollY, part.scrollHeight]"
        )
        area = {"x": 0, "y": box[0], "width": WIDTH, "height": min(box[1], height)}
        tab.screenshot(path=output, clip=area, full_page=True)


def main() -> int:
    """Write the picture; returns the exit status."""
    parser = argparse.ArgumentParser(description="A picture of a report, as a browser shows it.")
    parser.add_argument("page", type=Path, help="a report.html")
    parser.add_argument("--part", default="gallery", help="of the page (default: gallery)")
    parser.add_argument("--height", type=int, default=900, help="pixels at most (default: 900)")
    parser.add_argument("--output", type=Path, required=True, help="PNG to write")
    options = parser.parse_args()

    def draw(output: Path) -> None:
        photograph(options.page, options.part, options.height, output)

    return command.write(draw, options.output)


if __name__ == "__main__":
    sys.exit(main())
