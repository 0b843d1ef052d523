"""The figure of the depth sensors."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from augment.sensors import SENSORS, sensor_of
from report.sensors import GAUSSIAN_PART, measured, normals, published


@pytest.mark.parametrize("name", SENSORS)
def test_dots_lie_on_their_lines(name: str) -> None:
    sensor = sensor_of(name, **GAUSSIAN_PART.get(name, {}))
    for z, angle in ((1.0, 0.0), (3.0, 0.0), (2.0, 1.0)):
        line = float(published(name, np.array(z), np.array(angle)))
        # Of tof the line is another device's, and only that of a surface that faces it.
        near = 0.15 if name == "tof" else 5 / math.sqrt(2 * 120**2)
        if name != "tof" or angle == 0:
            assert measured(sensor, z, angle) == pytest.approx(line, rel=near)


def test_normals_of_a_slope() -> None:
    """It falls away to the right by 45 degrees, so it looks to the right."""
    depth = np.tile(2 + 0.005 * np.arange(9), (7, 1)).astype(np.float32)
    colours = normals(depth, 0.005)
    half = math.sqrt(0.5)
    np.testing.assert_allclose(colours[3, 4], 127.5 * (np.array([half, 0, half]) + 1), atol=1)
    depth[0, 0] = 0
    assert (normals(depth, 0.005)[0, 0] == 255).all()


def test_a_folder_that_is_no_dataset(tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-m", "report.sensors", str(tmp_path), "--output", "a.png"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 2
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
