"""Every command and every block of code in README and docs: run as it stands, or on less of it.

They run in a copy of the checkout with a small dataset at `out/demo`, in the order of the page.
What cannot run here is named below with its reason, and the program reads its options all the same.
"""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(p.relative_to(ROOT).as_posix() for p in ROOT.glob("docs/**/*.md")))

PEOPLE = "--subjects.count 2 --subjects.cloth laid --subjects.texture_size 256"
VIEWS = "--views.count 4 --cycles.samples 2"
LESS = {
    r"build .*configs/open\.yaml": f"{PEOPLE} {VIEWS}",
    r"build .*new_source\.yaml": "--subjects.count 2 --cycles.samples 2",
    r"sweep .*light_sweep\.yaml": "--powers '[2000, 100]'",
    r"train .*_front_cpu": "--epochs 1 --workers 0 --batch 2",
    r"train .*_back_cpu": "--epochs 1 --workers 0 --batch 2",
}
"""What a command is made smaller with: a part of it -> options that are added."""

READ = {
    r"configs/(thuman2|thuman21|customhumans|2k2k|renderpeople|glb|scans)\.yaml": "licensed scans",
    r"--scheduler|s3://": "a cluster, a store; test_cluster.py and test_survival.py have theirs",
    r" experiment ": "hours; tests/experiments has the small way",
    r"--device cuda": "a GPU",
    r"NAME": "a name is to be put in",
}
"""What is only read: a part of a command -> why it is not run."""

SCANS = r"2k2k|customhumans|renderpeople|thuman21?|thuman2|people|flat|plain|\w+_bodies|scans|unit"

SHOWN = {
    r"^(make|pip|dask|tensorboard|torchrun|for|\.) ": "installs, serves, or is what runs this",
    rf"(build|verify|sheet) .*out/({SCANS})\b": "of licensed scans",
    r"python -m benchmarks": "half an hour",
    r"--frame\.": "an image of your own; tests/experiments has one",
}
"""What is neither: a part of a command -> why."""

COMMANDS = re.compile(r"^(python|pip|make|dask|tensorboard|torchrun|for|\.) ")


@dataclass(frozen=True)
class Block:
    """A block of a page: its language, its first line's number, its text."""

    language: str
    line: int
    text: str


def blocks(page: str) -> list[Block]:
    """The fenced and the indented blocks, in order."""
    found: list[Block] = []
    language, begun, kept = None, 0, list[str]()
    indented: list[str] = []
    for number, line in enumerate([*(ROOT / page).read_text().splitlines(), ""], start=1):
        fence = re.match(r"^ *```(\w*)", line)
        if language is not None:
            if fence:
                found.append(Block(language, begun, "\n".join(kept)))
                language = None
            else:
                kept.append(line)
            continue
        if fence:
            language, begun, kept = fence[1], number, []
        if re.match(r"^ {4}\S", line) or (indented and re.match(r"^ {4}", line)):
            indented.append(line.strip())
        elif indented:
            if COMMANDS.match(indented[0]):
                found.append(Block("sh", number - len(indented), "\n".join(indented)))
            indented = []
    return found


def commands(block: Block) -> list[str]:
    """Whole command lines, without their comments."""
    text = block.text.replace("\\\n", " ")
    return [re.sub(r"\s+#.*$", "", line).strip() for line in text.splitlines() if line.strip()]


def first(table: dict[str, str], command: str) -> str | None:
    return next((value for part, value in table.items() if re.search(part, command)), None)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    """The checkout's files under another folder, with outputs of its own: a small `out/demo`."""
    folder = tmp_path_factory.mktemp("checkout")
    for path in ROOT.iterdir():
        if path.name not in ("out", ".git", ".venv", "data", "data10"):
            (folder / path.name).symlink_to(path)
    run(
        f"python pipeline.py build --config configs/open.yaml --output out/demo {PEOPLE} {VIEWS}",
        folder,
    )
    (folder / "out" / "people").symlink_to("demo")
    return folder


def run(command: str, folder: Path) -> None:
    words = shlex.split(command)
    assert words[0] == "python", command
    done = subprocess.run(
        [sys.executable, *words[1:]], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-1000:]}\n{done.stderr[-3000:]}"


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_says_works(page: str, checkout: Path) -> None:
    python: list[str] = []
    for block in blocks(page):
        where = f"{page} line {block.line}"
        if block.language == "python":
            ast.parse(block.text, where)
            python.append(block.text)
        elif block.language == "yaml":
            assert list(yaml.safe_load_all(block.text)), where
        elif block.language == "sh":
            for command in commands(block):
                follow(command, checkout)
        else:
            assert block.language in ("json", ""), where
    if page.startswith(("docs/scaling", "docs/scans")):
        return  # SLURM's and the licensed scans' are compiled only
    # A page's blocks follow each other, as they are read.
    run_python("\n".join(python).replace("SUBJECT", "open_0000"), checkout)


def follow(command: str, checkout: Path) -> None:
    """Do what a command's kind asks for."""
    if first(READ, command) is not None and command.startswith("python pipeline.py"):
        if re.search(r"pipeline\.py (build|train) ", command):
            run(f"{command} --print_config", checkout)
    elif first(SHOWN, command) is None:
        less = first(LESS, command)
        run(f"{command} {less}" if less else command, checkout)


def run_python(text: str, checkout: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=checkout, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{text}\n{done.stderr[-2000:]}"


def test_every_command_is_followed() -> None:
    """A new kind of command is not passed over in silence."""
    seen = [
        c
        for page in PAGES
        for block in blocks(page)
        if block.language == "sh"
        for c in commands(block)
    ]
    assert len(seen) > 60
    strange = [
        c
        for c in seen
        if not c.startswith("python ") and first(SHOWN, c) is None and first(READ, c) is None
    ]
    assert strange == []


def test_every_link_leads_somewhere() -> None:
    """To a file that is there, and to a heading that is in it."""
    broken = []
    for page in PAGES:
        text = (ROOT / page).read_text()
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if re.match(r"https?://", target):
                continue
            path, _, heading = target.partition("#")
            file = (ROOT / page).parent / path if path else ROOT / page
            if not file.exists() or (heading and heading not in headings(file.read_text())):
                broken.append(f"{page}: {target}")
    assert broken == []


def headings(text: str) -> set[str]:
    """As GitHub names them."""
    found = re.findall(r"(?m)^#+ (.+)$", text)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in found}
