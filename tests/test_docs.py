"""Every block of README and docs: commands and code are run as they stand, or on less of it, and
print what the pages say that they print.

They run in a copy of the checkout with a small dataset at `out/demo`, in the order of the page. A
block under `<!-- needs: ... -->`, or on a page with `<!-- all needs: ... -->`, asks for what is not
here: its code is compiled, and its commands' options are read. So are those of commands in a line.
"""

from __future__ import annotations

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path

import pytest
import trimesh
import yaml
from markdown_it import MarkdownIt
from markdown_it.token import Token

from augment.color_camera import ColorCamera
from engine.config import CHOICES
from storage.cache import cache_folder
from tests.store import s3_server
from trainer.networks.discriminator import DiscriminatorConfig

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(p.relative_to(ROOT).as_posix() for p in ROOT.glob("docs/**/*.md")))

AFTER = {"docs/surfaces.md": "README.md"}
"""Pages that go on where another one ends."""

NEEDS = {
    *("licensed scans", "fitted bodies", "a capture of your own"),
    *("a cluster", "a GPU", "half an hour"),
}
"""What is not here."""

PEOPLE = "--subjects.count 2 --subjects.cloth laid --subjects.texture_size 256"
VIEWS = "--views.count 4 --cycles.samples 2"
STUDY = "--front_epochs 1 --back_epochs 1 --seeds '[0]' --views '[0]' --samples 1000"
LESS = {
    r"build .*configs/open\.yaml": f"{PEOPLE} {VIEWS}",
    r"build .*configs/(scans|glb)\.yaml": VIEWS,
    r"build .*new_source\.yaml": "--subjects.count 2 --cycles.samples 2",
    r"sweep .*light_sweep\.yaml": "--powers '[2000, 100]'",
    r"train .*_(front|back)_cpu": "--epochs 1 --workers 0 --batch 2",
    r"experiment ": f"--data out/demo {STUDY}",
}
"""What a command is made smaller with: a part of it -> options that are added."""

PUT_IN = {"DIR": "out/demo", "FOLDER": "out", "ADDRESS": "tcp://127.0.0.1:1", "NAME": "fig2"}
"""What the reader puts in, and what is put in here."""

ELSEWHERE = {
    "pip": "installs",
    "dask": "serves",
    "tensorboard": "serves",
    ".": "of the shell",
    "for": "of the shell",
}
"""Commands that are no command of the project's, and what they do instead."""

PROGRAMS = {"python", "torchrun", "make", *ELSEWHERE}

PARSE = """
import argparse, os, runpy, sys
import jsonargparse

kinds = (argparse.ArgumentParser, jsonargparse.ArgumentParser)
known = [kind.parse_args for kind in kinds]

def parse_args(self, *given, **named):
    for kind, parse in zip(kinds, known):
        kind.parse_args = parse
    try:
        self.parse_args(*given, **named)
    except SystemExit as ended:  # --help is well, an option that is unknown is not
        os._exit(ended.code or 0)
    except Exception as error:
        sys.stderr.write(f"{error}\\n")
        os._exit(2)
    os._exit(0)

for kind in kinds:
    kind.parse_args = parse_args
if sys.argv[1] == "-m":
    del sys.argv[:2]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
else:
    del sys.argv[0]
    runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""A Python command that ends as soon as its options are read, well if they are known."""


@dataclass
class Block:
    """A block of a page.

    Attributes:
        line: of its beginning.
        language: "sh", "python" or "yaml"; of a command in a line, "line".
        needs: what it needs that is not here.
        prints: what it prints, as the page says after it.
    """

    line: int
    language: str
    text: str
    needs: str | None = None
    prints: str | None = None

    def commands(self) -> list[str]:
        """Whole command lines, without their comments."""
        text = self.text.replace("\\\n", " ")
        return [re.sub(r"\s+#.*$", "", line).strip() for line in text.splitlines() if line.strip()]


