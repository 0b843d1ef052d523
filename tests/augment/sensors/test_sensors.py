"""Every depth sensor against its published table, its slow reference, and what it must leave."""

from __future__ import annotations

import copy
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from scipy import stats

import seeds
from augment.sensors import MODULES, SENSORS, Grid, NormalGAN, read, sensor_of
from augment.sensors.view import View

GRID = Grid(pixel_size=0.005, distance=2.0)
DISTANCES, ANGLES = (0.8, 1.0, 1.5, 2.0, 3.0, 4.0), (0, 30, 60, 75, 80)
DRAWS = 100_000
# Five standard errors of a standard deviation from 1e5 draws.
CLOSE = 0.011
GAUSSIAN: dict[str, dict[str, Any]] = {
    "normalgan": {},
    "kinect_v2": {
        "lateral": 0, "mixed": 0, "graze_deg": (90, 90), "dark": 0, "millimetres": False,
        "range": (0.1, 9.0),
    },
    "kinect_v1": {"lateral": 0},
    "azure": {"shift": 0},
}  # fmt: skip
"""Each model with its Gaussian part alone."""

# Millimetres at 0, 60 and 80 degrees, as published.
FANKHAUSER = {
    1.0: (1.300, 1.700, 7.70),
    2.0: (1.700, 2.831, 19.80),
    3.0: (2.700, 4.778, 35.96),
    4.0: (4.300, 7.500, 55.5),
}


def published(name: str, z: float, angle_deg: float) -> float:
    """Standard deviation in metres by the formula of the model's paper."""
    angle = math.radians(angle_deg)
    right = 1.58 if name == "normalgan" else math.pi / 2
    ratio = angle / (right - angle)
    if name == "kinect_v1":
        return 0.0012 + 0.0019 * (z - 0.4) ** 2 + 0.0001 / math.sqrt(z) * ratio**2
    if name == "azure":
        return 0.0005 + 0.001 * max(z - 0.5, 0)
    return (1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * ratio**2) / 1000


def gaussian(name: str) -> Any:
    return sensor_of(name, **GAUSSIAN[name])


class TestPublished:
    @pytest.mark.parametrize("name", GAUSSIAN)
    @pytest.mark.parametrize("angle", ANGLES)
    @pytest.mark.parametrize("z", DISTANCES)
    def test_noise_has_its_sigma_and_shape(
        self, plane: Callable, name: str, z: float, angle: float
    ) -> None:
        scene = plane(z, angle, parallel=name == "normalgan")
        reading = scene.sense(gaussian(name), seed=int(10 * z) + 100 * angle)
        error = (reading.depth.astype(np.float64) - scene.depth).ravel()
        sigma = published(name, z, angle)
        assert reading.valid.all()
        assert len(error) == DRAWS
        assert error.std() == pytest.approx(sigma, rel=CLOSE)
        np.testing.assert_allclose(reading.sigma, sigma, rtol=1e-3)
        assert abs(error.mean()) < 5 * sigma / math.sqrt(DRAWS)
        assert stats.kstest(error / sigma, "norm").pvalue > 1e-4
        image = error.reshape(scene.depth.shape)
        for shifted in (image[:, 1:] * image[:, :-1], image[1:] * image[:-1]):
            assert abs(shifted.mean()) / sigma**2 < 5 / math.sqrt(shifted.size)

    @pytest.mark.parametrize("z", FANKHAUSER)
    def test_table_of_the_second_kinect(self, plane: Callable, z: float) -> None:
        for angle, millimetres in zip((0, 60, 80), FANKHAUSER[z], strict=True):
            scene = plane(z, angle, shape=(3, 3))
            sigma = scene.sense(gaussian("kinect_v2")).sigma
            np.testing.assert_allclose(1000 * sigma, millimetres, rtol=2e-3)

    @pytest.mark.parametrize(
        ("name", "coefficients"),
        [
            ("normalgan", (1.5, -0.5, 0.3, 0.1)),
            ("kinect_v2", (1.5, -0.5, 0.3, 0.1)),
            ("kinect_v1", (1.2, 1.9, 0.1)),
            ("azure", (0.5, 1.0)),
        ],
    )
    def test_coefficients_come_back(
        self, plane: Callable, name: str, coefficients: tuple[float, ...]
    ) -> None:
        """Fitted to measured noise, in millimetres."""
        right = 1.58 if name == "normalgan" else math.pi / 2
        terms, measured = [], []
        for z in DISTANCES:
            for angle_deg in ANGLES:
                scene = plane(z, angle_deg, parallel=name == "normalgan")
                reading = scene.sense(gaussian(name), seed=int(10 * z) + 100 * angle_deg)
                measured.append(1000 * (reading.depth.astype(np.float64) - z).std())
                ratio = math.radians(angle_deg) / (right - math.radians(angle_deg))
                terms.append(
                    {
                        "kinect_v1": (1, (z - 0.4) ** 2, ratio**2 / math.sqrt(z)),
                        "azure": (1, max(z - 0.5, 0)),
                    }.get(name, (1, z, z**2, z**1.5 * ratio**2))
                )
        rows = np.array(terms) / np.array(measured)[:, None]
        found, *_ = np.linalg.lstsq(rows, np.ones(30), rcond=None)
        errors = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)) / (2 * DRAWS))
        assert errors.max() < 0.01
        assert (np.abs(found - coefficients) < 5 * errors).all()


