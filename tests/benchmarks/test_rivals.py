"""What the comparison with other renderers stands on: its meshes, its samples, its stopwatch."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from benchmarks.humans import bisected
from benchmarks.rivals import equal_samples
from benchmarks.watch import seconds_watched, watching
from subjects.mesh import Mesh


@pytest.fixture
def ball() -> Mesh:
    """A closed surface whose texture coordinates are its positions' own."""
    solid = trimesh.creation.icosphere(subdivisions=2)
    uv = solid.vertices[solid.faces][..., :2].astype(np.float32)
    return Mesh(solid.vertices, solid.faces, uv=uv)


@pytest.mark.parametrize("faces", [321, 500, 2000])
def test_a_surface_cut_finer_is_the_same_surface(ball, faces):
    fine = bisected(ball, faces)
    assert faces <= len(fine.faces) <= faces + 1
    before, after = (trimesh.Trimesh(m.vertices, m.faces, process=False) for m in (ball, fine))
    assert after.is_watertight
    assert after.area == pytest.approx(before.area)
    assert after.volume == pytest.approx(before.volume)
    np.testing.assert_allclose(fine.uv, fine.vertices[fine.faces][..., :2], atol=1e-6)


def test_equal_error_lies_between_the_samples_that_were_tried():
    errors = {8: 2.0, 16: 1.0, 32: 0.5, 64: 0.25}
    assert equal_samples(errors, 0.5) == 32
    assert 16 < equal_samples(errors, 0.7) < 32
    assert equal_samples(errors, 9.0) == 8


def test_render_calls_of_another_process_are_timed(tmp_path):
    code = """
import render.scene
render.scene.reset()
try:
    render.scene.bpy.ops.render.render()
except RuntimeError:  # there is no camera
    pass
"""
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", code], cwd=root, env=watching(tmp_path), check=True)
    assert len(seconds_watched(tmp_path)) == 1
