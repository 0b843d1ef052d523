"""The colour camera's noise against true Poisson counts and the photon transfer curve."""

import numpy as np
import pytest
from scipy.stats import norm, poisson

from augment.color_camera import ColorCamera
from augment.srgb import srgb
from seeds import generator

DRAWS = 33_334
"""Triples: 1e5 values a light level."""

LEVELS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.6, 0.9)

CAMERAS = (ColorCamera(), ColorCamera(9000, 4.0, 10), ColorCamera(20000, 12.0, 14))
"""Of 8 electrons or more at the lowest level; fewer have a test of their own."""


def even(level: float, count: int = DRAWS) -> np.ndarray:
    return np.full((count, 3), level, dtype=np.float32)


def reference(camera: ColorCamera, exposed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Codes by the book: count electrons, read them out, convert."""
    electrons = rng.poisson(exposed.astype(np.float64) * camera.full_well)
    signal = electrons + camera.read_noise * rng.standard_normal(exposed.shape)
    last = 2**camera.bits - 1
    return np.clip(np.round(signal / camera.full_well * last), 0, last)


def agree(ours: np.ndarray, theirs: np.ndarray) -> None:
    """Mean and standard deviation within four standard errors of two samples' difference.

    Standard errors: sigma / sqrt(n) of the mean; of the deviation by the fourth moment, which
    rounding and clipping change.
    """
    ours, theirs = ours.astype(np.float64), theirs.astype(np.float64)
    n, sigma = theirs.size, theirs.std()
    error = np.sqrt((((theirs - theirs.mean()) ** 4).mean() - sigma**4) / n) / (2 * sigma)
    assert abs(ours.mean() - theirs.mean()) < 4 * sigma * np.sqrt(2 / n)
    assert abs(ours.std() - sigma) < 4 * error * np.sqrt(2)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("camera", CAMERAS)
def test_codes_and_bytes_have_the_mean_and_sigma_of_true_poisson_counts(camera, level):
    light = even(level)
    codes = reference(camera, light, generator(0, "", "reference"))
    agree(camera.raw(light, generator(0, "", "ours")), codes)
    image = camera.photograph(light, generator(0, "", "ours"))
    agree(image, np.round(255 * srgb(codes / (2**camera.bits - 1))))


@pytest.mark.parametrize("electrons", [0.5, 2, 3.6, 5.4, 12, 40])
def test_at_few_electrons_the_codes_are_nearly_those_of_poisson_counts(electrons):
    camera = ColorCamera()
    codes, counts = np.arange(80), np.arange(200)
    edges = (codes + 0.5) * camera.full_well / 4095
    below = norm.cdf((edges[:, None] - counts) / camera.read_noise)
    exact = np.diff(below @ poisson.pmf(counts, electrons), prepend=0)
    # A million draws: the mean's standard error is below 0.001, the deviation's 0.1 %.
    light = even(electrons / camera.full_well, 333_334)
    drawn = camera.raw(light, generator(0, "", "few"))
    found = np.bincount(drawn.ravel(), minlength=80)[:80] / drawn.size
    assert found.sum() > 0.9999
    assert np.abs(found - exact).sum() / 2 < 0.02
    mean = exact @ codes
    assert abs(drawn.mean() - mean) < 0.02
    assert drawn.std() == pytest.approx(np.sqrt(exact @ (codes - mean) ** 2), rel=0.015)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_photon_transfer_curve_gives_the_camera_back(camera):
    rng = generator(0, "", "transfer")
    last = 2**camera.bits - 1
    # From where the dark's clip is five sigmas away, to where the white's is.
    codes = [
        camera.raw(even(level, 200_000), rng).astype(np.float64)
        for level in np.geomspace(0.006, 0.6, 12)
    ]
    mean = np.array([c.mean() for c in codes])
    variance = np.array([c.var() for c in codes]) - 1 / 12  # of the rounding
    # A variance's own error is in proportion to it.
    gain, dark = np.polyfit(mean, variance, 1, w=1 / variance)
    assert last / gain == pytest.approx(camera.full_well, rel=0.01)
    assert np.sqrt(dark) / gain == pytest.approx(camera.read_noise, rel=0.04)


def test_signal_to_noise_goes_with_the_square_root_of_light():
    camera = ColorCamera(full_well=8000, read_noise=0, bits=16)
    rng = generator(0, "", "snr")
    levels = np.array([0.01, 0.04, 0.16, 0.64])
    codes = [camera.raw(even(level), rng).astype(np.float64) for level in levels]
    ratio = np.array([c.mean() / c.std() for c in codes])
    # Four standard errors of a deviation of 1e5 values: 4 / sqrt(2e5).
    np.testing.assert_allclose(ratio, np.sqrt(levels * camera.full_well), rtol=0.009)
    assert np.polyfit(np.log(levels), np.log(ratio), 1)[0] == pytest.approx(0.5, abs=0.005)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("level", [1.2, 7.0, 1e9, 3e38, 1e300])
def test_light_above_saturation_is_white_without_noise(camera, level):
    light = np.full((10_000, 3), level)
    if level < 1e38:
        light = light.astype(np.float32)
    assert (camera.photograph(light, generator(0, "", "white")) == 255).all()


def test_at_saturation_the_clip_takes_the_upper_half_of_the_noise():
    codes = ColorCamera().raw(even(1.0), generator(0, "", "white"))
    assert codes.max() == 4095
    # The deviation is 89 electrons of 2 a code; half a code rounds up into the last.
    expected = norm.cdf(0.5 * 8000 / 4095 / np.hypot(np.sqrt(8000), 3))
    error = np.sqrt(expected * (1 - expected) / codes.size)
    assert abs((codes == 4095).mean() - expected) < 4 * error


@pytest.mark.parametrize("read_noise", [3.0, 20.0])
def test_the_dark_has_read_noise_clipped_at_zero(read_noise):
    camera = ColorCamera(read_noise=read_noise)
    codes = camera.raw(even(0.0), generator(0, "", "dark"))
    agree(codes, reference(camera, even(0.0), generator(0, "", "reference")))
    black = norm.cdf(0.5 * 8000 / 4095 / read_noise)
    error = np.sqrt(black * (1 - black) / codes.size)
    assert abs((codes == 0).mean() - black) < 4 * error


def test_the_dark_of_a_camera_without_read_noise_is_black():
    image = ColorCamera(read_noise=0).photograph(even(0.0), generator(0, "", "dark"))
    assert not image.any()


def test_without_noise_the_image_is_the_ideal_one():
    camera = ColorCamera(full_well=1e9, read_noise=0, bits=16)
    light = np.linspace(0, 1, 30_000, dtype=np.float32).reshape(-1, 3)
    image = camera.photograph(light, generator(0, "", "ideal"))
    assert image.dtype == np.uint8
    ideal = 255 * srgb(light.astype(np.float64))
    # Half a byte of rounding, half a code of the converter at the curve's steepest (12.92).
    assert np.abs(image - ideal).max() < 0.5 + 0.5 * 12.92 * 255 / 65535 + 0.005
    assert (image == np.rint(ideal)).mean() > 0.99


@pytest.mark.parametrize("bits", [1, 4, 8, 10, 12])
def test_the_converter_has_as_many_codes_as_its_bits_give(bits):
    camera = ColorCamera(full_well=1e9, read_noise=0, bits=bits)
    light = np.linspace(0, 1, 30_000, dtype=np.float32).reshape(-1, 3)
    codes = camera.raw(light, generator(0, "", "bits"))
    np.testing.assert_array_equal(np.unique(codes), np.arange(2**bits))
    # Six standard deviations of a billion electrons.
    assert np.abs(codes / (2**bits - 1) - light).max() < 0.5 / (2**bits - 1) + 2e-4


def test_one_generator_one_image():
    camera, light = ColorCamera(), even(0.2, 100)
    first, again = (camera.photograph(light, generator(1, "a", "rgb")) for _ in range(2))
    other = camera.photograph(light, generator(2, "a", "rgb"))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5


def test_draws_depend_on_the_number_of_values_alone():
    camera = ColorCamera()
    after = []
    for light in (even(0.0, 70), even(0.5, 70), even(9.0, 70).reshape(7, 10, 3)):
        rng = generator(0, "", "count")
        camera.photograph(light, rng)
        after.append(rng.random())
    assert len(set(after)) == 1


def test_channels_and_pixels_have_noise_of_their_own():
    codes = ColorCamera().raw(even(0.5), generator(0, "", "own")).astype(np.float64)
    channels = np.corrcoef(codes.T)[np.triu_indices(3, 1)]
    neighbours = np.corrcoef(codes[1:, 0], codes[:-1, 0])[0, 1]
    # A correlation of 0 has the standard error 1 / sqrt(n).
    assert np.abs([*channels, neighbours]).max() < 4 / np.sqrt(DRAWS)


def test_shape_precision_and_layout_do_not_matter():
    camera = ColorCamera()
    rows = generator(0, "", "light").random((60, 3), dtype=np.float32)
    image = camera.photograph(rows, generator(0, "", "rgb"))
    for same in (rows.astype(np.float64), np.asfortranarray(rows)):
        np.testing.assert_array_equal(camera.photograph(same, generator(0, "", "rgb")), image)
    blocks = camera.photograph(rows.reshape(5, 12, 3), generator(0, "", "rgb"))
    np.testing.assert_array_equal(blocks.reshape(60, 3), image)
    assert camera.photograph(rows[0], generator(0, "", "rgb")).shape == (3,)
    assert camera.photograph(rows[:0], generator(0, "", "rgb")).shape == (0, 3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_light_is_untouched(dtype):
    light = np.linspace(0, 2, 300, dtype=dtype).reshape(-1, 3)
    before = light.copy()
    image = ColorCamera().photograph(light, generator(0, "", "rgb"))
    image[:] = 0  # the image is the caller's own
    np.testing.assert_array_equal(light, before)
    assert ColorCamera().photograph(light, generator(0, "", "rgb")).any()


@pytest.mark.parametrize(
    ("light", "words"),
    [
        (np.full((4, 3), -1e-6, dtype=np.float32), "negative"),
        (np.array([[0.5, np.nan, 0.5]], dtype=np.float32), "NaN"),
        (np.array([[0.5, np.inf, 0.5]]), "infinite"),
        (np.array([[0.5, -np.inf, 0.5]]), "infinite"),
        (np.zeros((4, 4), dtype=np.float32), r"\(4, 4\)"),
        (np.zeros(4, dtype=np.float32), r"\(4,\)"),
        (np.array(0.5), r"\(\)"),
        (np.zeros((4, 3), dtype=np.uint8), "uint8"),
        (np.zeros((4, 3), dtype=np.float16), "float16"),
        (np.zeros((4, 3), dtype=np.complex64), "complex64"),
    ],
)
def test_wrong_light_is_refused_before_anything_is_drawn(light, words):
    rng = generator(0, "", "refused")
    before = rng.bit_generator.state
    with pytest.raises(ValueError, match=f"^the light .*{words}.*; give [^\n]*$"):
        ColorCamera().photograph(light, rng)
    assert rng.bit_generator.state == before


@pytest.mark.parametrize(
    ("wrong", "value"),
    [
        *(("full_well", value) for value in (-3, 0, 0.5, np.nan, np.inf)),
        *(("read_noise", value) for value in (-0.1, np.nan, np.inf, 8000.0)),
        *(("bits", value) for value in (0, -1, 17, 10.5, 10.0)),
    ],
)
def test_a_wrong_setting_is_named(wrong, value):
    with pytest.raises(ValueError, match=rf"^color_camera\.{wrong}: {value}.*; give [^\n]*$"):
        ColorCamera(**{wrong: value})