# Every switch of every model, the other parts on.
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in SENSORS),
    *((name, {"distance": 1.7, "noise": 2.0}) for name in SENSORS),
    ("normalgan", {"truncate": True}),
    ("normalgan", {"contour_jitter": 0.4}),
    ("kinect_v2", {"lateral": 0}),
    ("kinect_v2", {"lateral": 0.01, "noise": 0}),
    ("kinect_v2", {"mixed": 0}),
    ("kinect_v2", {"mixed": 1, "step": 0.12}),
    ("kinect_v2", {"mixed": 1, "step": 0.2, "background": 2.6}),
    ("kinect_v2", {"graze_deg": (90, 90)}),
    ("kinect_v2", {"graze_deg": (20, 60)}),
    ("kinect_v2", {"dark": 0}),
    ("kinect_v2", {"dark": 0, "graze_deg": (90, 90)}),
    ("kinect_v2", {"millimetres": False}),
    ("kinect_v2", {"range": (1.9, 2.0)}),
    ("tof", {"amplitude": 60.0}),
    ("tof", {"amplitude": 20.0, "infrared_floor": 0.3}),
    ("tof", {"read_noise": 8.0, "jitter": 0.0}),
    ("tof", {"spread": 0.0}),
    ("tof", {"spread": 1.0, "background": 2.3, "background_albedo": 1.0}),
    ("tof", {"background_albedo": 0.0}),
    ("tof", {"background_albedo": 0.0, "drop_flying": False}),
    ("tof", {"wiggling": 0.01, "offset": 0.03}),
    ("tof", {"wiggling": 0.1, "amplitude": 10000}),
    ("tof", {"wiggling": 0.15, "amplitude": 3000}),
    ("tof", {"wiggling": 0.15, "amplitude": 4000}),
    ("tof", {"wiggling": 0.2, "amplitude": 600}),
    ("tof", {"range": (1.9, 2.0)}),
    ("kinect_v1", {"lateral": 0}),
    ("kinect_v1", {"lateral": 3}),
    ("azure", {"shift": 0}),
    ("azure", {"shift": 3}),
    ("azure", {"step": 0}),
    ("azure", {"step": 0.1, "background": 2.1}),
    ("azure", {"dark": 0}),
    ("azure", {"dark": 203}),
    ("azure", {"dark": 204}),
]


def test_published_defaults() -> None:
    """Of Fankhauser et al. 2015, NormalGAN's script and BlenderProc."""
    assert sensor_of("kinect_v2") == sensor_of("kinect_v2", lateral=0.0016)
    assert sensor_of("azure") == sensor_of("azure", shift=0.25, step=0.8, dark=15.0)
    assert sensor_of("normalgan") == sensor_of("normalgan", truncate=False, contour_jitter=0.0)
    assert all(sensor_of(name).distance == 2.0 for name in SENSORS)


class TestReference:
    @pytest.mark.parametrize(("name", "parameters"), VARIANTS)
    @pytest.mark.parametrize("seed", [0, 1])
    def test_pixel_by_pixel(
        self, scene: Any, reference: Callable, name: str, parameters: dict[str, Any], seed: int
    ) -> None:
        if seed:  # the second time the picture's border cuts through it
            scene = scene.part(slice(4, 30), slice(6, 40))
        sensor = sensor_of(name, **parameters)
        reading = scene.sense(sensor, seed)
        expected = reference(name, scene, sensor, seed)
        assert len(expected) == scene.mask.sum() > 500
        # Rounding may fall the other way in single precision, at a step of the sensor's own.
        different = 0
        for place, (depth, sigma) in expected.items():
            assert reading.sigma[place] == pytest.approx(sigma, rel=2e-5)
            different += abs(float(reading.depth[place]) - depth) > 3e-6
            assert reading.valid[place] == (reading.depth[place] > 0)
        assert different <= 2


