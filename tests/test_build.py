"""The whole way, as a user goes it: the command line, real files, real processes killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from augment import sensors
from shards.archive import Shard
from tests.lumpy import write_lumpy

ROOT = Path(__file__).parents[1]
MEMBERS = {
    "yaw_deg": ("f4", ()),
    "camera_to_world": ("f8", (4, 4)),
    "mask": ("?", (424, 512)),
    "depth_front": ("f4", (424, 512)),
    "depth_back": ("f4", (424, 512)),
    "normal_front": ("f2", (424, 512, 3)),
    "normal_back": ("f2", (424, 512, 3)),
    "rgb_front": ("u1", (424, 512, 3)),
    "rgb_back": ("u1", (424, 512, 3)),
    "depth_sensor": ("f4", (424, 512)),
    "body_depth_front": ("f4", (424, 512)),
    "body_depth_back": ("f4", (424, 512)),
}


def pipeline(*arguments: object, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    return subprocess.run(
        [sys.executable, str(ROOT / "pipeline.py"), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=600,
        check=False,
    )


def write_scan(path: Path, seed: int, height: float = 1.7) -> None:
    """A scan with z up, in centimetres, far from the middle."""
    center = np.random.default_rng(seed + 100).normal(0, 30, 3)
    write_lumpy(path, seed, [25, 18, 50 * height], center)


def write_config(folder: Path, **changes: object) -> Path:
    """A configuration of two quick views for the scans in `folder`/scans."""
    config = {
        "subjects": {
            "class_path": "Scans",
            "init_args": {
                "root": str(folder / "scans"),
                "up": "z",
                "front": "-y",
                "unit": "cm",
                "licence": "CC0-1.0",
            },
        },
        "views": {"count": 2},
        "cycles": {"samples": 2},
        "seed": 5,
        **changes,
    }
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


def scans(folder: Path, count: int) -> Path:
    """A folder of scans and the configuration that builds them."""
    (folder / "scans").mkdir()
    for i in range(count):
        write_scan(folder / "scans" / f"s{i}.glb", seed=i)
    return write_config(folder)


def checksums(dataset: Path) -> dict[str, str]:
    """Subject to the checksum that the manifest states."""
    lines = (dataset / "manifest.jsonl").read_text().splitlines()
    return {entry["subject"]: entry["sha256"] for entry in map(json.loads, lines)}


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """A dataset of three scans, undisturbed, one job."""
    folder = tmp_path_factory.mktemp("built")
    result = pipeline(
        "build", "--config", scans(folder, 3), "--output", folder / "data", "--jobs", 1
    )
    assert result.returncode == 0, result.stderr
    assert "3 shards of 2 views" in result.stdout
    assert "s per view" in result.stdout
    # Blender's own words stay in the workers.
    assert "Saved" not in result.stdout + result.stderr
    assert "Fra:" not in result.stdout + result.stderr
    return folder


def test_a_shard_reads_with_plain_numpy_and_holds_the_contract(built):
    with np.load(built / "data" / "shards" / "s1.npz") as shard:
        for name, (kind, shape) in MEMBERS.items():
            assert shard[name].dtype == np.dtype(kind), name
            assert shard[name].shape == (2, *shape), name
        meta = json.loads(str(shard["meta"]))
        mask, front, sensor = shard["mask"], shard["depth_front"], shard["depth_sensor"]
        assert (shard["rgb_front"][mask].max(axis=-1) > 0).mean() > 0.9
        assert not shard["body_depth_front"].any()
    assert meta["subject"] == "s1"
    assert meta["licence"] == "CC0-1.0"
    assert meta["mesh"] == "subjects/s1/s1.glb"
    assert (built / "data" / meta["mesh"]).is_file()
    noise = (sensor - front)[mask]
    assert 1e-3 < noise.std() < 2e-2
    assert np.abs(np.median(noise)) < 1e-4
    assert not sensor[~mask].any()


def test_yaws_differ_between_subjects_and_stay_in_range(built):
    yaws = [np.load(built / "data" / "shards" / f"s{i}.npz")["yaw_deg"] for i in range(3)]
    assert len(np.unique(yaws)) == 6
    assert np.abs(yaws).max() <= 30


def test_verify_proves_the_dataset(built):
    result = pipeline("verify", built / "data")
    assert result.returncode == 0, result.stdout


def test_verify_finds_a_mesh_that_is_not_the_one_rendered(built, tmp_path):
    import shutil

    copy = tmp_path / "data"
    shutil.copytree(built / "data", copy)
    write_scan(copy / "subjects" / "s1" / "s1.glb", seed=77)
    result = pipeline("verify", copy)
    assert result.returncode == 1
    assert "s1" in result.stdout


@pytest.mark.parametrize(
    ("breaches", "words"), [(["a: one"], "1 breach:\na: one"), (["a", "b"], "2 breaches:\na\nb")]
)
def test_breaches_are_counted_in_english(breaches, words):
    from shards.verify import Report

    assert Report(breaches).table().endswith(f"\n{words}")


def test_two_jobs_and_a_second_run_give_the_same_bytes(built, tmp_path):
    result = pipeline(
        "build", "--config", built / "config.yaml", "--output", tmp_path / "again", "--jobs", 2
    )
    assert result.returncode == 0, result.stderr
    assert checksums(tmp_path / "again") == checksums(built / "data")
    for subject in checksums(built / "data"):
        name = f"shards/{subject}.npz"
        assert (tmp_path / "again" / name).read_bytes() == (built / "data" / name).read_bytes()


def test_a_finished_build_does_nothing_again(built):
    shard = built / "data" / "shards" / "s0.npz"
    before = shard.stat().st_mtime_ns
    result = pipeline("build", "--config", built / "config.yaml", "--output", built / "data")
    assert result.returncode == 0
    assert "3 of 3 shards stand already" in result.stderr
    assert shard.stat().st_mtime_ns == before


def start_build(config: Path, output: Path) -> subprocess.Popen[str]:
    """A build in a session of its own, as soon as its first shard is in the manifest."""
    command = [sys.executable, str(ROOT / "pipeline.py"), "build", "--config", str(config)]
    process = subprocess.Popen(
        [*command, "--output", str(output), "--jobs", "1"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    manifest = output / "manifest.jsonl"
    deadline = time.monotonic() + 120
    while not (manifest.exists() and manifest.read_text().count("\n") >= 1):
        assert process.poll() is None, "the build ended before it could be disturbed"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return process


def session_members(session: int) -> list[int]:
    """The living processes of a session, zombies left out."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def test_ctrl_c_ends_at_once_and_leaves_no_process(built, tmp_path):
    process = start_build(built / "config.yaml", tmp_path / "data")
    os.killpg(process.pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "run the same command again" in stderr
    assert "Traceback" not in stderr, stderr
    deadline = time.monotonic() + 10
    while session_members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert session_members(process.pid) == []
    assert (tmp_path / "data" / "failures.jsonl").read_text() == ""


def test_a_parent_killed_alone_takes_its_workers_along(built, tmp_path):
    process = start_build(built / "config.yaml", tmp_path / "data")
    process.kill()
    process.communicate()
    deadline = time.monotonic() + 20
    while session_members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert session_members(process.pid) == []
    result = pipeline("build", "--config", built / "config.yaml", "--output", tmp_path / "data")
    assert result.returncode == 0, result.stderr
    assert checksums(tmp_path / "data") == checksums(built / "data")


def test_a_killed_build_goes_on_to_the_same_bytes(built, tmp_path):
    output = tmp_path / "data"
    process = start_build(built / "config.yaml", output)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    done = checksums(output)
    assert 1 <= len(done) < 3
    kept = {s: (output / "shards" / f"{s}.npz").stat().st_mtime_ns for s in done}

    result = pipeline("build", "--config", built / "config.yaml", "--output", output)
    assert result.returncode == 0, result.stderr
    assert f"{len(done)} of 3 shards stand already" in result.stderr
    assert checksums(output) == checksums(built / "data")
    assert {s: (output / "shards" / f"{s}.npz").stat().st_mtime_ns for s in done} == kept
    assert sorted(p.name for p in (output / "shards").iterdir()) == ["s0.npz", "s1.npz", "s2.npz"]


def test_bad_subjects_are_set_aside_and_the_others_built(tmp_path):
    config = scans(tmp_path, 1)
    folder = tmp_path / "scans"
    write_scan(folder / "giant.glb", seed=3, height=2.6)
    (folder / "torn.glb").write_bytes((folder / "s0.glb").read_bytes()[:3000])
    (folder / "nan.obj").write_text("v 0 0 0\nv 1 nan 0\nv 0 1 170\nf 1 2 3\n")
    (folder / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 170\n")
    (folder / "bare.obj").write_text(
        "mtllib bare.mtl\nv 0 0 0\nv 50 0 0\nv 0 0 170\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    )
    (folder / "bare.mtl").write_text("newmtl m\nmap_Kd gone.png\n")
    result = pipeline("build", "--config", config, "--output", tmp_path / "data")
    assert result.returncode == 1, result.stderr
    assert list(checksums(tmp_path / "data")) == ["s0"]
    lines = (tmp_path / "data" / "failures.jsonl").read_text().splitlines()
    reasons = {failure["subject"]: failure["reason"] for failure in map(json.loads, lines)}
    assert set(reasons) == {"giant", "torn", "nan", "points", "bare"}
    assert "camera.pixel_size" in reasons["giant"]
    assert "torn.glb" in reasons["torn"]
    assert "NaN" in reasons["nan"]
    assert "no surface" in reasons["points"]
    assert "gone.png" in reasons["bare"]
    assert all(reason in " ".join(result.stderr.split()) for reason in reasons.values())
    assert "5 set aside" in result.stdout
    assert pipeline("verify", tmp_path / "data").returncode == 0


def test_a_texture_in_a_folder_below_the_scan_is_taken_along(tmp_path):
    folder = tmp_path / "scans" / "anna"
    (folder / "tex").mkdir(parents=True)
    Image.new("RGB", (4, 4), (250, 0, 0)).save(folder / "tex" / "red.png")
    (folder / "anna.mtl").write_text("newmtl m\nmap_Kd tex/red.png\n")
    solid = trimesh.creation.box([50, 30, 170])
    lines = ["mtllib anna.mtl", *("v {} {} {}".format(*v) for v in solid.vertices), "vt 0.5 0.5"]
    lines += ["usemtl m", *("f {}/1 {}/1 {}/1".format(*(f + 1)) for f in solid.faces)]
    (folder / "anna.obj").write_text("\n".join(lines) + "\n")
    config = write_config(tmp_path, views={"yaw_deg": [0]})
    result = pipeline("build", "--config", config, "--output", tmp_path / "data")
    assert result.returncode == 0, result.stderr
    with np.load(tmp_path / "data" / "shards" / "anna.npz") as shard:
        color = shard["rgb_front"][shard["mask"]]
    assert np.median(color[:, 0]) > 50
    assert not color[:, 1:].any()


def test_a_scan_that_went_is_named_and_a_first_mistake_locks_nothing(tmp_path):
    config = scans(tmp_path, 2)
    call = ("build", "--config", config, "--output", tmp_path / "data", "--cycles.samples", 1)
    # Two people 17 km high: nothing is built, and the correction goes into the same folder.
    assert pipeline(*call, "--subjects.unit", "m").returncode == 1
    assert pipeline(*call).returncode == 0
    (tmp_path / "scans" / "s0.glb").unlink()
    result = pipeline(*call)
    assert result.returncode == 0
    assert "no longer part of the dataset: s0" in result.stderr
    assert list(checksums(tmp_path / "data")) == ["s1"]


def test_fit_holds_the_giant(tmp_path):
    (tmp_path / "scans").mkdir()
    write_scan(tmp_path / "scans" / "giant.glb", seed=3, height=2.6)
    config = write_config(tmp_path, camera={"pixel_size": "fit"}, views={"yaw_deg": [10.0]})
    result = pipeline("build", "--config", config, "--output", tmp_path / "data")
    assert result.returncode == 0, result.stderr
    assert pipeline("verify", tmp_path / "data").returncode == 0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera": {"pixel_sise": 0.01}}, ["camera", "pixel_sise", "pixel_size"]),
        ({"camera": {"rows": "many"}}, ["camera.rows", "whole number", "many", "424"]),
        ({"camera": {"pixel_size": -1}}, ["camera.pixel_size", "0.005"]),
        ({"views": {"count": 0}}, ["views.count", "14"]),
        ({"colour": 3}, ["colour"]),
        ({"subjects": {"class_path": "Scans", "init_args": {"root": "x"}}}, ["subjects", "up"]),
        ({"subjects": {"class_path": "Scan"}}, ["subjects", "Scan", "OpenHumans"]),
        ({"cameras": {"rows": 3}}, ["cameras", "did you mean camera.rows?"]),
    ],
)
def test_a_wrong_configuration_is_one_line_and_status_two(tmp_path, changes, words):
    config = write_config(tmp_path, **changes)
    result = pipeline("build", "--config", config, "--output", tmp_path / "data")
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert "Traceback" not in result.stderr
    assert "config.yaml" in result.stderr
    for word in words:
        assert word in result.stderr, result.stderr
    assert not (tmp_path / "data").exists()


def test_wrong_calls_are_one_line_and_status_two(tmp_path):
    missing = pipeline("build", "--config", tmp_path / "none.yaml", "--output", tmp_path / "d")
    torn = tmp_path / "torn.yaml"
    torn.write_text("camera: {rows: [\n")
    for result, word in (
        (missing, "none.yaml"),
        (pipeline("build", "--config", torn, "--output", tmp_path / "d"), "torn.yaml"),
        (pipeline("build"), "--output"),
        (pipeline("build", "--output", "/proc/none"), "cannot be written"),
        (pipeline("verify", tmp_path / "none"), "none"),
        (pipeline("verify"), "data"),
        (pipeline("paint"), "paint"),
    ):
        assert result.returncode == 2, result.stderr
        assert len(result.stderr.splitlines()) == 1, result.stderr
        assert word in result.stderr


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("--subjects.lmit=1", "did you mean subjects.limit?"),
        ("--subject.limit=1", "did you mean subjects.limit of Scans?"),
        ("--subjects.count=1", "did you mean subjects.count of OpenHumans?"),
        ("--subjects.fit.root=x", "did you mean subjects.fits.root?"),
        ("--subjects.fits.rot=x", "did you mean subjects.fits.root?"),
        ("--camra.pixel_size=1", "did you mean camera.pixel_size?"),
        ("--outptu=x", "did you mean output?"),
        ("--subjects.unit=metre", "unit: expected 'm' or"),
        ("--subjects.unit=metre", "--subjects.help Scans lists"),
        ("--subjects.limit=few", "limit: expected a whole number or null, got few"),
    ],
)
def test_a_misspelt_option_is_told_the_right_one(tmp_path, option, words):
    result = pipeline(
        "build", "--config", write_config(tmp_path), "--output", tmp_path / "data", option
    )
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert words in result.stderr


