"""reconstruct, evaluate and experiment as a user calls them, on surfaces that are known."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from pipeline import main
from shards.dataset import Dataset
from shards.verify import verify
from surface.distances import nearest
from surface.mesh import read_mesh

ROOT = Path(__file__).parents[2]
TEST = "lump_1"
"""The test subject of seed 0."""


def run(*arguments: object, timeout: float = 600) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "pipeline.py"), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


@pytest.fixture(scope="module")
def oracle(people: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fusion of the test subject's true depths."""
    folder = tmp_path_factory.mktemp("oracle") / "meshes"
    arguments = ["--data", people, "--front", "true", "--back", "true", "--output", folder]
    assert main(["reconstruct", *map(str, arguments)]) == 0
    return folder


def evaluated(people: Path, meshes: Path, output: Path, *more: str) -> tuple[int, dict]:
    arguments = ["--data", people, "--meshes", meshes, "--output", output, "--samples", 3000]
    status = main(["evaluate", *map(str, arguments), "--jobs", "1", "--name", "it", *more])
    path = output / "it.json"
    return status, json.loads(path.read_text()) if path.exists() else {}


def test_the_made_people_are_a_dataset(people: Path) -> None:
    assert Dataset(people).subjects("test") == [TEST]
    assert verify(people).breaches == []