class TestTimeOfFlight:
    @pytest.mark.parametrize("z", [0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0])
    def test_noise_of_a_wall_is_the_published_one(self, plane: Callable, z: float) -> None:
        scene = plane(z, 0, shape=(252, 402))
        reading = scene.sense(sensor_of("tof"), seed=int(10 * z))
        assert reading.valid.all()
        inner = (slice(1, -1), slice(1, -1))  # nothing lights the border's pixels from beyond
        error = (reading.depth.astype(np.float64) - scene.depth)[inner]
        assert error.size == DRAWS
        assert error.std() == pytest.approx(published("kinect_v2", z, 0), rel=0.15)
        np.testing.assert_allclose(reading.sigma[inner].mean(), error.std(), rtol=CLOSE)
        assert abs(error.mean()) < 5 * error.std() / math.sqrt(DRAWS) + 2e-6
        assert stats.kstest((error / error.std()).ravel(), "norm").pvalue > 1e-4
        for shifted in (error[:, 1:] * error[:, :-1], error[1:] * error[:-1]):
            assert abs(shifted.mean()) / error.var() < 5 / math.sqrt(shifted.size)

    def test_mixed_pixels_lie_between_near_and_far(self, plane: Callable) -> None:
        """A board that covers half of a wall 30 cm behind it; nothing is noisy."""
        near, far = plane(1.7, 0, shape=(60, 60)), plane(2.0, 0, shape=(60, 60))
        for map_ in ("depth", "normal", "albedo"):
            getattr(far, map_)[:, :30] = getattr(near, map_)[:, :30]
        quiet = {"noise": 0.0, "drop_flying": False}
        depth = far.sense(sensor_of("tof", **quiet)).depth
        edge = depth[5:-5, 29:31]
        assert (edge > 1.7 + 1e-3).all()
        assert (edge < 2.0 - 1e-3).all()
        np.testing.assert_allclose(depth[5:-5, 5:25], 1.7, atol=2e-5)
        np.testing.assert_allclose(depth[5:-5, 35:-5], 2.0, atol=2e-5)
        apart = far.sense(sensor_of("tof", spread=0.0, **quiet)).depth
        np.testing.assert_allclose(apart[5:-5, 29], 1.7, atol=2e-5)

    def test_outlines_mix_with_the_wall_and_fly(self, scene: Any) -> None:
        kept = scene.sense(sensor_of("tof", noise=0.0, drop_flying=False))
        dropped = scene.sense(sensor_of("tof", noise=0.0))
        inside = scene.mask.copy()
        for axis in (0, 1):
            for step in (1, -1):
                inside &= np.roll(scene.mask, step, axis)
        outline = scene.mask & ~inside & kept.valid
        behind = kept.depth[outline] - scene.depth[outline]
        assert (behind > 0).mean() > 0.9
        assert not (dropped.valid & ~kept.valid).any()
        assert (kept.valid & ~dropped.valid).sum() > 5

    def test_hair_is_lost_by_itself(self, plane: Callable) -> None:
        """Strands of a pixel's width before the wall, and as dark a surface that is broad."""
        scene = plane(1.9, 0, parallel=True, shape=(60, 60))
        scene.albedo[:] = 0.05
        scene.mask[:] = False
        scene.mask[:, 5:28:4] = scene.mask[:, 30:50] = True
        scene.depth[~scene.mask] = 0
        right = np.abs(scene.sense(sensor_of("tof")).depth - 1.9) < 0.02
        assert right[5:-5, 5:28:4].mean() < 0.1
        assert right[5:-5, 33:47].mean() > 0.9

    def test_least_light(self, plane: Callable) -> None:
        """All three frequencies together return 10, whatever each of them does."""
        scene = plane(1.0, 0, shape=(5, 5))
        for amplitude, enough in ((3.30, False), (3.37, True)):
            quiet = sensor_of("tof", noise=0.0, amplitude=amplitude)
            assert scene.sense(quiet).valid[2, 2] == enough

    @pytest.mark.parametrize("amplitude", [20.0, 40.0])
    def test_little_light_is_no_wrong_wrap(self, plane: Callable, amplitude: float) -> None:
        """What cannot be unwrapped is lost and not read metres off."""
        reading = plane(2.0, 0).sense(sensor_of("tof", amplitude=amplitude))
        assert 0.3 < reading.valid.mean() < 1
        assert (np.abs(reading.depth - 2.0)[reading.valid] > 0.3).mean() < 1e-3

    def test_dark_and_grazing_surfaces_are_lost(self, plane: Callable) -> None:
        bright, dark = plane(2.0, 0), plane(2.0, 0)
        dark.albedo[:] = 0.005
        assert bright.sense(sensor_of("tof")).valid.all()
        assert dark.sense(sensor_of("tof", infrared_floor=0.0)).valid.mean() < 0.01
        assert dark.sense(sensor_of("tof", infrared_floor=0.1)).valid.all()
        assert plane(2.0, 80).sense(sensor_of("tof")).valid.all()
        assert plane(2.0, 89.9).sense(sensor_of("tof")).valid.mean() < 0.2

    def test_offset_and_wiggling(self, plane: Callable) -> None:
        quiet = {"noise": 0.0, "drop_flying": False}
        for z in (1.0, 2.345, 4.0):
            scene = plane(z, 0, shape=(5, 5))
            far = scene.sense(sensor_of("tof", offset=0.02, **quiet)).depth
            np.testing.assert_allclose(far, z + 0.02, atol=1e-5)
        distances = np.linspace(1.0, 2.9, 200)
        wiggling = sensor_of("tof", wiggling=0.01, **quiet)
        errors = [plane(z, 0, shape=(1, 1)).sense(wiggling).depth[0, 0] - z for z in distances]
        assert 0.005 < np.max(errors) <= 0.0101
        assert -0.0101 <= np.min(errors) < -0.005

    def test_wraps_are_told_apart_up_to_its_range(self, plane: Callable) -> None:
        """Beyond each frequency's own period."""
        sensor = sensor_of("tof", noise=0.0, drop_flying=False, range=(0.1, 9.0))
        for z in np.arange(0.3, 8.5, 0.1):
            depth = plane(float(z), 0, shape=(3, 3)).sense(sensor).depth
            np.testing.assert_allclose(depth, z, atol=2e-5)


