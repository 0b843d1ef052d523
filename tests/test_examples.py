"""The examples, run as their first lines say, and what comes out of them."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh

from augment import sensors
from engine.tasks import read_subject, subject_folder
from shards.dataset import Dataset
from shards.verify import verify
from tests.test_survival import write_scans

ROOT = Path(__file__).parents[1]


def run(*arguments: object, fails: bool = False, **environment: str) -> str:
    """What a Python command says that ends well; or, of one that `fails`, its errors."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    assert (done.returncode != 0) == fails, done.stderr
    return done.stderr if fails else done.stdout


@pytest.fixture
def stereo(monkeypatch):
    """The new sensor is known, as in a process of its own, until the test ends."""
    monkeypatch.setattr(sensors, "SENSORS", sensors.SENSORS.copy())
    monkeypatch.delitem(sys.modules, "examples.new_sensor", raising=False)
    return importlib.import_module("examples.new_sensor").Stereo


@pytest.fixture(scope="module")
def vases(tmp_path_factory) -> Path:
    """What the new source makes."""
    folder = tmp_path_factory.mktemp("vases") / "data"
    run(
        *("pipeline.py", "build", "--config", "examples/new_source.yaml", "--output", folder),
        *("--subjects.count", 3, "--cycles.samples", 2, "--sensor", "examples.new_sensor.Stereo"),
        *("--sensor.baseline", 0.12),
    )
    return folder


def test_a_new_source_is_as_good_as_the_others(vases):
    report = verify(vases)
    assert report.ok, report.breaches
    dataset = Dataset(vases)
    assert dataset.subjects() == ["vase_0000", "vase_0001", "vase_0002"]
    assert dataset.description["versions"].keys() >= {"trimesh"}
    heights = dataset.shard("vase_0000")["mask"].any(axis=2).sum(axis=1) * 0.005
    np.testing.assert_allclose(heights, 1.6, atol=0.01)


def test_a_new_sensor_is_read_again_by_its_model(vases, stereo):
    shard = Dataset(vases).shard("vase_0001")
    assert shard.meta["sensor"]["model"] == stereo.name
    view = shard.view(1)
    again = sensors.read(view, shard.meta, 1)
    assert np.array_equal(again.depth, view["depth_sensor"])
    mask = view["mask"]
    z = (again.depth - view["depth_front"])[mask] / again.sigma[mask]
    assert abs(z.mean()) < 0.02
    # A step of a sixteenth of a pixel adds its own part to a noise of a tenth.
    assert z.std() == pytest.approx(np.sqrt(1 + (1 / 16) ** 2 / 12 / 0.1**2), abs=0.02)
    assert len(np.unique(again.depth[mask])) < 200


def test_commands_find_a_new_sensor_where_they_are_told(vases, tmp_path):
    """In all their processes; and who does not tell them is told."""
    known = {"RECTOVERSO_SENSORS": "examples.new_sensor"}
    page = tmp_path / "page.html"
    report = ("pipeline.py", "report", vases, "--output", page, "--jobs", 2)
    run(*report)
    assert "There are no residuals" in page.read_text()
    run(*report, **known)
    spread = re.search(r"residuals lie within (\S+) standard", page.read_text())
    assert spread is not None
    assert float(spread[1]) == pytest.approx(1.02, abs=0.02)
    train = (
        *("pipeline.py", "train", "--config", "configs/train_front_cpu.yaml", "--data", vases),
        *("--epochs", 1, "--batch", 2, "--views.size", "[32, 32]", "--output"),
    )
    said = run(*train, tmp_path / "unknown", fails=True)
    assert said.startswith("error: sensor 'stereo' is no model; known: normalgan")
    assert "train with --views.noise stored" in said
    assert said.count("\n") == 1
    said = run(*train, tmp_path / "wrong", fails=True, RECTOVERSO_SENSORS="examples.newsensor")
    assert said == (
        "error: RECTOVERSO_SENSORS names examples.newsensor: No module named 'examples.newsensor'\n"
    )
    assert "1 epochs in" in run(*train, tmp_path / "known", **known)


def test_a_new_pass_lies_on_the_depth(tmp_path):
    """Its coordinates are those of the surface's point that the depth shows."""
    config, data = write_scans(tmp_path, 1), tmp_path / "data"
    run("pipeline.py", "build", "--config", config, "--output", data)
    run("-m", "examples.new_pass", data, "--output", tmp_path / "uv")
    shard = Dataset(data).shard("s0")
    surface = read_subject(subject_folder(data, "s0")).surface()
    with np.load(tmp_path / "uv" / "s0.npz") as maps:
        assert set(maps) == {"uv_front", "uv_back"}
        for side in ("front", "back"):
            uv, mask = maps[f"uv_{side}"], shard["mask"]
            assert uv.shape == (*mask.shape, 2)
            assert not uv[~mask].any()
            for view, seen in enumerate(mask):
                points = world(shard, view, side)[seen]
                squared, face, there = igl.point_mesh_squared_distance(
                    points, surface.vertices, surface.faces
                )
                assert squared.max() < 1e-5**2
                share = trimesh.triangles.points_to_barycentric(
                    surface.vertices[surface.faces[face]], there
                )
                expected = np.einsum("nc,ncd->nd", share, surface.uv[face])
                error = np.abs(uv[view][seen] - expected).max(axis=1)
                # At an edge the neighbour's coordinates are as good, where they differ.
                assert np.quantile(error, 0.999) < 2e-4


def world(shard, view: int, side: str) -> np.ndarray:
    """(H, W, 3) metres in the subject's world, of every pixel."""
    camera = shard.meta["camera"]
    rows, columns = camera["size"]
    x = (np.arange(columns) + 0.5 - columns / 2) * camera["pixel_size"]
    y = (rows / 2 - np.arange(rows) - 0.5) * camera["pixel_size"]
    grid = np.stack(np.broadcast_arrays(x, y[:, None], -shard[f"depth_{side}"][view]), axis=-1)
    to_world = shard["camera_to_world"][view]
    return grid @ to_world[:3, :3].T + to_world[:3, 3]


def test_shards_are_read_as_the_examples_do(vases):
    said = run("examples/read_numpy.py", vases / "shards" / "vase_0000.npz")
    assert "depth_back         float32  (3, 424, 512)" in said
    assert "vase_0000, CC0-1.0: 0." in said
    said = run("examples/read_views.py", vases)
    assert said.count("sensor off by") == 4