class TestReconstruct:
    def test_makes_a_closed_mesh_of_every_test_view(self, oracle: Path) -> None:
        names = sorted(path.name for path in oracle.iterdir() if path.suffix == ".ply")
        assert names == [f"{TEST}_00.ply", f"{TEST}_01.ply"]
        mesh = trimesh.load_mesh(oracle / names[0], process=False)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.visual.vertex_colors.shape == (len(mesh.vertices), 4)

    def test_takes_up_what_stands_and_refuses_another_configuration(
        self, people: Path, oracle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        again = tmp_path / "again"
        shutil.copytree(oracle, again)
        before = (again / f"{TEST}_00.ply").stat().st_mtime_ns
        (again / f"{TEST}_01.ply").unlink()
        given = ["reconstruct", "--data", str(people), "--output", str(again)]
        assert main([*given, "--front", "true", "--back", "true"]) == 0
        assert "1 of 2 meshes stand" in capsys.readouterr().err
        assert (again / f"{TEST}_00.ply").stat().st_mtime_ns == before
        assert (again / f"{TEST}_01.ply").read_bytes() == (oracle / f"{TEST}_01.ply").read_bytes()
        assert main([*given, "--front", "sensor", "--back", "true"]) == 2
        assert 'front is "true" there and "sensor" here' in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("more", "said"),
        [
            (["--front", "none.pt", "--back", "true"], "none.pt is missing; train first"),
            (["--front", "true", "--back", "true", "--views", "[7]"], "views 0 to 1, not 7"),
            (["--front", "true", "--back", "true", "--subjects", "[who]"], "no finished who"),
            (["--front", "true", "--back", "true", "--step", "-1"], "step: -1.0; give metres"),
            (["--front", "true", "--back", "true", "--poisson", "3"], "depth, 4 to 12"),
        ],
    )
    def test_what_cannot_be_is_said_in_a_line(
        self,
        people: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        more: list[str],
        said: str,
    ) -> None:
        given = ["reconstruct", "--data", str(people), "--output", str(tmp_path / "out")]
        assert main([*given, *more]) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1

    def test_poisson_smooths_what_was_fused(
        self, people: Path, oracle: Path, tmp_path: Path
    ) -> None:
        given = ["--data", str(people), "--output", str(tmp_path / "out"), "--views", "[0]"]
        assert (
            main(["reconstruct", *given, *["--front", "true", "--back", "true", "--poisson", "6"]])
            == 0
        )
        found = trimesh.load_mesh(tmp_path / "out" / f"{TEST}_00.ply", process=False)
        fused = trimesh.load_mesh(oracle / f"{TEST}_00.ply", process=False)
        assert len(found.vertices) != len(fused.vertices)
        np.testing.assert_allclose(found.bounds, fused.bounds, atol=0.06)

    def test_data_or_a_frame_and_not_both(
        self, people: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        sides = ["--front", "sensor", "--back", "body", "--output", "x.ply"]
        assert main(["reconstruct", *sides]) == 2
        assert "give --data, or --frame.rgb and --frame.depth" in capsys.readouterr().err


class TestFrame:
    """PNG files of a perspective camera."""

    @pytest.fixture
    def files(self, people: Path, tmp_path: Path) -> dict[str, str]:
        """The test subject at 2.2 m, seen from a Kinect v2 by casting its rays one by one."""
        mesh = trimesh.load_mesh(people / "subjects" / TEST / "surface.ply")
        mesh.apply_translation([0.1, -0.6, -2.2])
        v, u = np.mgrid[:424, :512]
        rays = np.stack([(u - 255) / 365.5, (205 - v) / 365.5, -np.ones(u.shape)], -1).reshape(
            -1, 3
        )
        near = np.flatnonzero((np.abs(rays[:, 0]) < 0.4) & (np.abs(rays[:, 1]) < 0.4))
        points, which, _ = mesh.ray.intersects_location(
            np.zeros((len(near), 3)), rays[near], multiple_hits=False
        )
        depth = np.zeros(424 * 512)
        depth[near[which]] = -points[:, 2]
        depth = depth.reshape(424, 512)
        Image.fromarray(np.rint(1000 * depth).astype(np.uint16)).save(tmp_path / "depth.png")
        rgb = np.where(depth[..., None] > 0, [90, 120, 200], 0).astype(np.uint8)
        Image.fromarray(rgb).save(tmp_path / "rgb.png")
        body = trimesh.load_mesh(people / "subjects" / TEST / "body.ply")
        body.apply_translation([0.1, -0.6, -2.2])
        body.export(tmp_path / "body.ply")
        mesh.export(tmp_path / "true.ply")
        return {
            name: str(tmp_path / f"{name}.{kind}")
            for name, kind in (("rgb", "png"), ("depth", "png"), ("body", "ply"), ("true", "ply"))
        }

    def test_becomes_a_mesh_in_the_cameras_own_frame(
        self, files: dict[str, str], tmp_path: Path
    ) -> None:
        given = [f"--frame.{name}={files[name]}" for name in ("rgb", "depth", "body")]
        output = tmp_path / "out" / "person.glb"
        sides = ["--front", "sensor", "--back", "body", "--output", str(output)]
        assert main(["reconstruct", *given, *sides]) == 0
        found = trimesh.load_mesh(output, process=False)
        true = trimesh.load_mesh(files["true"])
        assert found.is_watertight
        seen = np.asarray(found.vertices)
        off, _ = nearest(seen[seen[:, 2] > -2.15], read_mesh(Path(files["true"])))
        assert np.median(off) < 0.004
        np.testing.assert_allclose(found.bounds[1][:2], true.bounds[1][:2], atol=0.02)

    def test_a_palette_is_no_colour_and_alpha_no_mask(
        self, files: dict[str, str], tmp_path: Path
    ) -> None:
        from engine.frame import FrameFiles

        true = np.asarray(Image.open(files["rgb"]))
        Image.fromarray(true).convert("P", palette=Image.Palette.ADAPTIVE).save(tmp_path / "p.png")
        opaque = np.zeros((*true.shape[:2], 4), np.uint8)
        opaque[..., 3], opaque[:100, :100, :3] = 255, 200
        Image.fromarray(opaque).save(tmp_path / "m.png")
        frame = FrameFiles(str(tmp_path / "p.png"), files["depth"], str(tmp_path / "m.png")).read()
        np.testing.assert_allclose(frame.rgb, true, atol=3)
        assert frame.mask.sum() == 100 * 100

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"body": None}, "give frame.body"),
            ({"depth": "rgb"}, "no depth image of 16 bits"),
            ({"rgb": "true"}, "no image that can be read"),
            ({"depth": None}, "give frame.rgb and frame.depth"),
        ],
    )
    def test_files_that_do_not_fit_are_named(
        self, files: dict[str, str], capsys: pytest.CaptureFixture[str], change: dict, said: str
    ) -> None:
        names = {"rgb": "rgb", "depth": "depth", "body": "body"} | change
        given = [f"--frame.{k}={files[v]}" for k, v in names.items() if v is not None]
        sides = ["--front", "sensor", "--back", "body", "--output", "out.ply"]
        assert main(["reconstruct", *given, *sides]) == 2
        assert said in capsys.readouterr().err

    @pytest.mark.parametrize(
        "option", ["--split=all", "--subjects=[a]", "--views=[0]", "--format=obj"]
    )
    def test_what_chooses_of_a_dataset_is_refused(
        self, files: dict[str, str], capsys: pytest.CaptureFixture[str], option: str
    ) -> None:
        given = [f"--frame.{name}={files[name]}" for name in ("rgb", "depth", "body")]
        sides = ["--front", "sensor", "--back", "body", "--output", "out.ply"]
        assert main(["reconstruct", *given, *sides, option]) == 2
        assert option[2:].split("=")[0] in capsys.readouterr().err