class TestKinectV2:
    def test_lateral_noise_moves_places_and_adds_nothing(self, plane: Callable) -> None:
        """Facing the device nothing changes; on a slope depth moves by the slope."""
        only = GAUSSIAN["kinect_v2"] | {"noise": 0.0, "lateral": 0.0016}
        flat = plane(2.0, 0, parallel=True).sense(sensor_of("kinect_v2", **only))
        np.testing.assert_allclose(flat.depth[5:-5, 5:-5], 2.0, atol=1e-6)
        shape = (200, 200)
        scene = plane(2.0, 45, parallel=True, shape=shape)
        # n = (s, 0, c): depth grows to the right by tan(45) = 1 per metre, or falls.
        sign = np.sign(scene.normal[0, 0, 0])
        columns = np.arange(shape[1]) + 0.5 - shape[1] / 2
        scene.depth[:] = 2.0 + sign * columns * 0.005
        error = scene.sense(sensor_of("kinect_v2", **only)).depth - scene.depth
        assert error[3:-3, 3:-3].std() == pytest.approx(0.0016, rel=0.02)

    @pytest.mark.parametrize("behind", [2.0, None])
    def test_mixed_pixels_lie_between(self, plane: Callable, behind: float | None) -> None:
        """At a depth step and at the outline: a board before a second one, or before the wall."""
        shape = (4000, 30)
        scene, far = plane(1.7, 0, shape=shape), plane(behind or 3.5, 0, shape=shape)
        for map_ in ("depth", "normal", "mask"):
            getattr(scene, map_)[:, 15:] = getattr(far, map_)[:, 15:]
        if behind is None:
            scene.mask[:, 15:] = False
            scene.depth[:, 15:] = 0
        only = GAUSSIAN["kinect_v2"] | {"noise": 0.0}
        reading = scene.sense(sensor_of("kinect_v2", **(only | {"mixed": 0.3})))
        mixed = np.abs(reading.depth - scene.depth) > 1e-6
        assert not mixed[:, :14].any()
        assert not mixed[:, 15:].any()
        assert mixed[:, 14].mean() == pytest.approx(0.3, abs=0.04)
        share = (reading.depth[mixed] - 1.7) / ((behind or 3.5) - 1.7)
        assert stats.kstest(share, "uniform").pvalue > 1e-3
        assert 0 < share.min() < share.max() < 1
        none = scene.sense(sensor_of("kinect_v2", **only))
        np.testing.assert_array_equal(none.depth, scene.depth)

    def test_lost_by_angle_and_darkness(self, plane: Callable) -> None:
        only = GAUSSIAN["kinect_v2"]
        by_angle = sensor_of("kinect_v2", **(only | {"graze_deg": (70, 88)}))
        assert plane(2.0, 60).sense(by_angle).valid.all()
        assert not plane(2.0, 89).sense(by_angle).valid.any()
        begin, end = math.cos(math.radians(70)), math.cos(math.radians(88))
        kept = (math.cos(math.radians(80)) - end) / (begin - end)
        assert plane(2.0, 80).sense(by_angle).valid.mean() == pytest.approx(kept, abs=0.01)
        by_dark = sensor_of("kinect_v2", **(only | {"dark": 0.02}))
        scene = plane(2.0, 0)
        scene.albedo[:] = 0.005
        assert scene.sense(by_dark).valid.mean() == pytest.approx(0.25, abs=0.01)

    def test_whole_millimetres_and_range(self, plane: Callable) -> None:
        only = GAUSSIAN["kinect_v2"] | {"millimetres": True}
        depth = plane(2.0003, 0).sense(sensor_of("kinect_v2", **only)).depth
        off = 1000 * depth.astype(np.float64)
        assert np.abs(off - np.rint(off)).max() < 2e-3
        # Rounding to nearest has no bias.
        assert abs(depth.mean(dtype=np.float64) - 2.0003) < 5e-5
        for z in (0.4, 4.7):
            assert not plane(z, 0).sense(sensor_of("kinect_v2")).valid.any()
            assert not plane(z, 0).sense(sensor_of("tof")).valid.any()