@pytest.mark.parametrize("option", ["--subjects.qqqq=1", "--colour=1"])
def test_an_option_like_no_other_is_told_none(tmp_path, option):
    result = pipeline("build", "--output", tmp_path / "data", option)
    assert result.returncode == 2
    assert "did you mean" not in result.stderr


def test_of_two_sources_the_option_of_the_one_in_use_is_told(tmp_path):
    result = pipeline("build", "--output", tmp_path / "data", "--subjects.cuont", 1)
    assert "did you mean subjects.count?" in result.stderr
    result = pipeline("build", "--output", tmp_path / "data", "--subjects.lmit", 1)
    assert "did you mean subjects.limit of Scans?" in result.stderr
    assert "--subjects.help Scans lists" in result.stderr


@pytest.mark.parametrize("package", ["jsonargparse", "PIL"])
def test_a_missing_package_is_one_line_and_status_two(tmp_path, package):
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "import pipeline\n"
        f"sys.exit(pipeline.main(['build', '--output', {str(tmp_path / 'data')!r}]))"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert f"the Python package {package} is missing" in result.stderr
    assert "pip install '.[render,humans,trainer,surface,figures,poisson,dask]'" in result.stderr


@pytest.fixture(scope="module")
def humans(tmp_path_factory) -> Path:
    """A dataset of two open humans, two jobs."""
    output = tmp_path_factory.mktemp("humans") / "data"
    result = build_humans(output, jobs=2)
    assert result.returncode == 0, result.stderr
    return output


