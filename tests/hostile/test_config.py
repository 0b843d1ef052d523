"""Hostile configurations: status 2, one line, and nothing runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from engine.configfile import check_config
from tests.hostile.corpus import CANARY

ROOT = Path(__file__).parents[2]

LAUGHS = "".join(
    f"{name}: &{name} [{', '.join([f'*{before}' if before else 'ha'] * 9)}]\n"
    for before, name in zip(["", *"abcdefgh"], "abcdefghi", strict=True)
)
"""A billion laughs in nine lines."""

CONFIGS: dict[str, tuple[str | bytes, str]] = {
    "a tag that runs": (f"seed: !!python/object/apply:os.mkdir ['{CANARY}']\n", "tag"),
    "a tag that imports": ("seed: !!python/module:antigravity\n", "tag"),
    "a tag that makes": ("seed: !!python/object/new:os.system [ls]\n", "tag"),
    "a class of another module": ("subjects: {class_path: subprocess.Popen}\n", "Popen"),
    "truncated": ("views: {count: [\n", "hostile.yaml"),
    "flipped": ("views: {count: 2\x02}\n", "hostile.yaml"),
    "a list": ("[1, 2]\n", "hostile.yaml"),
    "no text": (b"seed: 5\n\xff\xfe\n", "UTF-8"),
    "zeros": (bytes(100), "hostile.yaml"),
    "a billion laughs": (LAUGHS, "values"),
    "a billion laughs in their place": (f"{LAUGHS}views: {{yaw_deg: *i}}\n", "values"),
    "an alias of itself": ("seed: &s [*s]\n", "within itself"),
    "deep": (f"seed: {'[' * 20_000}{']' * 20_000}\n", "levels"),
    "a number of many digits": (f"seed: {'9' * 10_000}\n", "digits"),
    "large": (f"seed: '{'9' * 2**18}'\n", "bytes"),
    "not a number": ("views: {yaw_deg: [.nan]}\n", "yaw_deg"),
    "infinite": ("camera: {distance: .inf}\n", "camera.distance"),
    "absurd": ("camera: {rows: 1000000000000}\n", "camera.rows"),
    "a pattern that climbs": (
        "subjects: {class_path: Scans, init_args: {root: ., up: z, front: x, unit: m, "
        "pattern: ../**/*}}\n",
        "subjects.pattern",
    ),
}
"""What a file holds, and a word of what is said."""


@pytest.mark.parametrize("kind", CONFIGS)
def test_status_two_in_one_line(tmp_path: Path, kind: str) -> None:
    content, word = CONFIGS[kind]
    path = tmp_path / "hostile.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    result = subprocess.run(
        [sys.executable, ROOT / "pipeline.py", "build", "--config", path, "--output", "data"],
        cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert result.returncode == 2, result.stderr[-2000:]
    assert len(result.stderr.splitlines()) == 1, result.stderr[-2000:]
    assert len(result.stderr) < 2000
    assert word in result.stderr
    assert [entry.name for entry in tmp_path.iterdir()] == ["hostile.yaml"]


@pytest.mark.parametrize("path", sorted((ROOT / "configs").rglob("*.yaml")), ids=lambda p: p.stem)
def test_those_of_the_house_pass(path: Path) -> None:
    check_config(path)


def test_an_alias_that_repeats_little_passes(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    path.write_text("a: &x [1, 2]\nb: *x\nc: [*x, *x]\n")
    check_config(path)