class TestNormalGAN:
    def test_truncation_is_a_bias_of_half_a_millimetre(self, plane: Callable) -> None:
        scene = plane(2.0, 0, parallel=True)
        cut = scene.sense(sensor_of("normalgan", truncate=True)).depth.astype(np.float64)
        assert np.mean(cut - 2.0) == pytest.approx(-0.0005, abs=5 * 0.0017 / math.sqrt(DRAWS))
        assert np.abs(1000 * cut - np.rint(1000 * cut)).max() < 2e-3
        assert not NormalGAN.truncate

    def test_contour_jitter_cuts_the_contour_alone(self, scene: Any) -> None:
        whole = scene.sense(sensor_of("normalgan"))
        jittered = scene.sense(sensor_of("normalgan", contour_jitter=0.4))
        lost = whole.valid & ~jittered.valid
        assert 10 < lost.sum() < 0.5 * whole.valid.sum()
        near = scene.mask.copy()
        for _ in range(2):
            inside = near.copy()
            for axis in (0, 1):
                for step in (1, -1):
                    inside &= np.roll(near, step, axis)
            near = inside
        assert not (lost & near).any()
        np.testing.assert_array_equal(jittered.depth[jittered.valid], whole.depth[jittered.valid])


class TestAll:
    @pytest.mark.parametrize("name", SENSORS)
    def test_background_and_inputs_are_untouched_to_the_bit(self, scene: Any, name: str) -> None:
        maps = [scene.depth, scene.normal, scene.albedo, scene.mask]
        before = [m.tobytes() for m in maps]
        reading = scene.sense(sensor_of(name))
        assert [m.tobytes() for m in maps] == before
        assert not reading.depth[~scene.mask].any()
        assert not reading.valid[~scene.mask].any()
        assert not reading.sigma[~scene.mask].any()
        assert reading.depth.dtype == reading.sigma.dtype == np.float32
        assert reading.valid.dtype == bool
        np.testing.assert_array_equal(reading.valid, reading.depth > 0)
        assert np.isfinite(reading.depth).all()
        assert (reading.sigma[scene.mask] > 0).all()

    @pytest.mark.parametrize("name", SENSORS)
    def test_the_same_generator_reads_the_same(self, scene: Any, name: str) -> None:
        first, again, other = (scene.sense(sensor_of(name), seed) for seed in (3, 3, 4))
        assert first.depth.tobytes() == again.depth.tobytes()
        assert first.depth.tobytes() != other.depth.tobytes()

    @pytest.mark.parametrize("name", SENSORS)
    def test_an_empty_view(self, name: str) -> None:
        empty = np.zeros((6, 7), dtype=np.float32)
        reading = sensor_of(name).sense(
            empty, np.zeros((6, 7, 3)), empty, empty > 0, GRID, np.random.default_rng(0)
        )
        assert not reading.depth.any()

    @pytest.mark.parametrize("name", SENSORS)
    def test_a_device_elsewhere_sees_other_distances(self, plane: Callable, name: str) -> None:
        """1 m nearer, the noise is that of a distance of 1 m less."""
        near = plane(2.0, 0, parallel=True, shape=(3, 3)).sense(sensor_of(name, distance=1.0))
        there = plane(1.0, 0, parallel=True, shape=(3, 3)).sense(sensor_of(name))
        assert near.sigma[1, 1] == pytest.approx(there.sigma[1, 1], rel=1e-3)
        assert near.depth[1, 1] == pytest.approx(2.0, abs=0.05)

    @pytest.mark.parametrize("name", SENSORS)
    def test_noise_of_nothing_is_the_truth(self, plane: Callable, name: str) -> None:
        """With every part off, and on a surface that has no edge and nothing dark."""
        parameters = GAUSSIAN.get(name, {"spread": 0.0, "drop_flying": False}) | {"noise": 0.0}
        scene = plane(2.0, 30)
        reading = scene.sense(sensor_of(name, **parameters))
        np.testing.assert_allclose(reading.depth, scene.depth, atol=0 if name != "tof" else 2e-5)
        assert not reading.sigma.any()

    @pytest.mark.parametrize("name", SENSORS)
    def test_empty_frame_around_it_changes_nothing(self, scene: Any, name: str) -> None:
        """The foreground alone is read, wherever it lies in the picture."""
        wide = [(9, 9), (20, 20)]
        framed = copy.copy(scene)
        framed.depth, framed.albedo, framed.mask = (
            np.pad(m, wide) for m in (scene.depth, scene.albedo, scene.mask)
        )
        framed.normal = np.pad(scene.normal, [*wide, (0, 0)])
        a, b = scene.sense(sensor_of(name)), framed.sense(sensor_of(name))
        for here, there in zip(a, b, strict=True):
            np.testing.assert_array_equal(np.pad(here, wide), there)

    @pytest.mark.parametrize("name", SENSORS)
    def test_how_arrays_lie_in_memory_does_not_matter(self, scene: Any, name: str) -> None:
        maps = [scene.depth, scene.normal, scene.albedo, scene.mask]
        other = [np.repeat(np.asfortranarray(m), 2, axis=0)[::2] for m in maps]
        other[:3] = [m.astype(m.dtype.newbyteorder()) for m in other[:3]]
        other[0][~scene.mask] = -0.0
        for m in other:
            m.flags.writeable = False
        a, b = (
            sensor_of(name).sense(*given, GRID, np.random.default_rng(0)) for given in (maps, other)
        )
        assert b.depth.dtype == b.sigma.dtype == np.float32
        assert b.depth.dtype.isnative
        for here, there in zip(a, b, strict=True):
            np.testing.assert_array_equal(here, there)

    def test_every_half_precision_normal(self) -> None:
        """Shards hold these; a faster way than NumPy's makes them single."""
        half = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
        half = half[np.abs(half) <= 1]  # which leaves out NaN
        length = np.sqrt(1 - half.astype(np.float64) ** 2)
        normal = np.stack([half, np.zeros_like(half), length], axis=-1)[None].astype(np.float16)
        mask = np.ones(normal.shape[:2], dtype=bool)
        ones = mask.astype(np.float32)
        view = View(ones, normal, ones, mask, GRID, 2.0)
        assert view.normal_at.dtype == np.float32
        assert view.normal_at.T.tobytes() == normal[0].astype(np.float32).tobytes()

    def test_needs_numpy_alone(self) -> None:
        code = (
            "import sys, numpy; before = set(sys.modules); import augment.sensors\n"
            "new = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
            "print(*sorted(new - sys.stdlib_module_names - {'numpy'}))"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.stdout.split() == ["augment", "seeds"], done.stderr

    def test_no_reading_depends_on_the_sums_of_blas(self) -> None:
        """Nor so on its threads: who reads a shard again may have others than who made it."""
        code = (
            "import numpy as np\n"
            "from augment.sensors import Grid, SENSORS, sensor_of\n"
            "rng, shape = np.random.default_rng(0), (424, 512)\n"
            "depth = rng.uniform(1.5, 2.5, shape).astype('f4')\n"
            "normal = rng.standard_normal((*shape, 3)) + (0, 0, 3)\n"
            "normal /= np.linalg.norm(normal, axis=-1, keepdims=True)\n"
            "colour = rng.integers(0, 256, (*shape, 3), dtype='u1')\n"
            "maps = depth, normal.astype('f2'), colour, depth < 2.4, Grid(0.005, 2.0)\n"
            "import hashlib\n"
            "for name in SENSORS:\n"
            "    found = sensor_of(name).sense(*maps, np.random.default_rng(1))\n"
            "    print(name, *(hashlib.sha256(m.tobytes()).hexdigest() for m in found))"
        )
        said = set()
        for variables in (
            {"OPENBLAS_NUM_THREADS": "1"},
            {"OPENBLAS_NUM_THREADS": "2"},
            {"OPENBLAS_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Haswell"},
            {"OPENBLAS_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Nehalem"},
        ):
            done = subprocess.run(
                [sys.executable, "-c", code],
                env={**os.environ, **variables}, capture_output=True, text=True,
            )  # fmt: skip
            assert done.stdout.count("\n") == len(SENSORS), done.stderr
            said.add(done.stdout)
        assert len(said) == 1

    def test_brightness_of_colours(self) -> None:
        """Linear light by Rec. 709, and the grey of coded bytes by Rec. 601."""
        primaries = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [55, 55, 55]]], dtype="u1")
        ones = np.ones((1, 4), dtype=np.float32)
        normal = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (1, 4, 3))
        linear = np.where(primaries == 55, ((55 / 255 + 0.055) / 1.055) ** 2.4, primaries / 255)
        for albedo in (primaries, linear):
            view = View(ones, normal, albedo, ones > 0, GRID, 2.0)
            bright = [0.2126, 0.7152, 0.0722, linear[0, 3, 0]]
            np.testing.assert_allclose(view.luminance_at, bright, rtol=1e-6)
            np.testing.assert_array_equal(view.grey_at, [76, 150, 29, 55])

    @pytest.mark.parametrize("kind", ["f2", "f4", "f8"])
    def test_depth_of_any_precision(self, kind: str) -> None:
        depth = np.full((5, 7), 2.0, dtype=kind)
        normal = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (5, 7, 3))
        for name in SENSORS:
            reading = sensor_of(name).sense(
                depth, normal, depth / 2, depth > 0, GRID, np.random.default_rng(0)
            )
            assert reading.depth.dtype == np.float32
            np.testing.assert_allclose(reading.depth[1:-1, 1:-1], 2.0, atol=0.02)

    def test_colour_is_as_good_as_brightness(self, scene: Any) -> None:
        """Linear colour, and its sRGB bytes."""
        sensor = sensor_of("kinect_v2")
        grey = np.repeat(scene.albedo[..., None], 3, axis=-1)
        rng = np.random.default_rng
        a = sensor.sense(scene.depth, scene.normal, scene.albedo, scene.mask, GRID, rng(0))
        b = sensor.sense(scene.depth, scene.normal, grey, scene.mask, GRID, rng(0))
        np.testing.assert_array_equal(a.valid, b.valid)
        coded = np.where(
            grey <= 0.0031308, 12.92 * grey, 1.055 * np.maximum(grey, 1e-9) ** (1 / 2.4) - 0.055
        )
        eight = np.rint(255 * coded).astype(np.uint8)
        c = sensor.sense(scene.depth, scene.normal, eight, scene.mask, GRID, rng(0))
        assert (a.valid != c.valid).sum() < 5


