"""Every depth sensor against its published table, its slow reference, and what it must leave."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from augment.sensors import SENSORS, sensor_of

DISTANCES, ANGLES = (0.8, 1.0, 1.5, 2.0, 3.0, 4.0), (0, 30, 60, 75, 80)
DRAWS = 100_000
# Five standard errors of a standard deviation from 1e5 draws.
CLOSE = 0.011
GAUSSIAN = {
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
                reading = scene.sense(gaussian(name), seed=angle_deg)
                measured.append(1000 * (reading.depth.astype(np.float64) - z).std())
                ratio = math.radians(angle_deg) / (right - math.radians(angle_deg))
                terms.append(
                    {
                        "kinect_v1": (1, (z - 0.4) ** 2, ratio**2 / math.sqrt(z)),
                        "azure": (1, max(z - 0.5, 0)),
                    }.get(name, (1, z, z**2, z**1.5 * ratio**2))
                )
        weight = 1 / np.array(measured)
        found, *_ = np.linalg.lstsq(np.array(terms) * weight[:, None], np.ones(30), rcond=None)
        np.testing.assert_allclose(found, coefficients, atol=0.03)


class TestReference:
    @pytest.mark.parametrize("name", ["normalgan", "kinect_v1", "kinect_v2", "azure", "tof"])
    @pytest.mark.parametrize("seed", [0, 1])
    def test_pixel_by_pixel(self, scene: Any, reference: Callable, name: str, seed: int) -> None:
        sensor = sensor_of(name, **({"drop_flying": False} if name == "tof" else {}))
        reading = scene.sense(sensor, seed)
        expected = reference(name, scene, sensor, seed)
        assert len(expected) == scene.mask.sum() > 500
        # Rounding may fall the other way in single precision, at a step of the sensor's own.
        different = 0
        for place, (depth, sigma) in expected.items():
            assert reading.sigma[place] == pytest.approx(sigma, rel=2e-4)
            off = abs(float(reading.depth[place]) - depth)
            different += off > (1.1e-3 if name == "kinect_v2" else 2e-5)
            assert reading.valid[place] == (reading.depth[place] > 0)
        assert different <= 2


class TestTimeOfFlight:
    @pytest.mark.parametrize("z", [0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0])
    def test_noise_of_a_wall_is_the_published_one(self, plane: Callable, z: float) -> None:
        scene = plane(z, 0)
        reading = scene.sense(sensor_of("tof", spread=0.0), seed=int(10 * z))
        error = (reading.depth.astype(np.float64) - scene.depth).ravel()
        assert reading.valid.all()
        assert error.std() == pytest.approx(published("kinect_v2", z, 0), rel=0.15)
        np.testing.assert_allclose(reading.sigma.mean(), error.std(), rtol=0.02)
        assert abs(error.mean()) < 5 * error.std() / math.sqrt(DRAWS) + 2e-6

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

    def test_mixed_pixels_lie_between(self, scene: Any) -> None:
        only = GAUSSIAN["kinect_v2"] | {"noise": 0.0, "mixed": 1.0}
        depth = scene.sense(sensor_of("kinect_v2", **only)).depth
        moved = np.abs(depth - scene.depth) > 1e-5
        assert moved.sum() > 50
        assert (depth >= scene.depth - 1e-5).all()
        assert (depth[moved] < 3.5).all()
        none = scene.sense(sensor_of("kinect_v2", **(only | {"mixed": 0.0}))).depth
        np.testing.assert_allclose(none, scene.depth, atol=1e-6)

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


class TestNormalGAN:
    def test_truncation_is_a_bias_of_half_a_millimetre(self, plane: Callable) -> None:
        scene = plane(2.0, 0, parallel=True)
        cut = scene.sense(sensor_of("normalgan", truncate=True)).depth.astype(np.float64)
        assert np.mean(cut - 2.0) == pytest.approx(-0.0005, abs=5 * 0.0017 / math.sqrt(DRAWS))

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
            empty, np.zeros((6, 7, 3)), empty, empty > 0, _grid(), np.random.default_rng(0)
        )
        assert not reading.depth.any()

    @pytest.mark.parametrize("name", SENSORS)
    def test_a_device_elsewhere_sees_other_distances(self, plane: Callable, name: str) -> None:
        """1 m nearer, the noise is that of a distance of 1 m less."""
        near = plane(2.0, 0, parallel=True, shape=(3, 3)).sense(sensor_of(name, distance=1.0))
        there = plane(1.0, 0, parallel=True, shape=(3, 3)).sense(sensor_of(name))
        assert near.sigma[1, 1] == pytest.approx(there.sigma[1, 1], rel=1e-3)
        assert near.depth[1, 1] == pytest.approx(2.0, abs=0.05)

    def test_colour_is_as_good_as_brightness(self, scene: Any) -> None:
        """Linear colour, and its sRGB bytes."""
        sensor = sensor_of("kinect_v2")
        grey = np.repeat(scene.albedo[..., None], 3, axis=-1)
        rng = np.random.default_rng
        a = sensor.sense(scene.depth, scene.normal, scene.albedo, scene.mask, _grid(), rng(0))
        b = sensor.sense(scene.depth, scene.normal, grey, scene.mask, _grid(), rng(0))
        np.testing.assert_array_equal(a.valid, b.valid)
        coded = np.where(
            grey <= 0.0031308, 12.92 * grey, 1.055 * np.maximum(grey, 1e-9) ** (1 / 2.4) - 0.055
        )
        eight = np.rint(255 * coded).astype(np.uint8)
        c = sensor.sense(scene.depth, scene.normal, eight, scene.mask, _grid(), rng(0))
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
        ],
    )
    def test_maps_that_cannot_be(self, scene: Any, name: str, spoil: Callable, said: str) -> None:
        maps = {key: getattr(scene, key) for key in ("depth", "normal", "albedo", "mask")}
        spoil(maps)
        rng = np.random.default_rng(0)
        with pytest.raises(ValueError, match=said):
            sensor_of(name).sense(**maps, grid=_grid(), rng=rng)
        # Before any work: nothing was drawn.
        assert rng.random() == np.random.default_rng(0).random()

    def test_unknown_names_are_told_the_known_ones(self) -> None:
        with pytest.raises(ValueError, match="'kinect_v3' is no model; known: normalgan"):
            sensor_of("kinect_v3")

    @pytest.mark.parametrize(
        ("name", "parameters"),
        [
            ("normalgan", {"noise": -1}), ("normalgan", {"distance": 0}),
            ("normalgan", {"contour_jitter": 2}), ("kinect_v1", {"lateral": -1}),
            ("kinect_v2", {"mixed": 2}), ("kinect_v2", {"graze_deg": (80, 70)}),
            ("kinect_v2", {"range": (2, 1)}), ("azure", {"shift": -1}), ("tof", {"amplitude": 0}),
            ("tof", {"background_albedo": 2}), ("tof", {"range": (2, 1)}),
        ],
    )  # fmt: skip
    def test_parameters_out_of_bounds(self, name: str, parameters: dict[str, Any]) -> None:
        with pytest.raises(ValueError, match=rf"^sensor\.{next(iter(parameters))}: "):
            sensor_of(name, **parameters)


def _grid() -> Any:
    from augment.sensors import Grid

    return Grid(pixel_size=0.005, distance=2.0)