def build_humans(output: Path, jobs: int) -> subprocess.CompletedProcess[str]:
    """The smoke configuration, with the linear light kept as well."""
    return pipeline(
        *("build", "--config", ROOT / "configs" / "smoke.yaml", "--output", output),
        *("--jobs", jobs, "--shards.radiance", "true"),
    )


def test_open_humans_have_the_same_bytes_with_one_job(humans, tmp_path):
    parameters = json.loads((humans / "subjects" / "open_0000" / "parameters.json").read_text())
    assert parameters["drapes"]["cloth"] == "draped"
    assert "CC0 1.0 Universal" in (humans / "subjects" / "LICENSE").read_text()
    result = build_humans(tmp_path / "data", jobs=1)
    assert result.returncode == 0, result.stderr
    assert checksums(tmp_path / "data") == checksums(humans)
    for path in sorted((humans / "subjects").rglob("*.*")):
        if path.name == "cost.json":
            continue  # seconds and memory are no two times the same
        again = tmp_path / "data" / path.relative_to(humans)
        assert again.read_bytes() == path.read_bytes(), path.name


def test_open_humans_are_proven_and_drawn(humans, tmp_path):
    output = humans
    proof = pipeline("verify", output)
    assert proof.returncode == 0, proof.stdout
    with np.load(output / "shards" / "open_0000.npz") as shard:
        mask, body = shard["mask"], shard["body_depth_front"] > 0
        # The bare body fills most of the clothed silhouette and hardly leaves it.
        assert 0.5 < (body & mask).sum() / mask.sum() < 1
        assert (body & ~mask).sum() < 0.01 * mask.sum()
        assert shard["radiance_back"].dtype == np.float16
        meta = json.loads(str(shard["meta"]))
    assert meta["licence"] == "CC0-1.0"
    assert (output / meta["body"]).is_file()

    picture = tmp_path / "sheet.png"
    command = [sys.executable, "-m", "report.sheet", str(output), "--output", str(picture)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 1000


def test_another_configuration_does_not_overwrite_a_dataset(built):
    result = pipeline(
        "build", "--config", built / "config.yaml", "--output", built / "data", "--seed", 6
    )
    assert result.returncode == 2
    assert "seed" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_the_pipeline_process_never_loads_blender_or_torch():
    code = (
        "import sys, pipeline\n"
        "try: pipeline.main(['build', '--print_config'])\n"
        "except SystemExit: pass\n"
        "import engine.build, shards.verify\n"
        "sys.exit(bool({'bpy', 'torch', 'anny'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize("sensor", ["NormalGAN", "KinectV2", "TimeOfFlight", "KinectV1"])
def test_whoever_has_a_shard_reads_the_sensor_again(tmp_path, sensor):
    """Several readings of each view, and the same ones from the stored maps."""
    config = scans(tmp_path, 1)
    result = pipeline(
        "build", "--config", config, "--output", tmp_path / "data", "--sensor", sensor,
        "--sensor.noise", 2, "--shards.draws", 3,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert pipeline("verify", tmp_path / "data").returncode == 0
    shard = Shard(tmp_path / "data" / "shards" / "s0.npz")
    assert shard["depth_sensor_more"].shape == (2, 2, 424, 512)
    readings = set()
    for i in range(2):
        view = shard.view(i)
        stored = [view["depth_sensor"], *view["depth_sensor_more"]]
        for draw, depth in enumerate(stored):
            again = sensors.read(view, shard.meta, i, draw)
            assert again.depth.tobytes() == depth.tobytes()
            readings.add(depth.tobytes())
    assert len(readings) == 6
    assert shard.meta["sensor"]["noise"] == 2
    assert shard.meta["sensor"]["distance"] == 2.0


def test_a_sensor_that_is_none(tmp_path):
    config = scans(tmp_path, 1)
    result = pipeline(
        "build", "--config", config, "--output", tmp_path / "d", "--sensor", "Kinect9"
    )
    assert result.returncode == 2
    assert "NormalGAN, KinectV2, TimeOfFlight, KinectV1, AzureKinect" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(("option", "known"), [("sensor", "KinectV2"), ("subjects", "Scans")])
def test_help_of_a_class_that_is_none(option, known):
    result = pipeline("build", f"--{option}.help", "Kinect9")
    assert result.returncode == 2
    assert known in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_interrupt_while_modules_load_is_heard(tmp_path):
    """Some modules swallow what is raised while they are imported."""
    process = subprocess.Popen(
        [sys.executable, "-X", "importtime", "pipeline.py", "verify", str(tmp_path)],
        cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    lines = iter(process.stderr.readline, "")
    next(line for line in lines if line.endswith("jsonargparse._optionals\n"))
    process.send_signal(signal.SIGINT)
    rest = process.stderr.read().splitlines()
    assert process.wait(timeout=20) == 130
    assert rest[-1] == "interrupted; run the same command again to go on"
    assert not any("Traceback" in line for line in rest)