class TestRefused:
    @pytest.mark.parametrize("name", SENSORS)
    @pytest.mark.parametrize(
        ("spoil", "said"),
        [
            (lambda m: m["depth"].__setitem__((18, 20), np.nan), "NaN"),
            (lambda m: m["depth"].__setitem__((0, 0), np.nan), "NaN"),
            (lambda m: m["depth"].__setitem__((18, 20), np.inf), "NaN, infinite"),
            (lambda m: m["depth"].__setitem__((0, 0), -1.0), "negative"),
            (lambda m: m["depth"].__setitem__((18, 20), 0.0), "0 inside the mask"),
            (lambda m: m["normal"].__setitem__((18, 20), 0.5), "not unit"),
            (lambda m: m["normal"].__setitem__((18, 20), np.nan), "not unit"),
            (lambda m: m.update(depth=m["depth"][1:]), "shapes disagree"),
            (lambda m: m.update(normal=m["normal"][..., :2]), "shapes disagree"),
            (lambda m: m.update(albedo=m["albedo"][1:]), "shapes disagree"),
            (lambda m: m.update(mask=m["mask"].astype(np.uint8)), "type uint8"),
            (lambda m: m.update(depth=(1e3 * m["depth"]).astype(np.uint16)), "type uint16"),
            (lambda m: m.update(depth=1e3 * m["depth"]), "give depth in metres"),
            (lambda m: m["depth"].__setitem__((18, 20), -1.0), "negative"),
            (lambda m: m["depth"].__setitem__((0, 0), np.inf), "NaN, infinite"),
            (lambda m: m.update(depth=m["depth"].astype(np.float64) * 1e300), "infinite"),
            (lambda m: m.update(normal=np.float16(1.01) * m["normal"].astype("f2")), "not unit"),
            (lambda m: m.update(normal=(np.nan * m["normal"]).astype("f2")), "not unit"),
            (lambda m: m.update(normal=(np.inf * m["normal"]).astype("f2")), "not unit"),
            (lambda m: m["albedo"].__setitem__((18, 20), 1.5), r"not in \[0, 1\]"),
            (lambda m: m["albedo"].__setitem__((18, 20), -0.1), r"not in \[0, 1\]"),
            (lambda m: m["albedo"].__setitem__((18, 20), np.nan), r"not in \[0, 1\]"),
            (lambda m: m.update(albedo=(255 * m["albedo"]).astype(int)), r"not in \[0, 1\]"),
            (lambda m: m.update(grid=Grid(0.0, 2.0)), "no grid"),
            (lambda m: m.update(grid=Grid(np.nan, 2.0)), "no grid"),
            (lambda m: m.update(grid=Grid(0.005, np.inf)), "no grid"),
            (lambda m: m.update(grid=Grid(0.005, 4.0)), "sensor.distance beyond the surface"),
            (lambda m: m.update({k: v[:0] for k, v in m.items() if k != "grid"}), "disagree"),
        ],
    )
    def test_maps_that_cannot_be(self, scene: Any, name: str, spoil: Callable, said: str) -> None:
        maps = {key: getattr(scene, key) for key in ("depth", "normal", "albedo", "mask")}
        maps["grid"] = GRID
        with np.errstate(invalid="ignore"):
            spoil(maps)
        rng = np.random.default_rng(0)
        with pytest.raises(ValueError, match=said) as caught:
            sensor_of(name).sense(**maps, rng=rng)
        assert "\n" not in str(caught.value)
        # Before any work: nothing was drawn.
        assert rng.random() == np.random.default_rng(0).random()

    def test_unknown_names_are_told_the_known_ones(self) -> None:
        known = "normalgan, kinect_v2, tof, kinect_v1, azure"
        with pytest.raises(ValueError, match=f"^sensor 'kinect_v3' is no model; known: {known} "):
            sensor_of("kinect_v3")

    def test_modules_of_ones_own_are_asked(self, monkeypatch) -> None:
        monkeypatch.setenv(MODULES, "json,no.such_module")
        with pytest.raises(ImportError, match=rf"^{MODULES} names no.such_module: No module"):
            sensor_of("kinect_v3")
        monkeypatch.setenv(MODULES, "json")
        with pytest.raises(ValueError, match=f"own, name the module in {MODULES}"):
            sensor_of("kinect_v3")

    @pytest.mark.parametrize(
        ("name", "parameters"),
        [
            ("normalgan", {"noise": -1}), ("normalgan", {"distance": 0}),
            ("normalgan", {"contour_jitter": 2}), ("kinect_v1", {"lateral": -1}),
            ("kinect_v2", {"mixed": 2}), ("kinect_v2", {"graze_deg": (80, 70)}),
            ("kinect_v2", {"range": (2, 1)}), ("azure", {"shift": -1}), ("tof", {"amplitude": 0}),
            ("tof", {"background_albedo": 2}), ("tof", {"range": (2, 1)}),
            ("tof", {"spread": 2}), ("tof", {"read_noise": -1}), ("tof", {"offset": 2}),
            ("azure", {"step": -1}), ("azure", {"dark": 256}), ("azure", {"background": 0}),
            ("normalgan", {"noise": math.nan}), ("normalgan", {"distance": math.inf}),
            ("normalgan", {"noise": "1"}), ("normalgan", {"noise": True}),
            ("normalgan", {"truncate": "no"}), ("kinect_v2", {"millimetres": 1}),
            ("kinect_v2", {"range": (0.5,)}), ("kinect_v2", {"range": 4.5}),
            ("kinect_v2", {"graze_deg": (70, None)}), ("kinect_v2", {"lateral": None}),
        ],
    )  # fmt: skip
    def test_parameters_out_of_bounds(self, name: str, parameters: dict[str, Any]) -> None:
        with pytest.raises(ValueError, match=rf"^sensor\.{next(iter(parameters))}: "):
            sensor_of(name, **parameters)