@dataclass
class Reader:
    """What a page's tokens become, one after the other."""

    page: str
    blocks: list[Block] = field(default_factory=list)
    mark: str | None = None
    """What the comment says that stands before the next block."""
    always: str | None = None
    last: Block | None = None
    """The block that ended just now: an output may follow it."""

    def take(self, token: Token) -> None:
        line = (token.map or [0])[0] + 1
        where = f"{self.page} line {line}"
        if token.type == "html_block":
            self.comment(token.content, where)
        elif token.type in ("fence", "code_block"):
            self.block(line, token, where)
        elif token.type == "inline":
            assert self.mark is None, f"{where}: a mark stands before words, not before a block"
            self.last = None
            for one in token.children or []:
                if one.type == "code_inline" and is_command(one.content):
                    self.blocks.append(Block(line, "line", one.content))

    def comment(self, text: str, where: str) -> None:
        said = re.fullmatch(r"<!-- (?:(all )?needs: (.+)|figure) -->\s*", text)
        assert said is not None, f"{where}: what is {text!r}?"
        assert said[2] is None or said[2] in NEEDS, f"{where}: {said[2]} is no need"
        if said[1]:
            self.always = said[2]
        else:
            self.mark = said[2] or "figure"

    def block(self, line: int, token: Token, where: str) -> None:
        language = token.info.strip() if token.type == "fence" else "sh"
        mark, self.mark = self.mark, None
        if mark == "figure":
            assert language == "sh", f"{where}: a figure with a language"
            self.last = None
        elif language == "text":
            assert self.last is not None, f"{where}: an output of nothing"
            assert self.last.needs is None, f"{where}: an output that nobody has seen"
            self.last.prints = token.content
            self.last = None
        else:
            assert language in ("sh", "python", "yaml"), f"{where}: {language!r} is no language"
            self.last = Block(line, language, token.content.rstrip(), mark or self.always)
            self.blocks.append(self.last)


@cache
def blocks(page: str) -> list[Block]:
    return read(page, (ROOT / page).read_text())


def read(page: str, text: str) -> list[Block]:
    """All blocks, and the commands that stand in lines, in order."""
    reader = Reader(page)
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        reader.take(token)
    assert reader.mark is None, f"{page}: a mark of nothing"
    return reader.blocks


def is_command(text: str) -> bool:
    return re.match(rf"(\w+=\S+ )?({'|'.join(map(re.escape, PROGRAMS))}) .", text) is not None


def parts() -> set[str]:
    """The names at the top of the checkout: what a reader has made there is no part of it."""
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode == 0:
        return {line.partition("/")[0] for line in listed.stdout.splitlines()}
    # An archive of the checkout: nobody has made anything there but by the README.
    made = {"out", "data", "data10", "mine", "thuman", "front", "people", "scans", ".venv"}
    return {path.name for path in ROOT.iterdir()} - made


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Iterator[Path]:
    """The checkout's files under another folder, with outputs of its own: a small `out/demo`, and
    its people as scans; and an S3 server for those who ask it."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in parts():
        (folder / name).symlink_to(ROOT / name)
    # Copies of what lies in the store are of this run alone; the body model is everyone's.
    own = tmp_path_factory.mktemp("cache")
    (own / "rectoverso").mkdir()
    with pytest.MonkeyPatch.context() as patch, s3_server() as variables:
        build = "python pipeline.py build --config configs/open.yaml --output out/demo"
        run(f"{build} {PEOPLE} {VIEWS}", folder)
        for kept in filter(Path.is_dir, cache_folder().glob("anny-*")):
            (own / "rectoverso" / kept.name).symlink_to(kept)
        for name, value in (variables | {"XDG_CACHE_HOME": str(own)}).items():
            patch.setenv(name, value)
        (folder / "people").mkdir()
        for subject in (folder / "out" / "demo" / "subjects").iterdir():
            if not subject.is_dir():
                continue
            scan = folder / "scans" / subject.name
            scan.mkdir(parents=True)
            for file in (f"{subject.name}.obj", "material0.mtl", "material0.jpeg"):
                shutil.copy(subject / file, scan / file)
            loaded = trimesh.load_mesh(scan / f"{subject.name}.obj", process=False)
            loaded.export(folder / "people" / f"{subject.name}.glb")
        yield folder


@pytest.fixture(scope="module")
def done() -> set[str]:
    """Pages that were followed."""
    return set()


def start(*words: str, folder: Path, **variables: str) -> tuple[str, str]:
    """What a Python command prints and tells that ends well."""
    environment = {**os.environ, "PYTHONPATH": str(folder), **variables}
    ended = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    said = f"{shlex.join(words)}\n{ended.stdout[-1000:]}\n{ended.stderr[-3000:]}"
    assert ended.returncode == 0, said
    return ended.stdout, ended.stderr


def words_of(command: str) -> tuple[dict[str, str], list[str]]:
    """The variables before a command, and its words with what a reader puts in."""
    variables, words = {}, [PUT_IN.get(word, word) for word in shlex.split(command)]
    while "=" in words[0]:
        name, _, value = words.pop(0).partition("=")
        variables[name] = value
    return variables, words


def run(command: str, folder: Path) -> str:
    """What a command prints that ends well, made smaller as `LESS` says."""
    less = next((more for part, more in LESS.items() if re.search(part, command)), "")
    variables, words = words_of(f"{command} {less}")
    assert words[0] == "python", command
    printed, told = start(*words[1:], folder=folder, **variables)
    assert "epochs stand already" not in told, f"{command}: a page before has trained it"
    return printed


def read_options(command: str, folder: Path) -> None:
    """A command's options are such that it has."""
    _, words = words_of(command)
    if words[0] == "torchrun":
        words = ["python", *words[words.index("pipeline.py") :]]
    if words[0] != "python":
        return
    if words[1].startswith("examples/"):
        assert (ROOT / words[1]).is_file()
        return
    start("-c", PARSE, *words[1:], folder=folder)


