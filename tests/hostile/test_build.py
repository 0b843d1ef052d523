"""One real build over everything hostile: set aside, told why, and nothing else happens."""

from __future__ import annotations

import json
import os
import pickle  # noqa: TID251
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from tests.hostile import corpus
from tests.hostile.corpus import CANARY, SECRETS, SOUND, Case

ROOT = Path(__file__).parents[2]

MOST_MB = 1500
"""Memory of the largest process; Blender alone takes a third."""

ACCEPTED = {
    "naïve_日本.obj": "na_ve___",
    "-rf.obj": "-rf",
    "Twin.obj": "Twin",
    "twin.obj": "twin",
    "two  words.obj": "two__words",
    "$(touch canary);.obj": "__touch_canary__",
}
"""Sound scans in files of odd names, and the ids that they get."""

_MEASURED = """
import resource, subprocess, sys
status = subprocess.call(sys.argv[2:])
with open(sys.argv[1], "w") as file:
    file.write(str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))
sys.exit(status)
"""


@dataclass(frozen=True)
class Built:
    """A finished build: what it said, what it took, and what it changed."""

    cases: list[Case]
    accepted: set[str]
    watched: Path
    output: Path
    status: int
    stderr: str
    megabytes: float
    before: dict[str, tuple]
    after: dict[str, tuple]

    @property
    def reasons(self) -> dict[str, str]:
        """Subject -> why it was set aside."""
        lines = (self.output / "failures.jsonl").read_text().splitlines()
        return {failure["subject"]: failure["reason"] for failure in map(json.loads, lines)}


def run(watched: Path, *arguments: object) -> tuple[subprocess.CompletedProcess[str], float]:
    """The command line in the watched folder, home and temporary files too; and its megabytes."""
    environment = {
        **os.environ,
        "HOME": str(watched / "home"),
        "TMPDIR": str(watched / "temporary"),
        # Blender keeps notes of its own, whatever it is given.
        "BLENDER_USER_RESOURCES": str(watched.parent / "blender"),
        "XDG_CACHE_HOME": str(watched.parent / "blender"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    peak = watched.parent / f"{watched.name}.peak"
    command = [sys.executable, "-c", _MEASURED, peak, sys.executable, ROOT / "pipeline.py"]
    result = subprocess.run(
        [*map(str, command), *map(str, arguments)],
        cwd=watched, env=environment, capture_output=True, text=True, timeout=500, check=False,
    )  # fmt: skip
    return result, int(peak.read_text()) / 1024


def snapshot(folder: Path, but: Path) -> dict[str, tuple]:
    """Name -> kind, size and time of everything below `folder` that is not below `but`."""
    found = {}
    for parent, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if Path(parent, name) != but]
        for name in (*folders, *files):
            path = Path(parent, name)
            status = path.lstat()
            found[str(path)] = (status.st_mode, status.st_size, status.st_mtime_ns)
    # Temporary files come and go; what stays in there is seen.
    found.pop(str(folder / "temporary"))
    return found


def prepare(watched: Path, cases: list[Case], **subjects: object) -> None:
    """The scans' folder, its configuration, and what hostile names lead to."""
    for name in ("scans", "home", "temporary"):
        (watched / name).mkdir(parents=True)
    for case in cases:
        case.write(watched / "scans")
    for name in SECRETS:
        (watched / name).write_bytes(corpus.image("PNG") if ".png" in name else b"newmtl m\n" * 999)
    options = {
        "root": str(watched / "scans"),
        **{"up": "z", "front": "-y", "unit": "cm", "licence": "CC0-1.0"},
        "limits": {"fit_mb": 16, "triangles": 1_000_000},
        **subjects,
    }
    config = {
        "subjects": {"class_path": "Scans", "init_args": options},
        "views": {"count": 1},
        "cycles": {"samples": 1},
    }
    (watched / "config.yaml").write_text(yaml.safe_dump(config))


def build(watched: Path, cases: list[Case], accepted: set[str]) -> Built:
    """Build what `prepare` has made."""
    output = watched / "data"
    before = snapshot(watched, output)
    result, megabytes = run(watched, "build", "--config", "config.yaml", "--output", output)
    after = snapshot(watched, output)
    return Built(
        *(cases, accepted, watched, output, result.returncode, result.stderr, megabytes),
        *(before, after),
    )


def build_meshes(watched: Path) -> Built:
    """The hostile scans, and what lies among them without being any."""
    cases = corpus.meshes()
    prepare(watched, cases)
    scans = watched / "scans"
    for name in (f"{SOUND}.obj", *ACCEPTED):
        (scans / name).write_text(corpus.obj())
    (scans / ".hidden.obj").write_text("hidden")
    (scans / "folder.obj").mkdir()
    (scans / "here").symlink_to(".")
    (scans / "above").symlink_to("..")
    (scans / "ring").symlink_to("ring")
    return build(watched, cases, {SOUND, *ACCEPTED.values()})


def build_fits(watched: Path) -> Built:
    """Scans with hostile fits, and one with a sound one."""
    cases = corpus.fits()
    prepare(watched, cases, fits=corpus.FITS)
    corpus.sound_fit().write(watched / "scans")
    return build(watched, cases, {SOUND})


@pytest.fixture(scope="module", params=[build_meshes, build_fits], ids=["meshes", "fits"])
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    return request.param(tmp_path_factory.mktemp("hostile") / "watched")


def test_each_is_set_aside_with_its_reason(built: Built) -> None:
    assert built.status == 1, built.stderr
    assert built.reasons.keys() == {case.id for case in built.cases}
    reasons = built.reasons
    wrong = {case.id: reasons[case.id] for case in built.cases if case.word not in reasons[case.id]}
    assert wrong == {}
    assert [reason for reason in reasons.values() if not reason.isprintable()] == []


def test_nothing_is_taken_for_a_fault_of_the_program(built: Built) -> None:
    assert "Traceback" not in built.stderr
    assert "fault of the program" not in built.stderr
    assert "\x1b[31m" not in built.stderr
    assert built.megabytes < MOST_MB


def test_the_sound_ones_alone_have_shards(built: Built) -> None:
    shards = {path.name for path in (built.output / "shards").iterdir()}
    assert shards == {f"{subject}.npz" for subject in built.accepted}
    proof, _ = run(built.watched, "verify", built.output)
    assert proof.returncode == 0, proof.stdout + proof.stderr


def test_nothing_ran_and_nothing_outside_the_output_changed(built: Built) -> None:
    assert built.after == built.before
    assert not list(built.output.rglob(f"*{CANARY}"))


@pytest.mark.parametrize("names", [("a/b.obj", "a_b.obj"), ("太郎.obj", "花子.obj")])
def test_two_scans_of_one_id_are_named_before_anything_is_built(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    watched = tmp_path / "watched"
    prepare(watched, [])
    for name in names:
        (watched / "scans" / name).parent.mkdir(exist_ok=True)
        (watched / "scans" / name).write_text(corpus.obj())
    result, _ = run(watched, "build", "--config", "config.yaml", "--output", "data")
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert all(name in result.stderr for name in names)
    assert not (watched / "data").exists()


def test_the_payloads_are_armed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cases = {case.id: case for case in corpus.fits()}
    for name in ("pickle_calls_mkdir", "pickle_calls_system", "pickle_calls_in_text"):
        cases[name].write(tmp_path)
        pickle.loads((tmp_path / name / "fit.pkl").read_bytes())
        canary = tmp_path / CANARY
        assert canary.exists(), name
        canary.rmdir() if canary.is_dir() else canary.unlink()
