"""The light sweep, as a user runs it: real renders, real files, real processes killed."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from augment import sensors
from augment.color_camera import ColorCamera
from augment.light import LightConfig, expose
from engine.sweep import Sweep, SweepConfig, _foreground
from engine.tasks import read_subject, subject_folder
from render.camera import Camera
from render.capture import capture_radiance
from render.cycles import CyclesConfig
from shards.archive import ShardError
from shards.dataset import Dataset
from shards.splits import split_subjects
from shards.sweep import read_index, read_shared
from shards.verify import verify, verify_sweep
from tests.lumpy import write_lumpy

ROOT = Path(__file__).parents[1]
POWERS = [2000.0, 730.0, 100.0]


def pipeline(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    return subprocess.run(
        [sys.executable, str(ROOT / "pipeline.py"), *map(str, arguments)],
        capture_output=True, text=True, cwd=ROOT, timeout=600, check=False,
    )  # fmt: skip


def write_scan(path: Path, seed: int) -> None:
    """A scan with y up, in metres."""
    write_lumpy(path, seed, [0.25, 0.85, 0.2], [0, 0.9, 0])


def build(folder: Path, *options: object, count: int = 2) -> Path:
    """A dataset of scans, two views each."""
    (folder / "scans").mkdir(parents=True)
    for i in range(count):
        write_scan(folder / "scans" / f"s{i}.glb", seed=i)
    source = {"root": str(folder / "scans"), "licence": "CC0-1.0", "up": "y", "front": "z"}
    config = {
        "subjects": {"class_path": "Scans", "init_args": {**source, "unit": "m"}},
        "views": {"count": 2},
        "cycles": {"samples": 4},
        "seed": 5,
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    result = pipeline(
        "build", "--config", folder / "config.yaml", "--output", folder / "data", *options
    )
    assert result.returncode == 0, result.stderr
    return folder / "data"


def sweep(data: Path, output: Path, *options: object) -> subprocess.CompletedProcess[str]:
    """Sweep `data` under `POWERS`."""
    return pipeline(
        "sweep", "--data", data, "--output", output, "--powers", POWERS, *options
    )  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A dataset without radiance."""
    return build(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Path:
    """The same dataset with radiance."""
    return build(tmp_path_factory.mktemp("kept"), "--shards.radiance", "true")


@pytest.fixture(scope="module")
def swept(data) -> Path:
    """A sweep of the dataset without radiance, with the camera's noise."""
    result = sweep(data, data.parent / "sweep")
    assert result.returncode == 0, result.stderr
    assert "3 powers of 2 subjects" in result.stdout
    return data.parent / "sweep"


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a sweep by its place, but for the manifests, which tell seconds, and what
    `verify` has left."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted([*folder.glob("*W/*.*"), *folder.glob("*W/shards/*")])
        if path.is_file() and path.name not in ("manifest.jsonl", ".lock", "verify.json")
    }


def images(folder: Path, subject: str = "s0") -> np.ndarray:
    """(2, V, H, W, 3) colours of a dataset's subject, front and back."""
    shard = Dataset(folder).shard(subject)
    return np.stack([shard["rgb_front"], shard["rgb_back"]])


def render_at(data: str, power: float | None) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Front and back of s0 under a lamp of `power` watts in Blender, linear; None renders 1 W."""
    from render import scene

    dataset = Dataset(data)
    shard = dataset.shard("s0")
    camera = shard.meta["camera"]
    made = scene.Scene._add_light

    def stronger(self: scene.Scene) -> object:
        lamp = made(self)
        if power is not None:
            lamp.data.energy = power * scene.LAMP_WATTS
        return lamp

    scene.Scene._add_light = stronger
    pairs = capture_radiance(
        read_subject(subject_folder(Path(data), "s0")).surface(),
        Camera.of(camera),
        np.radians(shard["yaw_deg"].astype(float)),
        shard["mask"],
        tuple(shard.meta["light"]["position"]),
        CyclesConfig(**shard.meta["cycles"]),
        2,
    )
    fronts, backs = zip(*pairs, strict=True)
    return list(fronts), list(backs)


def foreground(data: str, output: str) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The light per watt that the sweep multiplies, of s0."""
    with Sweep(SweepConfig(subjects=["s0"]), Path(data), Path(output)) as work:
        (task,) = work.tasks(threads=2)
    shard = Dataset(data).shard("s0")
    return _foreground(task, shard, shard["mask"])


@pytest.fixture(scope="module")
def rendered(data, in_worker, tmp_path_factory) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """From a render, float32."""
    return in_worker(foreground, str(data), str(tmp_path_factory.mktemp("r") / "sweep"))


@pytest.fixture(scope="module")
def stored(kept, tmp_path_factory) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """From a shard, half precision."""
    return foreground(str(kept), str(tmp_path_factory.mktemp("s") / "sweep"))


@pytest.mark.parametrize("power", [2000.0, 100.0])
def test_a_power_is_what_blender_renders_at_that_power(
    data, rendered, stored, in_worker, power
) -> None:
    """In linear radiance: 1e-5 from a float render, half precision from a shard's radiance."""
    direct = in_worker(render_at, str(data), power)
    mask = Dataset(data).shard("s0")["mask"]
    light = LightConfig(power=power, exposure=1.0)
    for side in range(2):
        for view in range(2):
            due = direct[side][view][mask[view]].astype(np.float64)
            assert (due > 0).mean() > 0.5
            for kind, bound in ((rendered, 1e-5), (stored, 1e-3)):
                ours = expose(kind[side][view], light)
                assert (np.abs(ours - due) <= bound * due).all()


def test_kept_and_rendered_light_give_the_same_images(data, kept, tmp_path) -> None:
    """Half precision turns two bytes in a thousand, by one; noise is the same in both."""
    for name, noise in (("quiet", "null"), ("noisy", '{"full_well": 8000}')):
        for folder in (data, kept):
            output = tmp_path / f"{name}-{folder.parent.name}"
            assert sweep(folder, output, "--color_camera", noise).returncode == 0
        for power in ("2000W", "0100W"):
            one, other = (
                images(tmp_path / f"{name}-{folder.parent.name}" / power).astype(int)
                for folder in (data, kept)
            )
            assert one.max() > 20
            assert np.abs(one - other).max() <= 1
            assert (one != other).mean() < 2e-3


def test_without_noise_the_dataset_s_own_power_is_the_dataset(data, tmp_path) -> None:
    result = sweep(data, tmp_path / "sweep", "--color_camera", "null")
    assert result.returncode == 0, result.stderr
    for subject in ("s0", "s1"):
        own = Dataset(data).shard(subject)
        for power, folder in read_index(tmp_path / "sweep").items():
            shard = Dataset(folder).shard(subject)
            for name in ("rgb_front", "rgb_back"):
                same = shard[name].tobytes() == own[name].tobytes()
                assert same == (power == 2000.0)


def test_a_build_with_the_camera_and_the_power_has_the_sweep_s_bytes(swept, tmp_path) -> None:
    """Noise is keyed by seed, subject, view, member and power, whoever draws it."""
    weak = build(tmp_path, "--light.power", 100, "--color_camera.bits", 12)
    for subject in ("s0", "s1"):
        built, lit = Dataset(weak).shard(subject), Dataset(swept / "0100W").shard(subject)
        for name in ("rgb_front", "rgb_back"):
            assert built[name].tobytes() == lit[name].tobytes()
        assert built.meta["color_camera"] == lit.meta["color_camera"]
        assert built.meta["light"] == lit.meta["light"]


def test_the_rest_is_the_base_s_and_not_copied(data, swept) -> None:
    assert [folder.name for folder in read_index(swept).values()] == ["2000W", "0730W", "0100W"]
    for power, folder in read_index(swept).items():
        dataset, own = Dataset(folder), Dataset(data)
        assert dataset.subjects("train") == own.subjects("train")
        assert dataset.subjects("test") == own.subjects("test")
        shard, base = dataset.shard("s1"), own.shard("s1")
        with np.load(dataset.shard_path("s1")) as file:
            assert set(file) == {"rgb_front", "rgb_back", "meta"}
        assert set(shard.names) == set(base.names)
        assert shard.meta["light"] == {**base.meta["light"], "power": power}
        assert dataset.path(shard.meta["mesh"]).samefile(own.path(base.meta["mesh"]))
        for name in base.names:
            if not name.startswith("rgb"):
                assert shard[name].tobytes() == base[name].tobytes()
                assert shard.view(1)[name].tobytes() == base.view(1)[name].tobytes()
        both = shard.view(0, ["rgb_back", "depth_front"])
        assert both["rgb_back"].tobytes() == shard["rgb_back"][0].tobytes()
        assert not shard["rgb_front"][~shard["mask"]].any()
        assert "bpy" in shard.meta["versions"]


def test_weaker_light_is_darker_and_noisier(data, swept, rendered) -> None:
    """The noise is the camera's at each power, and another one for every power and view."""
    shard = Dataset(data).shard("s0")
    mask = shard["mask"][0]
    camera = ColorCamera()
    ratios = []
    for power, folder in read_index(swept).items():
        image = Dataset(folder).shard("s0")["rgb_front"][0][mask].astype(float) / 255
        linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
        clean = rendered[0][0] * power * 0.06
        level = (clean > 0.3 * clean.max()) & (clean < 0.8)
        variance = clean[level] / camera.full_well + (camera.read_noise / camera.full_well) ** 2
        error = (linear - clean)[level]
        # Eight bits of sRGB are coarser than the sensor: their rounding is part of it.
        slope = np.maximum(1.055 / 2.4 * clean[level] ** (1 / 2.4 - 1), 1e-9)
        variance = variance + (1 / (255 * slope)) ** 2 / 12
        assert error.std() == pytest.approx(np.sqrt(variance.mean()), rel=0.05)
        ratios.append(float(clean[level].mean() / error.std()))
    assert ratios[0] > 1.5 * ratios[1] > 2.5 * ratios[2]


def test_verify_proves_a_power_and_the_sweep(data, swept) -> None:
    whole = pipeline("verify", swept)
    assert whole.returncode == 0, whole.stdout + whole.stderr
    assert whole.stdout.count("W: sound") == len(POWERS)
    assert "4 datasets, none of them unsound" in whole.stdout
    report = verify(swept / "0100W")
    assert report.ok
    assert report.figures["s0"]["depth_median_mm"] < 0.005


def test_verify_notices_a_power_of_another_light(copied) -> None:
    """A folder in another's place, shards in another's place, and a base that is none."""
    base, moved = copied
    assert all(report.ok for report in verify_sweep(moved).values())
    shutil.rmtree(moved / "0730W")
    shutil.copytree(moved / "0100W", moved / "0730W", symlinks=True)
    reports = list(verify_sweep(moved).values())
    assert [report.ok for report in reports] == [True, True, False, True]
    assert "is of another light" in reports[2].breaches[0]
    result = pipeline("verify", moved)
    assert result.returncode == 1
    assert "0730W: 1 breach" in result.stdout
    assert result.stdout.count("W: sound") == 2
    shutil.rmtree(moved / "0730W")
    assert not next(iter(list(verify_sweep(moved).values())[2:])).ok
    again = sweep(base, moved)
    assert again.returncode == 0, again.stderr
    assert all(report.ok for report in verify_sweep(moved).values())
    (moved / "0100W" / "base").unlink()
    (moved / "0100W" / "base").symlink_to(moved)
    assert [r.ok for r in verify_sweep(moved).values()] == [True, True, True, False]
    base.rename(base.with_name("elsewhere"))
    result = pipeline("verify", moved)
    assert result.returncode == 2
    assert "run the sweep again with --data where it lies now" in result.stderr
    assert result.stderr.count("\n") == 1


def test_the_same_bytes_from_any_number_of_workers_after_kills(data, swept, tmp_path) -> None:
    output = tmp_path / "sweep"
    command = [sys.executable, ROOT / "pipeline.py", "sweep", "--data", data, "--output", output]
    command += ["--powers", str(POWERS), "--jobs", "2"]
    for marker in ("2000W/dataset.json", "2000W/shards/s?.npz"):
        process = subprocess.Popen(
            list(map(str, command)), cwd=ROOT, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        deadline = time.monotonic() + 60
        while not list(output.glob(marker)):
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.005)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert contents(output) != contents(swept)
    result = sweep(data, output, "--jobs", 1)
    assert result.returncode == 0, result.stderr
    assert contents(output) == contents(swept)
    assert not [p for p in output.rglob(".*") if p.name != ".lock"]
    assert read_shared(output) == read_shared(swept)
    again = sweep(data, output)
    assert "0 subjects made now" in again.stdout


def test_powers_and_subjects_join_those_that_stand(kept, tmp_path) -> None:
    """From the radiance in the shards: Blender is not started, nor is anything it needs there."""
    shutil.copytree(kept, tmp_path / "data", symlinks=True)
    shutil.rmtree(tmp_path / "data" / "subjects")
    (tmp_path / "data" / "subjects").mkdir()
    config = tmp_path / "k.yaml"
    config.write_text("powers: [500]\nsubjects: [s1]\nexposure: 0.1\ncompression: deflate\n")
    before = {}
    for options in ((), ("--powers", "[12.5]"), ("--subjects", "[s0]")):
        result = pipeline(
            "sweep", "--config", config, "--data", tmp_path / "data", "--output",
            tmp_path / "sweep", *options,
        )  # fmt: skip
        assert result.returncode == 0, result.stderr
        now = {k: v for k, v in contents(tmp_path / "sweep").items() if "shards/" in k}
        assert before.items() <= now.items()
        before = now
    index = read_index(tmp_path / "sweep")
    assert [folder.name for folder in index.values()] == ["0500W", "0012.5W"]
    for folder in index.values():
        assert Dataset(folder).subjects() == ["s0", "s1"]
        shard = Dataset(folder).shard("s1")
        assert shard.meta["light"]["exposure"] == 0.1
        assert "bpy" not in shard.meta["versions"]
        assert shard.members["rgb_front"].offset is None
        assert shard["rgb_front"].any()


def test_options_choose_subjects_noise_and_draw(kept, tmp_path) -> None:
    for name, options in {
        "plain": (),
        "draw": ("--draw", 1),
        "test": ("--split", "test"),
        "small": ("--color_camera.full_well", 500),
    }.items():
        assert sweep(kept, tmp_path / name, *options).returncode == 0
    only = Dataset(kept).subjects("test")
    assert Dataset(tmp_path / "test" / "0100W").subjects() == only
    plain, drawn, small = (
        images(tmp_path / name / "0100W").astype(int) for name in ("plain", "draw", "small")
    )
    assert (plain != drawn).mean() > 0.01
    assert plain.mean() == pytest.approx(drawn.mean(), rel=0.01)
    mask = Dataset(kept).shard("s0")["mask"]
    scatter = [
        np.abs(np.diff(i, axis=-2))[:, mask[..., 1:] & mask[..., :-1]] for i in (plain, small)
    ]
    assert scatter[1].mean() > 1.5 * scatter[0].mean()


def test_splits_follow_the_base_in_every_power(tmp_path) -> None:
    """A base that grew has other splits; no power keeps the old ones."""
    base = build(tmp_path, "--shards.radiance", "true", count=3)
    assert sweep(base, tmp_path / "sweep").returncode == 0
    old = Dataset(base).subjects("test")
    ids = Dataset(base).subjects()
    new = next(n for n in map(str, range(99)) if split_subjects([*ids, n], 5)[old[0]] == "train")
    write_scan(tmp_path / "scans" / f"{new}.glb", seed=9)
    config = tmp_path / "config.yaml"
    result = pipeline("build", "--config", config, "--output", base, "--shards.radiance", "true")
    assert result.returncode == 0, result.stderr
    assert Dataset(base).subjects("test") == [new]
    assert any(
        "split of its base" in b
        for r in verify_sweep(tmp_path / "sweep").values()
        for b in r.breaches
    )
    result = pipeline(
        "sweep", "--data", base, "--output", tmp_path / "sweep", "--powers", "[50]",
        "--subjects", "[s0]",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    splits = {
        tuple((name, entry.split) for name, entry in Dataset(folder).manifest.items())
        for folder in read_index(tmp_path / "sweep").values()
    }
    assert len(splits) == 1
    assert all(report.ok for report in verify_sweep(tmp_path / "sweep").values())


def test_the_depth_sensor_reads_the_base(data, swept) -> None:
    """The device brings its own light: a dark picture is no dark surface to it."""
    shard = Dataset(swept / "0100W").shard("s0")
    with pytest.raises(ValueError, match=r"give the view and meta of shard\.base"):
        sensors.read(shard.view(0), shard.meta, 0)
    assert shard.base is not None
    again = sensors.read(shard.base.view(0), shard.base.meta, 0)
    assert again.depth.tobytes() == shard["depth_sensor"][0].tobytes()


@pytest.fixture
def copied(data, swept, tmp_path) -> tuple[Path, Path]:
    """The dataset and its sweep, moved together."""
    shutil.copytree(data, tmp_path / "data", symlinks=True)
    shutil.copytree(swept, tmp_path / "sweep", symlinks=True)
    return tmp_path / "data", tmp_path / "sweep"


def test_both_may_be_moved_together_and_a_lost_base_is_named(copied) -> None:
    base, moved = copied
    shard = Dataset(moved / "0730W").shard("s0")
    assert shard["mask"].any()
    assert (moved / "0730W" / "base").resolve() == base
    base.rename(base.with_name("elsewhere"))
    with pytest.raises(ShardError, match=r"base/shards/s0\.npz is missing.*link it there anew"):
        Dataset(moved / "0730W").shard("s0")
    report = verify(moved / "0730W")
    assert not report.ok


def test_another_base_is_noticed_and_photographed_again(copied) -> None:
    base, moved = copied
    path = base / "shards" / "s0.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert "another sha256" in verify(moved / "0100W", lent=False).breaches[0]
    # The manifest lists another file: nothing is photographed from what it does not know.
    shutil.rmtree(moved / "0100W")
    result = sweep(base, moved)
    assert result.returncode == 1
    reasons = [json.loads(x) for x in (moved / "0100W/failures.jsonl").read_text().splitlines()]
    assert [failure["subject"] for failure in reasons] == ["s0"]
    assert "is not the file that the manifest lists" in reasons[0]["reason"]


def test_a_base_built_anew_from_another_seed_is_not_taken_for_the_same(copied) -> None:
    """Its shards have the same size to the byte."""
    base, moved = copied
    config = base.parent / "config.yaml"
    folder = base.parent / "again"
    (folder / "scans").mkdir(parents=True)
    for i in range(2):
        write_lumpy(folder / "scans" / f"s{i}.glb", i, [0.25, 0.85, 0.2], [0, 0.9, 0])
    settings = yaml.safe_load((ROOT / "configs" / "scans.yaml").read_text())
    settings["subjects"]["init_args"] |= {"root": str(folder / "scans"), "licence": "CC0-1.0"}
    config.write_text(yaml.safe_dump({**settings, "views": {"count": 2}, "cycles": {"samples": 4}}))
    shutil.rmtree(base)
    assert pipeline("build", "--config", config, "--output", base, "--seed", 6).returncode == 0
    with pytest.raises(ShardError, match="holds other maps than"):
        Dataset(moved / "0100W").shard("s0")


@pytest.mark.parametrize("harm", ["missing", "torn", "moved"])
def test_a_record_that_is_not_the_shards_is_not_rendered(copied, harm) -> None:
    base, moved = copied
    shutil.rmtree(moved)
    path = base / "subjects" / "s1" / "subject.json"
    text = path.read_text()
    if harm == "missing":
        path.unlink()
    elif harm == "torn":
        path.write_text(text[: len(text) // 2])
    else:
        record = json.loads(text)
        record["subject"]["mesh_to_world"][0][3] += 0.2
        path.write_text(json.dumps(record))
    result = sweep(base, moved)
    assert result.returncode == 1
    assert "subject.json is missing or not of the surface that the shard shows" in result.stderr
    assert "Traceback" not in result.stderr
    assert Dataset(moved / "2000W").subjects() == ["s0"]


def test_a_mesh_that_changed_is_not_rendered(copied) -> None:
    base, moved = copied
    shutil.rmtree(moved)
    path = base / "subjects" / "s1" / "s1.glb"
    path.unlink()
    write_scan(path, seed=9)
    result = sweep(base, moved)
    assert result.returncode == 1
    assert "1 set aside" in result.stdout
    failures = (moved / "2000W" / "failures.jsonl").read_text().splitlines()
    assert "not the file that the shard was rendered from" in json.loads(failures[0])["reason"]
    assert Dataset(moved / "2000W").subjects() == ["s0"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--powers", "[100, 0]"), "powers: 0.0 W; give watts above 0 and below 1e9"),
        (("--powers", "[-100]"), "powers: -100.0 W; give watts above 0"),
        (("--powers", "[.nan]"), "powers: nan W; give watts above 0"),
        (("--powers", "[]"), "powers: none is given"),
        (("--powers", "[5, 5]"), "names one twice"),
        (("--powers", "[bright]"), "powers: expected a number, got bright"),
        (("--exposure", "-1"), "exposure: -1.0; give a factor above 0"),
        (("--color_camera.full_well", "-3"), "color_camera.full_well: -3.0 electrons"),
        (("--draw", "-1"), "draw: -1"),
        (("--subjects", "[nobody]"), "has no finished subject 'nobody'; it has s0, s1"),
        (("--split", "validation"), "split: expected 'train' or 'test'"),
        (("--powrs", "[5]"), "did you mean powers?"),
        (("--color_camera.full_wel", "3"), "color_camera.full_wel: 3 does not fit; there are full"),
        (("--color_camera.bits", "0.5"), "bits (a whole number)"),
        (("--draw", "1", "--color_camera", "null"), "draw: 1 of no noise"),
    ],
)
def test_a_wrong_call_says_so_in_one_line_before_any_work(data, tmp_path, options, message) -> None:
    result = pipeline("sweep", "--data", data, "--output", tmp_path / "sweep", *options)
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "sweep").exists()


def test_a_folder_that_cannot_be_used(data, swept, tmp_path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    cases = [
        ((data, tmp_path / "full"), "is not empty and holds no sweep.json"),
        ((data, data), "lie in each other"),
        ((tmp_path / "full", tmp_path / "sweep"), "holds no dataset.json"),
        ((swept / "0100W", tmp_path / "sweep"), "is a part of a sweep itself"),
        ((data, data / "shards" / "sweep"), "lie in each other"),
        ((data, data.parent), "lie in each other"),
        ((data, swept, "--exposure", "0.2"), "exposure is 0.06 there and 0.2 here"),
    ]
    for arguments, message in cases:
        result = sweep(*arguments)
        assert result.returncode == 2
        assert message in result.stderr
        assert result.stderr.count("\n") == 1
    assert not (data / "shards" / "sweep").exists()
    alone = pipeline("sweep")
    assert "the following arguments are required: --data, --output" in alone.stderr
    (tmp_path / "bad.yaml").write_text("powers: [0]\n")
    result = pipeline(
        "sweep", "--config", tmp_path / "bad.yaml", "--data", data, "--output", tmp_path / "sweep"
    )
    assert f"{tmp_path / 'bad.yaml'}: powers: 0.0 W" in result.stderr


def test_a_power_that_cannot_be_begun_is_not_in_the_index(data, swept, tmp_path) -> None:
    shutil.copytree(swept, tmp_path / "sweep", symlinks=True)
    (tmp_path / "sweep" / "0050W").mkdir()
    (tmp_path / "sweep" / "0050W" / "thesis.tex").touch()
    result = pipeline(
        "sweep", "--data", data, "--output", tmp_path / "sweep", "--powers", "[70, 50]"
    )
    assert result.returncode == 2
    assert "0050W is not empty" in result.stderr
    assert list(read_index(tmp_path / "sweep")) == POWERS


def test_a_sweep_without_a_shard_may_change_its_mind(data, tmp_path) -> None:
    with Sweep(SweepConfig(powers=[100], exposure=1), data, tmp_path / "sweep"):
        pass
    with Sweep(SweepConfig(powers=[200], exposure=0.5), data, tmp_path / "sweep") as work:
        assert list(work.writers) == [200.0]
    with Sweep(
        SweepConfig(powers=[200], exposure=0.5, color_camera=ColorCamera(8000)),
        data,
        tmp_path / "sweep",
    ):
        assert list(read_index(tmp_path / "sweep")) == [200.0]


def test_a_second_sweep_of_a_folder_waits_for_nothing_and_says_so(data, swept) -> None:
    config = SweepConfig(powers=POWERS)
    with Sweep(config, data, swept):
        result = sweep(data, swept)
    assert result.returncode == 2
    assert "is in use by another build, sweep or training" in result.stderr
    with Sweep(config, data, swept):
        result = pipeline("build", "--config", data.parent / "config.yaml", "--output", data)
    assert result.returncode == 2
    assert "is in use by another build, sweep or training" in result.stderr
