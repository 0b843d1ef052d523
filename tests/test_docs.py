"""Every block of README and docs: commands and code are run as they stand, or on less of it, and
print what the pages say that they print.

They run in a copy of the checkout with a small dataset at `out/demo`, in the order of the page. A
block under `<!-- needs: ... -->`, or on a page with `<!-- all needs: ... -->`, asks for what is not
here: its code is compiled, its commands' options are read, and nothing is known of its output.
"""

from __future__ import annotations

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from textwrap import dedent

import pytest
import trimesh
import yaml

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(p.relative_to(ROOT).as_posix() for p in ROOT.glob("docs/**/*.md")))

PEOPLE = "--subjects.count 2 --subjects.cloth laid --subjects.texture_size 256"
VIEWS = "--views.count 4 --cycles.samples 2"
LESS = {
    r"build .*configs/open\.yaml": f"{PEOPLE} {VIEWS}",
    r"build .*configs/(scans|glb)\.yaml": VIEWS,
    r"build .*new_source\.yaml": "--subjects.count 2 --cycles.samples 2",
    r"sweep .*light_sweep\.yaml": "--powers '[2000, 100]'",
    r"train .*_front_cpu": "--epochs 1 --workers 0 --batch 2",
    r"train .*_back_cpu": "--epochs 1 --workers 0 --batch 2",
}
"""What a command is made smaller with: a part of it -> options that are added."""

COMMANDS = re.compile(r"(\w+=\S+ )?(python|pip|make|dask|tensorboard|torchrun|for|\.) ")
ELSEWHERE = {"pip": "installs", "dask": "serves", "tensorboard": "serves", ".": "of the shell"}
"""Commands that are no command of the project's, and what they do instead."""

FIGURE = re.compile(r"^[\w.]+/$|^[\w.()]+ +=|^[\w_]+ \* ")
"""An indented block that is no command: a folder's tree, or a formula."""

ABSENT = r"holds no dataset\.json|No such file|is not there|does not exist"
"""What commands say of data that are not here."""


@dataclass
class Block:
    """A block of a page: its language, its first line's number, its text, what it needs that is
    not here, and what it prints, which the text block after it says."""

    language: str
    line: int
    text: str
    needs: str | None = None
    prints: str | None = None

    def commands(self) -> list[str]:
        """Whole command lines, without their comments."""
        text = self.text.replace("\\\n", " ")
        return [re.sub(r"\s+#.*$", "", line).strip() for line in text.splitlines() if line.strip()]


def blocks(page: str) -> list[Block]:
    """The fenced and the indented blocks, in order."""
    found: list[Block] = []
    needs: str | None = None
    always = None
    for line, language, text in raw(page):
        if language == "needs":
            needs = text
        elif language == "all needs":
            always = text
        elif language == "text":
            assert found, f"{page} line {line}: an output of nothing"
            found[-1].prints = text
        else:
            if language == "" and COMMANDS.match(text):
                language = "sh"
            if language or not FIGURE.match(text.splitlines()[0]):
                found.append(Block(language, line, text, needs or always))
            needs = None
    return found


def raw(page: str) -> Iterator[tuple[int, str, str]]:
    """(first line's number, language, text) of blocks; "" of indented ones, "needs" and
    "all needs" (of the whole page) of marks."""
    lines = [*(ROOT / page).read_text().splitlines(), ""]
    fenced, indented = None, list[str]()
    for number, line in enumerate(lines, start=1):
        if fenced is not None:
            if line.strip() == "```":
                yield fenced[0], fenced[1], "\n".join(lines[fenced[0] : number - 1])
                fenced = None
            continue
        if line.startswith("    ") and (line.strip() or indented):
            indented.append(line[4:])
            continue
        if indented:
            yield number - len(indented), "", dedent("\n".join(indented)).strip()
            indented = []
        if fence := re.match(r"^ *```(\w+)$", line):
            fenced = number, fence[1]
        elif mark := re.match(r"^<!-- ((?:all )?needs): (.+) -->$", line):
            yield number, mark[1], mark[2]
        else:
            assert "```" not in line, f"{page} line {number}: a fence without a language"


def first(table: dict[str, str], command: str) -> str | None:
    return next((value for part, value in table.items() if re.search(part, command)), None)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    """The checkout's files under another folder, with outputs of its own: a small `out/demo`, and
    its people as scans."""
    folder = tmp_path_factory.mktemp("checkout")
    for path in ROOT.iterdir():
        if path.name not in ("out", ".git", ".venv", "data", "data10"):
            (folder / path.name).symlink_to(path)
    run(
        f"python pipeline.py build --config configs/open.yaml --output out/demo {PEOPLE} {VIEWS}",
        folder,
    )
    (folder / "out" / "people").symlink_to("demo")
    (folder / "people").mkdir()
    for subject in (folder / "out" / "demo" / "subjects").iterdir():
        scan = folder / "scans" / subject.name
        scan.mkdir(parents=True)
        for file in (f"{subject.name}.obj", "material0.mtl", "material0.jpeg"):
            shutil.copy(subject / file, scan / file)
        loaded = trimesh.load_mesh(scan / f"{subject.name}.obj", process=False)
        loaded.export(folder / "people" / f"{subject.name}.glb")
    return folder