@pytest.mark.parametrize(
    ("command", "what"),
    [
        ("pipeline.py train --data a --output b --nonsense 3", "nonsense"),
        ("pipeline.py train --data a --output b --epochs many", "epochs"),
        ("pipeline.py build --output b --sensor Nope", "Nope"),
        ("pipeline.py train --config configs/nope.yaml --data a --output b", "nope.yaml"),
        ("pipeline.py experiment nope --output b", "nope"),
        ("pipeline.py verify", "data"),
        ("-m report.sensors out/demo", "--output"),
    ],
)
def test_wrong_options_are_seen(command: str, what: str, checkout: Path) -> None:
    with pytest.raises(AssertionError, match=what):
        read_options(f"python {command}", checkout)


OPTION = re.compile(r"(?<![\w-])--([a-z_][\w.-]*)")


def test_every_option_is_one(checkout: Path) -> None:
    """Those that stand in lines and tables: some command of the project has it."""
    modules = {
        words[words.index("-m") + 1]
        for page in PAGES
        for block in blocks(page)
        for command in block.commands()
        if "-m" in (words := shlex.split(command)) and block.language != "yaml"
        if re.match(r"(\w+=\S+ )?python -m (report|benchmarks|examples)", command)
    }
    calls = [("-m", module, "--help") for module in sorted(modules)]
    stages = ("build", "verify", "sweep", "train", "reconstruct", "evaluate", "experiment")
    calls += [("pipeline.py", stage, "--help") for stage in (*stages, "report")]
    for key, kinds in CHOICES.items():
        calls += [("pipeline.py", "build", f"--{key}.help", kind.__name__) for kind in kinds]
    calls += [("pipeline.py", "train", "--branch.help", kind) for kind in ("Front", "Back")]
    listed = "".join(start(*words, folder=checkout)[0] for words in calls)
    known = set(OPTION.findall(listed)) | {"help", "saveParam"}  # the last is PIXIE's
    # What may be null is listed without what is in it.
    for prefix, kind in {
        "color_camera": ColorCamera,
        "branch.normal_gan": DiscriminatorConfig,
    }.items():
        known |= {f"{prefix}.{one.name}" for one in fields(kind)}
    strange = []
    for page in PAGES:
        for token in MarkdownIt("commonmark").enable("table").parse((ROOT / page).read_text()):
            for one in token.children or []:
                if one.type == "code_inline" and not one.content.startswith(FOREIGN):
                    strange += [
                        f"{page}: --{name}"
                        for name in OPTION.findall(one.content)
                        if not any(f"{has}.".startswith(f"{name}.") for has in known)
                    ]
    assert strange == []


FOREIGN = ("dask ", "pip ", "apt-get ")
"""Other programs' options are theirs."""


def test_every_extra_is_one() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = "".join((ROOT / page).read_text() for page in PAGES)
    named = {name for group in re.findall(r"'\.\[([\w,]+)\]'", text) for name in group.split(",")}
    assert named
    assert named <= set(project["optional-dependencies"])


def made(target: str) -> list[str]:
    """The Python commands of a target of the Makefile, but for those that install."""
    listed = subprocess.run(
        ["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert listed.returncode == 0, listed.stderr
    lines = listed.stdout.replace("\\\n", " ").splitlines()
    ours = [line.replace(".venv/bin/", "") for line in lines if line.startswith(".venv/bin/python")]
    return [line for line in ours if not re.search(r"-m (pip|pytest)\b", line)]


def follow(command: str, needs: str | None, checkout: Path) -> str:
    """Do what a command's kind asks for; returns what it prints."""
    _, words = words_of(command)
    if words[0] in ELSEWHERE:
        return ""
    if words[0] == "make":
        for line in made(words[1]):
            if words[1] == "demo" and needs is None:
                run(line, checkout)
            else:
                read_options(line, checkout)
        return ""
    if needs is None:
        return run(command, checkout)
    read_options(command, checkout)
    return ""


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_says_works(page: str, checkout: Path, done: set[str]) -> None:
    if page in AFTER and AFTER[page] not in done:
        follow_page(AFTER[page], checkout)
    follow_page(page, checkout)
    done.add(page)


def follow_page(page: str, checkout: Path) -> None:
    code: list[str] = []
    for block in blocks(page):
        where, printed = f"{page} line {block.line}", ""
        if block.language == "sh":
            for command in block.commands():
                printed += follow(command, block.needs, checkout)
        elif block.language == "line":
            follow(block.text, "what the page is not about", checkout)
        elif block.language == "yaml":
            assert list(yaml.safe_load_all(block.text)), where
        else:
            ast.parse(block.text, where)
            if block.needs is None:
                # A page's blocks follow each other, as they are read; the last one's words count.
                code += [f"print({where!r})", block.text.replace("SUBJECT", "open_0000")]
                said, _ = start("-c", "\n".join(code), folder=checkout)
                printed = said.partition(f"{where}\n")[2]
        if block.prints is not None:
            assert matches(block.prints, printed), f"{where} prints\n{printed}\nnot\n{block.prints}"


NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\d.]*\w)|(?<=_)\d{4}(?=\D|$)")
CLOSE = 2.5
FREE = re.compile(r" ?(s|s per view|shards|made|meshes|powers|subjects|views|datasets|epochs)\b")
"""What a whole dataset has more of than a small one, or takes longer for."""