class TestRead:
    """A sensor read again from a shard."""

    @pytest.fixture
    def shard(self, scene: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        sensor = sensor_of("kinect_v2", noise=2.0, distance=1.8, range=(0.4, 4.0))
        coded = np.where(scene.mask, 30 + 5 * np.arange(scene.mask.shape[1]), 0)
        view = {
            "depth_front": scene.depth,
            "normal_front": scene.normal.astype(np.float16),
            "rgb_front": np.repeat(coded[..., None], 3, axis=-1).astype(np.uint8),
            "mask": scene.mask,
        }
        meta = {
            "seed": 7,
            "subject": "s0",
            "camera": {"pixel_size": 0.005, "distance": 2.0},
            "sensor": {"model": sensor.name, **asdict(sensor)},
        }
        return view, json.loads(json.dumps(meta))

    def test_is_what_its_meta_says(self, shard: Any) -> None:
        view, meta = shard
        reading = read(view, meta, 3, 1)
        expected = sensor_of("kinect_v2", noise=2.0, distance=1.8, range=(0.4, 4.0)).sense(
            *view.values(), GRID, seeds.generator(7, "s0", "sensor", 3, 1)
        )
        for given, made in zip(reading, expected, strict=True):
            assert given.tobytes() == made.tobytes()

    def test_draws_are_keyed(self, shard: Any) -> None:
        """By seed, subject, view and draw: each other one is another reading, and none is twice."""
        view, meta = shard
        readings = {
            read(view, {**meta, **key}, index, draw).depth.tobytes()
            for key in ({}, {"seed": 8}, {"subject": "s1"})
            for index in (0, 1)
            for draw in (0, 1)
        }
        assert len(readings) == 12

    @pytest.mark.parametrize(
        ("spoil", "said"),
        [
            (lambda v, m: m["sensor"].update(model="kinect_v3"), "known: normalgan, kinect_v2"),
            (lambda v, m: m["sensor"].update(noise=-1), "sensor.noise"),
            (lambda v, m: m["sensor"].update(noise="1"), "sensor.noise"),
            (lambda v, m: m["sensor"].update(range=[1]), "sensor.range"),
            (lambda v, m: m["sensor"].update(distance=0.05), "sensor.distance beyond"),
            (lambda v, m: m["camera"].update(pixel_size=-0.005), "no grid"),
            (lambda v, m: v.update(mask=v["mask"][1:]), "shapes disagree"),
            (lambda v, m: v.update({k: a[None] for k, a in v.items()}), "shapes disagree"),
            (lambda v, m: v.update(normal_front=v["normal_front"] * 2), "not unit"),
            (lambda v, m: m["sensor"].update(nois=1.0), "has no parameter 'nois'; it has distance"),
            (lambda v, m: v.pop("rgb_front"), "the view has no rgb_front"),
            (lambda v, m: m.update(base={"shard": "a"}), r"view and meta of shard\.base"),
        ],
    )
    def test_nonsense_is_refused(self, shard: Any, spoil: Callable, said: str) -> None:
        view, meta = shard
        spoil(view, meta)
        with pytest.raises(ValueError, match=said):
            read(view, meta, 0)

    @pytest.mark.parametrize(("index", "draw"), [(-1, 0), (0, -1)])
    def test_views_and_draws_are_counted_from_0(self, shard: Any, index: int, draw: int) -> None:
        with pytest.raises(ValueError, match="both are counted from 0"):
            read(*shard, index, draw)