class TestEvaluate:
    def test_measures_every_mesh_and_writes_all_four_files(
        self, people: Path, oracle: Path, tmp_path: Path
    ) -> None:
        status, found = evaluated(people, oracle, tmp_path)
        assert status == 0
        assert found["counts"] == {"measured": 2, "subjects": 1, "left_out": 0}
        assert {row["view"] for row in found["scores"]} == {0, 1}
        # A pixel is 2 cm, and 1.8 % of the box's side.
        assert found["means"]["mesh_to_truth"]["mean"] < 0.9
        assert found["means"]["CD"]["mean"] < 1.5
        with (tmp_path / "it.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert [float(row["CD"]) for row in rows] == [row["CD"] for row in found["scores"]]
        mean = np.mean([row["CD"] for row in found["scores"]])
        assert found["means"]["CD"]["mean"] == pytest.approx(mean)
        assert f"{mean:.4f}" in (tmp_path / "it.md").read_text()
        assert f"{mean:.4f}" in (tmp_path / "it.tex").read_text()

    def test_a_subjects_own_surface_scores_0_under_every_convention(
        self, people: Path, tmp_path: Path
    ) -> None:
        shard = Dataset(people).shard(TEST)
        mesh = trimesh.load_mesh(people / "subjects" / TEST / "surface.ply", process=False)
        mesh.apply_transform(np.linalg.inv(shard["camera_to_world"][1]))
        (tmp_path / "meshes").mkdir()
        mesh.export(tmp_path / "meshes" / f"{TEST}_01.obj", digits=12)
        for convention in ("paper", "icon", "metric"):
            status, found = evaluated(
                people, tmp_path / "meshes", tmp_path / convention, "--convention", convention
            )
            assert status == 0
            assert all(cell["mean"] < 1e-4 for cell in found["means"].values()), found["means"]

    def test_bad_meshes_are_named_and_in_no_mean(
        self, people: Path, oracle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        good = evaluated(people, oracle, tmp_path / "good")[1]
        meshes = tmp_path / "meshes"
        shutil.copytree(oracle, meshes)
        others = Dataset(people).subjects("train")
        (meshes / f"{others[0]}_00.obj").write_text("")
        (meshes / f"{others[1]}_00.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
        (meshes / f"{others[2]}_00.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        (meshes / f"{others[3]}_00.obj").write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
        (meshes / "nobody_00.obj").write_text("v 0 0 0\n")
        (meshes / f"{others[3]}_09.obj").write_text("v 0 0 0\n")
        (meshes / "again").mkdir()
        shutil.copy(oracle / f"{TEST}_00.ply", meshes / f"{TEST}.ply")
        status, found = evaluated(people, meshes, tmp_path / "scores")
        assert status == 1
        assert found["counts"] == {"measured": 2, "subjects": 1, "left_out": 7}
        assert found["means"] == good["means"]
        reasons = found["left_out"]
        assert "holds no triangles" in reasons[f"{others[0]}_00.obj"]
        assert "holds no triangles" in reasons[f"{others[1]}_00.obj"]
        assert "1 of 3 vertices are NaN" in reasons[f"{others[2]}_00.obj"]
        assert "no extent" in reasons[f"{others[3]}_00.obj"]
        assert "no subject of the dataset" in reasons["nobody_00.obj"]
        assert "views 0 to 1, not 9" in reasons[f"{others[3]}_09.obj"]
        assert f"another file is of view 0 of {TEST}" in reasons[f"{TEST}_00.ply"]
        assert "left out nobody_00.obj: " in capsys.readouterr().err

    def test_other_methods_names_are_found_by_a_pattern(
        self, people: Path, oracle: Path, tmp_path: Path
    ) -> None:
        place = tmp_path / "meshes" / TEST
        place.mkdir(parents=True)
        shutil.copy(oracle / f"{TEST}_01.ply", place / "result_1_256.ply")
        pattern = "{subject}/result_{view}_256"
        status, found = evaluated(people, tmp_path / "meshes", tmp_path / "s", "--pattern", pattern)
        assert status == 0
        assert [(row["subject"], row["view"]) for row in found["scores"]] == [(TEST, 1)]

    def test_a_torn_line_of_scores_is_measured_again(
        self, people: Path, oracle: Path, tmp_path: Path
    ) -> None:
        first = evaluated(people, oracle, tmp_path)[1]
        kept = tmp_path / "scores.jsonl"
        kept.write_bytes(kept.read_bytes()[:-40])
        for _ in range(2):
            assert evaluated(people, oracle, tmp_path) == (0, first)
        assert len(kept.read_bytes().splitlines()) == 2

    def test_a_mesh_that_was_moved_is_aligned(
        self, people: Path, oracle: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "m").mkdir()
        mesh = trimesh.load_mesh(oracle / f"{TEST}_00.ply", process=False)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(0.1, [0, 1, 0]))
        mesh.export(tmp_path / "m" / f"{TEST}_00.ply")
        (tmp_path / "still").mkdir()
        shutil.copy(oracle / f"{TEST}_00.ply", tmp_path / "still")
        plain, aligned, still = (
            evaluated(people, tmp_path / meshes, tmp_path / name, "--align", name[:-1])[1]["means"]
            for meshes, name in (("m", "false1"), ("m", "true2"), ("still", "true3"))
        )
        for figure in ("CD", "P2S", "L2"):
            assert aligned[figure]["mean"] == pytest.approx(still[figure]["mean"], rel=0.2)
            assert plain[figure]["mean"] > 1.2 * still[figure]["mean"]

    def test_scores_that_stand_are_not_measured_anew(
        self, people: Path, oracle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        first = evaluated(people, oracle, tmp_path)[1]
        capsys.readouterr()
        assert evaluated(people, oracle, tmp_path)[1] == first
        assert "2 of 2 scores stand" in capsys.readouterr().err
        # Another convention's are others.
        other = evaluated(people, oracle, tmp_path, "--convention", "metric")[1]
        assert other["means"]["mesh_to_truth"] != first["means"]["mesh_to_truth"]

    @pytest.mark.parametrize(
        ("more", "said"),
        [
            (["--meshes", "nowhere"], "nowhere is no folder of meshes"),
            (["--pattern", "x"], "give one with {subject} once"),
            (["--samples", "3"], "samples: 3; give 100"),
            (["--subjects", "[lump_0]"], "no mesh of the subjects"),
            (["--subjects", "[lump_1, lump_9]"], "no finished lump_9"),
            (["--name", "../x"], "name: '../x'"),
        ],
    )
    def test_what_cannot_be_is_said_in_a_line(
        self,
        people: Path,
        oracle: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        more: list[str],
        said: str,
    ) -> None:
        given = ["--data", str(people), "--meshes", str(oracle), "--output", str(tmp_path)]
        assert main(["evaluate", *given, *more]) == 2
        assert said in capsys.readouterr().err


@pytest.fixture(scope="module")
def study(people: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A study's folder and the configuration of its size: networks of few channels, one epoch."""
    place = tmp_path_factory.mktemp("study")
    small = {"views": {"size": [64, 48]}, "epochs": 1, "batch": 4}
    nets = {
        "front": {"class_path": "Front", "init_args": {"net": {"width": 8}}},
        "back": {
            "class_path": "Back",
            "init_args": {"generator": {"width": 8}, "discriminator": {"width": 8}},
        },
    }
    for side, branch in nets.items():
        (place / f"{side}.yaml").write_text(yaml.safe_dump({"branch": branch, **small}))
    sweep = {"powers": [1000, 100], "color_camera": None}
    (place / "sweep.yaml").write_text(yaml.safe_dump(sweep))
    size = {
        "data": str(people),
        "front": str(place / "front.yaml"),
        "back": str(place / "back.yaml"),
        "sweep": str(place / "sweep.yaml"),
        "seeds": [0, 1],
        "views": [0],
        "samples": 2000,
    }
    (place / "size.yaml").write_text(yaml.safe_dump(size))
    return place / "study", place / "size.yaml"


def experiment(study: tuple[Path, Path], name: str) -> subprocess.CompletedProcess[str]:
    return run("experiment", name, "--config", study[1], "--output", study[0])


class TestExperiment:
    def test_table_4_trains_measures_and_says_what_it_found(self, study: tuple[Path, Path]) -> None:
        done = experiment(study, "table4")
        assert done.returncode == 0, done.stderr
        found = json.loads((study[0] / "results" / "table4.json").read_text())
        assert list(found["rows"]) == ["nGAN", "SMPL+dGAN", "SMPL+nGAN"]
        for row in found["rows"].values():
            assert row["missing"] == [0, 0]
            assert len(row["seeds"]) == 2
            assert row["seeds"][0] != row["seeds"][1]
            assert row["meshes"] == [1, 1]
        for k, column in enumerate(found["columns"]):
            means = {
                name: np.mean([seed[column] for seed in row["seeds"]])
                for name, row in found["rows"].items()
            }
            assert found["order"][column] == sorted(means, key=means.__getitem__), k
        text = (study[0] / "results" / "table4.md").read_text()
        assert text in done.stdout
        ours, theirs = text.split("As published, on THuman2.0:")
        best = found["order"]["CD"][0]
        values = [seed["CD"] for seed in found["rows"][best]["seeds"]]
        told = f"**{np.mean(values):.4f} ± {np.ptp(values) / 2:.4f}**"
        assert told in ours
        assert "0.1227" not in ours
        assert "0.1227" in theirs
        assert "$ python pipeline.py train --config" in done.stdout
        latex = (study[0] / "results" / "table4.tex").read_text()
        assert "\\textbf{" in latex

    def test_table_1_adds_bounds_and_the_methods_that_are_there(
        self, study: tuple[Path, Path], people: Path, oracle: Path
    ) -> None:
        others = study[0] / "others" / "PIFuHD"
        others.mkdir(parents=True, exist_ok=True)
        shutil.copy(oracle / f"{TEST}_00.ply", others)
        (study[0] / "others" / "nothing yet").mkdir(exist_ok=True)
        done = experiment(study, "table1")
        assert done.returncode == 0, done.stderr
        found = json.loads((study[0] / "results" / "table1.json").read_text())
        assert list(found["rows"]) == [
            "PIFuHD",
            "NormalGAN's way, trained here",
            "the paper's way, trained here",
            "given: sensor and bare body fused",
            "oracle: true depths fused",
        ]
        oracle_row = found["rows"]["oracle: true depths fused"]
        assert oracle_row["seeds"][0]["CD"] == found["rows"]["PIFuHD"]["seeds"][0]["CD"]
        assert not oracle_row["competes"]
        assert found["order"]["CD"][0] == "PIFuHD"
        assert "ICON" not in found["rows"]
        assert experiment(study, "table2").returncode == 0
        second = json.loads((study[0] / "results" / "table2.json").read_text())
        assert second["columns"] == ["L2 front", "L2 back", "L2 front, back"]

    @pytest.mark.parametrize("name", ["fig2", "fig9", "fig13", "fig14", "fig15"])
    def test_figures_come_with_what_is_behind_them(
        self, study: tuple[Path, Path], name: str
    ) -> None:
        done = experiment(study, name)
        assert done.returncode == 0, done.stderr
        found = json.loads((study[0] / "results" / f"{name}.json").read_text())
        assert found.get("test_subjects", [TEST]) == [TEST]
        with Image.open(study[0] / "results" / f"{name}.png") as image:
            assert min(image.size) > 300
            assert np.asarray(image.convert("L")).std() > 5
        if name == "fig14":
            assert list(found["powers"]) == ["100", "1000"]
        if name == "fig15":
            off = {way: of["mesh_to_truth_mm"] for way, of in found["ways"].items()}
            assert off["true depth, with"] < off["true depth, without"]

    def test_a_study_is_of_one_configuration(self, study: tuple[Path, Path]) -> None:
        given = ["experiment", "fig2", "--config", study[1], "--output", study[0]]
        done = run(*given, "--samples", "1000")
        assert done.returncode == 2
        assert "samples is 2000 there and 1000 here" in done.stderr

    def test_ctrl_c_ends_the_trainings_too_and_the_same_command_goes_on(
        self, study: tuple[Path, Path], tmp_path: Path
    ) -> None:
        given = ["experiment", "table3", "--config", study[1], "--output", tmp_path / "study"]
        process = subprocess.Popen(
            [sys.executable, str(ROOT / "pipeline.py"), *map(str, given)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        logs = tmp_path / "study" / "trainings"
        until(lambda: len(list(logs.glob("*.log"))) == 2, process)
        time.sleep(2)
        process.send_signal(signal.SIGINT)
        told, _ = process.communicate(timeout=30)
        assert process.returncode == 130
        assert "run the same command again to go on" in told
        assert run(*given).returncode == 0
        assert not [
            line
            for line in subprocess.run(
                ["ps", "ax", "-o", "args"], capture_output=True, text=True, check=True
            ).stdout.splitlines()
            if str(tmp_path) in line
        ]


def until(true: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait for something, no longer than the process lives."""
    begun = time.monotonic()
    while not true():
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() - begun < 120
        time.sleep(0.1)