def matches(stated: str, printed: str) -> bool:
    """Whether lines are those that are stated, "..." being any.

    The pages state what whole datasets give; here are smaller ones. So the words are the same, and
    numbers are of the same size: within a factor of `CLOSE`, and 0 if 0 is stated. Counts that
    follow the dataset's size, seconds, and the numbers of ids are what they are.
    """

    def agree(said: list[str], seen: list[str]) -> bool:
        if not said:
            return not seen
        if said[0] == "...":
            return any(agree(said[1:], seen[k:]) for k in range(len(seen) + 1))
        return bool(seen) and alike(said[0], seen[0]) and agree(said[1:], seen[1:])

    return agree(stated.splitlines(), printed.splitlines())


def alike(stated: str, printed: str) -> bool:
    if [" ".join(part.split()) for part in NUMBER.split(stated)] != [
        " ".join(part.split()) for part in NUMBER.split(printed)
    ]:
        return False
    for said, seen in zip(NUMBER.finditer(stated), NUMBER.finditer(printed), strict=True):
        is_id = said.start() > 0 and stated[said.start() - 1] == "_"
        if is_id or FREE.match(stated, said.end()):
            continue
        one, other = float(said[0]), float(seen[0])
        if one != other and not (one * other > 0 and 1 / CLOSE <= one / other <= CLOSE):
            return False
    return True


def test_what_is_stated_is_compared() -> None:
    said = "out/a.png\n  a_0001   1  2.5 %\n  b   2  3.5\n10 shards in 5 s; 0 set aside\nsound\n"
    rest = "10 shards in 5 s; 0 set aside\nsound"
    assert matches(f"out/a.png\na_0003 1 3.0 %\nb 2 2.5\n{rest}", said)
    assert matches(f"out/a.png\n...\n{rest}", said)
    assert matches("...\n9 shards in 50 s; 0 set aside\n...", said)
    for wrong in (
        "out/a.png",
        f"out/b.png\n...\n{rest}",
        "...\nunsound",
        f"out/a.png\na_0003 1 -2.5 %\n...\n{rest}",
        f"out/a.png\na_0003 1 9.0 %\n...\n{rest}",
        f"out/a.png\nb_0003 1 2.5 %\n...\n{rest}",
        "...\n9 shards in 50 s; 1 set aside\n...",
    ):
        assert not matches(wrong, said), wrong
    assert not matches("0.163 m thick", "-99 m thick")
    assert sum(block.prints is not None for page in PAGES for block in blocks(page)) > 10


def test_nothing_is_passed_over() -> None:
    """Whatever way a block is written; and what is none is told."""
    for text, expected in {
        "~~~python\na = 1\n~~~\n": ["python"],
        "\tpython x\n": ["sh"],
        "> words\n>\n>     python x\n": ["sh"],
        "- words\n\n      python x\n": ["sh"],
        "    shard = nonsense()\n": ["sh"],
        "run `python -m a`, then `b`.\n": ["line"],
        "| a |\n|---|\n| `make b` |\n": ["line"],
        "<!-- figure -->\n\n    a = b\n": [],
    }.items():
        assert [block.language for block in read("page", text)] == expected, text
    for text in (
        "<pre>python x</pre>\n",
        "<!-- needs: luck -->\n\n    python x\n",
        "<!-- needs: a GPU -->\n\nwords\n\n    python x\n",
        "```\npython x\n```\n",
        "```text\nsound\n```\n",
        "<!-- needs: a GPU -->\n\n    python x\n\n```text\nsound\n```\n",
    ):
        with pytest.raises(AssertionError):
            read("page", text)


def test_every_command_is_followed() -> None:
    """A new kind of command is not passed over in silence."""
    seen = [c for page in PAGES for b in blocks(page) if b.language == "sh" for c in b.commands()]
    assert len(seen) > 60
    assert [command for command in seen if not is_command(command)] == []


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
