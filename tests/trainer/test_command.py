"""The command as a user gives it: every configuration, real trainings in processes of their own."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from benchmarks import branches
from trainer import checkpoint
from trainer.branch import Back
from trainer.networks.vgg import VGG19
from trainer.record import from_record

ROOT = Path(__file__).parents[2]
FRONT, BACK = (ROOT / "configs" / f"train_{name}_cpu.yaml" for name in ("front", "back"))
TINY = {
    "front": ("--branch.net.width", "8"),
    "back": ("--branch.generator.width", "8", "--branch.discriminator.width", "8"),
}


JUDGED = ("--branch.normal_gan", '{"width": 8}')


def command(*arguments: object) -> list[str]:
    return [sys.executable, str(ROOT / "pipeline.py"), "train", *map(str, arguments)]


def train(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=300, check=False
    )


def tiny(data: Path, output: Path, name: str = "front", epochs: int = 1) -> list[object]:
    """Arguments of a training of seconds."""
    size = "[64, 48]"
    return [
        *("--config", FRONT if name == "front" else BACK, *TINY[name]),
        *("--data", data, "--output", output, "--workers", 1),
        *("--views.size", size, "--epochs", epochs, "--batch", 4),
    ]


@pytest.mark.parametrize("name", ["front", "back"])
def test_it_trains_shows_and_keeps_what_it_says(data: Path, tmp_path: Path, name: str) -> None:
    run = tmp_path / "run"
    done = train(*tiny(data, run, name, epochs=2))
    assert done.returncode == 0, done.stderr
    assert f"{name}: 8 views of 4 subjects to learn from, 2 of 1 to test" in done.stderr
    assert "no vgg file: the VGG19 term (Eq. 9) is off" in done.stderr
    assert "epoch 2/2: test depth off by " in done.stderr
    assert re.search(r"% of it waiting for data, and \d+ s to test; 0 s left$", done.stderr, re.M)
    figures = [json.loads(line) for line in (run / "history.jsonl").read_text().splitlines()]
    assert len(figures) == 2
    assert f"test depth off by {figures[1]['depth_mm']:.2f} mm of " in done.stdout
    found = checkpoint.load(run / "checkpoint.pt")
    assert found.metrics == figures
    assert found.config["vgg"] is None
    assert from_record(found.config["branch"]).name == name
    assert len(found.data["shards_sha256"]) == 64
    assert {path.name for path in run.iterdir()} == {
        *("checkpoint.pt", "history.jsonl", "tensorboard", "test.png", ".lock")
    }
    board = EventAccumulator(str(run / "tensorboard"))
    board.Reload()
    for tag in ("loss/depth", "depth/mm", "normal/deg", "waiting"):
        values = [event.value for event in board.Scalars(tag)]
        assert values == pytest.approx([of[tag.replace("/", "_")] for of in figures], rel=1e-5)
    assert [event.step for event in board.Images("test")] == [0, 1]
    with Image.open(run / "test.png") as image:
        shown = np.asarray(image)
    rows, columns = shown.shape[0] // 2, shown.shape[1] // 7
    assert shown.shape == (2 * rows, 7 * columns, 3)
    assert 40 < rows <= 64
    assert 20 < columns <= 48
    assert shown.std() > 10
    again = train(*tiny(data, run, name, epochs=2))
    assert again.returncode == 0
    assert again.stdout == done.stdout
    assert "2 of 2 epochs stand already" in again.stderr
    assert "epoch 1/2" not in again.stderr


def test_a_branch_is_compared_with_tuned_filters_and_shown(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = {name: tmp_path / name / "checkpoint.pt" for name in TINY}
    for name, path in made.items():
        assert train(*tiny(data, path.parent, name)).returncode == 0

    def compare(*given: object) -> list[str]:
        monkeypatch.setattr(sys, "argv", ["branches", str(data), *map(str, given)])
        branches.main()
        return capsys.readouterr().out.splitlines()

    # Ellipsoids of 50 pixels bear more smoothing than people do.
    monkeypatch.setattr(branches, "MEDIANS", [branches.Median(size) for size in (1, 3, 7, 31)])
    monkeypatch.setattr(
        branches,
        "BILATERALS",
        [branches.Bilateral(s, r) for s in (0.1, 1.0, 30.0) for r in (1e-4, 0.1, 1.0, 50.0)],
    )
    picture = tmp_path / "both.png"
    said = compare("--front", made["front"], "--back", made["back"], "--picture", picture)
    assert said[0] == "2 views of 1 test subjects"
    for name, side in (("front", "sensor"), ("back", "body")):
        figures = checkpoint.load(made[name]).metrics[-1]
        given = next(line.split() for line in said if line.startswith(f"the {side}"))
        found = next(line.split() for line in said if line.startswith(f"the {name} branch"))
        assert float(given[2]) == pytest.approx(figures["given_mm"], abs=1e-3)
        assert float(found[3]) == pytest.approx(figures["depth_mm"], abs=1e-3)
        assert float(found[5]) == pytest.approx(figures["normal_deg"], abs=1e-2)
    with Image.open(picture) as image:
        assert image.width % 7 == 0
        assert np.asarray(image).std() > 10
    for wrong in (("--front", made["back"]), ("--picture", picture)):
        with pytest.raises(SystemExit):
            compare(*wrong)


def test_an_interrupted_training_goes_on_to_the_same_bits(data: Path, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    one_thread = {"OMP_NUM_THREADS": "1"}
    arguments = [tiny(data, folder, epochs=6) for folder in (whole, parts)]

    def start(given: list[object]) -> subprocess.Popen[str]:
        return subprocess.Popen(
            command(*given), stderr=subprocess.PIPE, text=True, env={**os.environ, **one_thread}
        )

    assert start(arguments[0]).wait(300) == 0
    codes = []
    for end in (signal.SIGINT, signal.SIGKILL):
        process = start(arguments[1])
        before = _epochs(parts)
        deadline = time.monotonic() + 200
        while _epochs(parts) == before and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(end)
        said = process.communicate(timeout=60)[1]
        codes.append(process.returncode)
        assert "Traceback" not in said
    assert codes[0] == 130
    assert start(arguments[1]).wait(300) == 0
    first, second = (checkpoint.load(run / "checkpoint.pt").state for run in (whole, parts))
    assert set(first) == set(second) == {"generator", "generator_adam"}
    for key, value in first["generator"].items():
        assert torch.equal(value, second["generator"][key]), key
    ours, theirs = (state["generator_adam"]["state"] for state in (first, second))
    assert set(ours) == set(theirs)
    for number, moments in ours.items():
        assert moments["step"] == 6 * 2
        assert all(torch.equal(value, theirs[number][key]) for key, value in moments.items())


def test_ctrl_c_in_a_terminal_leaves_no_process_and_says_little(data: Path, tmp_path: Path) -> None:
    """A terminal sends it to the loader's workers too."""
    run = tmp_path / "run"
    arguments = tiny(data, run, epochs=500)
    arguments[arguments.index("--workers") + 1] = 2
    process = subprocess.Popen(
        command(*arguments), stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + 200
    while _epochs(run) < 3:  # an epoch is told before it is kept
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "Exception" not in said
    deadline = time.monotonic() + 10
    while _is_there(process.pid):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert len(checkpoint.load(run / "checkpoint.pt").metrics) >= 2


def _is_there(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def _epochs(run: Path) -> int:
    history = run / "history.jsonl"
    return len(history.read_text().splitlines()) if history.exists() else 0


def test_vgg_weights_are_used_and_known_by_their_bytes(data: Path, tmp_path: Path) -> None:
    torch.manual_seed(0)
    for name in ("one", "two"):
        torch.save(VGG19().state_dict(), tmp_path / f"{name}.pth")
    given = tiny(data, tmp_path / "run", epochs=1)
    done = train(*given, "--vgg", tmp_path / "one.pth")
    assert done.returncode == 0, done.stderr
    assert "Eq. 9" not in done.stderr
    (line,) = (tmp_path / "run" / "history.jsonl").read_text().splitlines()
    assert json.loads(line)["loss_vgg"] > 0
    (tmp_path / "one.pth").rename(tmp_path / "moved.pth")
    assert train(*given, "--vgg", tmp_path / "moved.pth").returncode == 0
    other = train(*given, "--vgg", tmp_path / "two.pth")
    assert other.returncode == 2
    assert "is of another configuration (vgg" in other.stderr
    missing = train(*given, "--vgg", tmp_path / "none.pth")
    assert missing.returncode == 2
    assert "none.pth does not exist" in missing.stderr


ABLATIONS = {
    "front_unet": lambda front: not front.net.attention and front.normal_gan is None,
    "front_unet_ngan": lambda front: not front.net.attention and front.judge() is not None,
    "back_ngan": lambda back: back.source == "sensor" and back.judged_by == "normals",
    "back_eq5": lambda back: back.silhouette == "predicted" and not back.generator.detail,
    "back_dgan": lambda back: back.source == "body" and back.judged_by == "depth",
}


def test_every_ablation_is_tested() -> None:
    files = {path.stem for path in (ROOT / "configs" / "ablations").glob("*.yaml")}
    assert files == set(ABLATIONS)


@pytest.mark.parametrize("ablation", ABLATIONS)
def test_an_ablation_is_a_second_configuration(data: Path, tmp_path: Path, ablation: str) -> None:
    name = ablation.split("_")[0]
    run = tmp_path / "run"
    overlay = ROOT / "configs" / "ablations" / f"{ablation}.yaml"
    arguments = tiny(data, run, name)
    arguments[2:2] = ["--config", overlay]
    done = train(*arguments)
    assert done.returncode == 0, done.stderr
    found = checkpoint.load(run / "checkpoint.pt")
    branch = from_record(found.config["branch"])
    assert ABLATIONS[ablation](branch)
    generator = branch.generator if isinstance(branch, Back) else branch.net
    assert generator.width == 8  # the overlay leaves what it does not name


def test_an_overlay_is_not_blamed_for_the_rest_of_the_call(data: Path, tmp_path: Path) -> None:
    overlay = ROOT / "configs" / "ablations" / "back_dgan.yaml"
    arguments = tiny(data, tmp_path / "run", "back", epochs=0)
    arguments[2:2] = ["--config", overlay]
    done = train(*arguments)
    assert done.returncode == 2
    assert done.stderr.startswith("error: epochs: 0; give 1 to 1000000")


@pytest.mark.parametrize("name", ["front", "back"])
def test_the_papers_settings_stand_in_its_configurations(name: str) -> None:
    """Section 4.1."""
    shown = train("--config", ROOT / "configs" / f"train_{name}.yaml", "--print_config",
                  "--data", "data", "--output", "run")  # fmt: skip
    assert shown.returncode == 0, shown.stderr
    settings = yaml.safe_load(shown.stdout)
    assert settings["epochs"] == {"front": 45, "back": 25}[name]
    assert settings["batch"] == {"front": 16, "back": 32}[name]
    assert settings["learning_rate"] == 0.001
    assert settings["decay"] == "none"
    branch = settings["branch"]["init_args"]
    if name == "front":
        weights = {"depth": 1, "normal": 20, "vgg": 20}
        assert {key: branch["gamma"][key] for key in weights} == weights
        assert branch["net"]["attention"]
        assert branch["net"]["detail"]
        assert branch["normal_gan"] is None
    else:
        weights = {"depth": 10, "gan": 5, "matching": 20, "silhouette": 20, "vgg": 1}
        assert branch["beta"] == weights
        assert (branch["source"], branch["judged_by"]) == ("body", "normals")
        assert branch["silhouette"] == "given"
        assert branch["generator"]["detail"]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("--batch", 0), "batch: 0; give 1 to 4096"),
        (("--branch.net.width", 12), "branch.net.width: 12; give a multiple of 8"),
        (("--device", "warp"), "device: warp is not to be had here"),
        (("--precision", "float8"), "precision"),
        (("--data", "nowhere"), "nowhere"),
        (("--workers", -1), "workers: -1"),
        (
            ("--views.size", "[16, 16]", *JUDGED),
            "views.size: (16, 16); this",
        ),
    ],
)
def test_a_wrong_call_is_told_in_one_line(
    data: Path, tmp_path: Path, wrong: tuple[str, object], said: str
) -> None:
    done = train(*tiny(data, tmp_path / "run"), *wrong)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "run").exists()