def call(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command of Python's, with the variables that stand before it."""
    words = shlex.split(command)
    variables = {}
    while "=" in words[0]:
        name, _, value = words.pop(0).partition("=")
        variables[name] = value
    assert words[0] == "python", command
    return subprocess.run(
        [sys.executable, *words[1:]],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **variables},
    )


def run(command: str, folder: Path) -> str:
    """What a command prints that ends well."""
    done = call(command, folder)
    assert done.returncode == 0, f"{command}\n{done.stdout[-1000:]}\n{done.stderr[-3000:]}"
    return done.stdout


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_says_works(page: str, checkout: Path) -> None:
    code: list[str] = []
    for block in blocks(page):
        where = f"{page} line {block.line}"
        printed = ""
        if block.language == "sh":
            printed = "".join(
                follow(command, block.needs, checkout) for command in block.commands()
            )
        elif block.language == "python":
            ast.parse(block.text, where)
            if block.needs is None:
                # A page's blocks follow each other, as they are read; the last one's words count.
                mark = f"print({where!r})"
                code += [mark, block.text.replace("SUBJECT", "open_0000")]
                done = subprocess.run(
                    [sys.executable, "-c", "\n".join(code)],
                    cwd=checkout,
                    capture_output=True,
                    text=True,
                    check=False,
                )
                assert done.returncode == 0, f"{where}\n{done.stderr[-2000:]}"
                printed = done.stdout.partition(f"{where}\n")[2]
        elif block.language == "yaml":
            assert list(yaml.safe_load_all(block.text)), where
        else:
            raise AssertionError(f"{where}: neither command nor code nor figure:\n{block.text}")
        if block.prints is not None and block.needs is None:
            assert matches(block.prints, printed), f"{where} prints\n{printed}\nnot\n{block.prints}"


def follow(command: str, needs: str | None, checkout: Path) -> str:
    """Do what a command's kind asks for; returns what it prints."""
    program = re.sub(r"^\w+=\S+ ", "", command).split()[0]
    if program == "make":
        target = command.split()[1]
        done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, check=False)
        assert done.returncode == 0, command
        return ""
    if program in ELSEWHERE:
        return ""
    if needs is None:
        less = first(LESS, command)
        return run(f"{command} {less}" if less else command, checkout)
    if program != "python":
        return ""
    module = re.match(r"python -m ([\w.]+)", command)
    if module:
        assert find_spec(module[1]) is not None, command
    if re.search(r"pipeline\.py (build|sweep|train|reconstruct|evaluate|experiment) ", command):
        run(f"{command.replace(' NAME', ' table1')} --print_config", checkout)
    elif "://" not in command and needs == "licensed scans":
        # Its options are read before its data are looked for.
        done = call(command, checkout)
        assert done.returncode == 2, command
        assert re.search(ABSENT, done.stderr), f"{command}\n{done.stderr}"
    return ""


def matches(stated: str, printed: str) -> bool:
    """Whether lines are those that are stated: a number stands for any, "..." for any lines.

    The pages state what whole datasets give; here are smaller ones.
    """
    lines = [shape(line) for line in printed.splitlines()]
    pattern = "".join(
        r"(?:.*\n)*?" if line == "..." else f"{re.escape(shape(line))}\n"
        for line in stated.splitlines()
    )
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in lines)) is not None


def shape(line: str) -> str:
    """A line without its numbers' values and the width of its columns."""
    return " ".join(re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", line).split())


def test_every_command_is_followed() -> None:
    """A new kind of command is not passed over in silence."""
    seen = [c for page in PAGES for b in blocks(page) if b.language == "sh" for c in b.commands()]
    assert len(seen) > 60
    assert [c for c in seen if not COMMANDS.match(f"{c} ")] == []


def test_what_is_stated_is_compared() -> None:
    said = "out/a.png\n  a   1  2.5\n  b   2  3.5\n\nsound\n"
    assert matches("out/a.png\na 9 1.0\nb 9 0.2\n\nsound", said)
    assert matches("out/a.png\n...\n\nsound", said)
    assert not matches("out/a.png\n\nsound", said)
    assert not matches("out/a.png\n...\n\nunsound", said)
    assert not matches("out/a.png\na 9 x\nb 9 0.2\n\nsound", said)
    stated = [b for page in PAGES for b in blocks(page) if b.prints is not None]
    assert len(stated) > 5


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
