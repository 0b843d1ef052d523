"""The depth sensor against its published table, and against what it must leave alone."""

import numpy as np
import pytest
from scipy import stats

from augment.sensor import SensorConfig, axial_sigma, sense

DRAWS = 100_000
# Millimetres from sigma = 1.5 - 0.5 z + 0.3 z^2 + 0.1 z^1.5 t^2 / (1.58 - t)^2, worked by hand.
TABLE = {
    (0.8, 0): 1.292,
    (1.0, 0): 1.300,
    (2.0, 0): 1.700,
    (4.0, 0): 4.300,
    (1.0, 60): 1.6864,
    (2.0, 60): 2.7930,
    (1.0, 80): 7.0749,
    (3.0, 75): 14.8223,
}


def target(z: float, angle_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A planar target that fills the image."""
    shape = (250, DRAWS // 250)
    normal = np.zeros((*shape, 3), dtype=np.float32)
    normal[..., 0], normal[..., 2] = np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))
    return np.full(shape, z, dtype=np.float32), normal, np.ones(shape, dtype=bool)


@pytest.mark.parametrize(("z", "angle"), TABLE)
def test_sigma_is_the_published_one(z, angle):
    expected = TABLE[z, angle]
    sigma = axial_sigma(np.array(z), np.cos(np.radians(angle))) * 1e3
    assert sigma == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("z", [0.8, 1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("angle", [0, 30, 60, 75, 80])
def test_measured_noise_has_that_sigma_and_no_bias(z, angle):
    rng = np.random.default_rng([int(z * 10), angle])
    depth, normal, mask = target(z, angle)
    reading = sense(depth, normal, mask, SensorConfig(), rng)
    error = reading.depth.astype(np.float64) - depth
    sigma = float(axial_sigma(np.array(z), np.cos(np.radians(angle))))
    # Five standard errors of a standard deviation from 1e5 draws: 1.1 %.
    assert error.std() == pytest.approx(sigma, rel=0.011)
    assert abs(error.mean()) < 5 * sigma / np.sqrt(DRAWS)
    assert stats.kstest(error.ravel() / sigma, "norm").pvalue > 1e-4
    neighbours = np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]
    assert abs(neighbours) < 5 / np.sqrt(DRAWS)


def test_the_steepest_slant_stays_finite():
    assert axial_sigma(np.array([2.0]), np.array([0.0])) < 0.11
    assert axial_sigma(np.array([2.0]), np.array([-0.5])) < 0.11


def test_background_and_inputs_are_untouched_to_the_bit():
    rng = np.random.default_rng(1)
    depth, normal, mask = target(2.0, 30)
    mask[:100] = False
    depth[:100] = 0
    normal[:100] = 0
    before = depth.tobytes(), normal.tobytes(), mask.tobytes()
    reading = sense(depth, normal, mask, SensorConfig(), rng)
    assert (depth.tobytes(), normal.tobytes(), mask.tobytes()) == before
    assert not reading.depth[:100].any()
    assert not reading.sigma[:100].any()
    np.testing.assert_array_equal(reading.valid, mask)
    assert reading.depth.dtype == np.float32


def test_the_same_generator_draws_the_same_bytes_and_noise_zero_is_the_truth():
    depth, normal, mask = target(1.7, 20)
    first, again, other = (
        sense(depth, normal, mask, SensorConfig(), np.random.default_rng(seed)).depth.tobytes()
        for seed in (3, 3, 4)
    )
    assert first == again
    assert first != other
    exact = sense(depth, normal, mask, SensorConfig(noise=0), np.random.default_rng(3))
    assert exact.depth.tobytes() == depth.tobytes()


def test_noise_scales_the_published_sigma():
    depth, normal, mask = target(2.0, 0)
    reading = sense(depth, normal, mask, SensorConfig(noise=2.0), np.random.default_rng(0))
    np.testing.assert_allclose(reading.sigma, 2 * 1.7e-3, rtol=1e-6)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d, n, m: d.__setitem__((0, 0), np.nan), "NaN"),
        (lambda d, n, m: d.__setitem__((0, 0), -1.0), "negative"),
        (lambda d, n, m: d.__setitem__((0, 0), 0.0), "0 inside the mask"),
        (lambda d, n, m: n.__setitem__((0, 0), 0.5), "not unit"),
    ],
)
def test_maps_that_cannot_be_true_are_refused(spoil, message):
    depth, normal, mask = target(2.0, 0)
    spoil(depth, normal, mask)
    with pytest.raises(ValueError, match=message):
        sense(depth, normal, mask, SensorConfig(), np.random.default_rng(0))


def test_shapes_that_disagree_are_refused():
    depth, normal, mask = target(2.0, 0)
    with pytest.raises(ValueError, match="shapes disagree"):
        sense(depth[:-1], normal, mask, SensorConfig(), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"sensor\.noise"):
        SensorConfig(noise=-1)
