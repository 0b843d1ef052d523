"""Exposure and the sRGB curve."""

import numpy as np
import pytest

from augment.color_camera import ColorCamera
from augment.light import LightConfig, expose
from augment.photograph import develop, photograph
from augment.srgb import srgb


def test_the_srgb_curve_at_published_points():
    # IEC 61966-2-1: linear 0.0031308 is where line and power meet; 0.2140 is sRGB one half.
    np.testing.assert_allclose(
        srgb(np.array([0.0, 0.0031308, 0.21404, 1.0, 7.0, -1.0])),
        [0.0, 0.04045, 0.5, 1.0, 1.0, 0.0],
        atol=1e-5,
    )


def test_power_and_exposure_multiply_and_the_background_is_black():
    radiance = np.full((3, 3), 1e-4, dtype=np.float32)
    mask = np.array([[[True, False], [True, True]]])
    light = LightConfig(power=1000.0, exposure=2.15861)
    image = photograph([radiance], mask, light, None, (0, "a", "rgb_front"))
    assert image.dtype == np.uint8
    assert image.shape == (1, 2, 2, 3)
    assert (image[mask] == 128).all()
    assert not image[~mask].any()
    same = LightConfig(power=500.0, exposure=4.31722)
    np.testing.assert_array_equal(
        image, photograph([radiance], mask, same, None, (0, "a", "rgb_front"))
    )
    np.testing.assert_allclose(expose(radiance, light), 0.215861, rtol=1e-6)
    np.testing.assert_array_equal(develop(np.array([0.0, 0.2159, 1.0, 9.0])), [0, 128, 255, 255])


def test_noise_is_keyed_by_all_that_names_a_photograph():
    """Seed, subject, member, power, view and draw: each gives other noise, and the same again."""
    mask = np.ones((2, 20, 20), dtype=bool)
    radiance = [np.full((400, 3), 1e-3, dtype=np.float32)] * 2
    base = {"seed": 1, "subject": "a", "member": "rgb_front", "power": 1000.0, "draw": 0}

    def shoot(**change: object) -> np.ndarray:
        given = base | change
        light = LightConfig(power=given["power"], exposure=200 / given["power"])
        key = (given["seed"], given["subject"], given["member"])
        return photograph(radiance, mask, light, ColorCamera(), key, given["draw"])

    images = shoot()
    assert shoot().tobytes() == images.tobytes()
    assert images[0].tobytes() != images[1].tobytes()
    changes = ({"seed": 2}, {"subject": "b"}, {"member": "rgb_back"}, {"power": 900.0}, {"draw": 1})
    for change in changes:
        other = shoot(**change).astype(float)
        assert np.corrcoef(other.ravel(), images.ravel())[0, 1] < 0.1, change
        assert other.mean() == pytest.approx(images.mean(), rel=0.01)


@pytest.mark.parametrize(
    "wrong", [{"power": 0.0}, {"exposure": -1.0}, {"position": (0.0, np.nan, 0.0)}]
)
def test_a_wrong_setting_is_named(wrong):
    with pytest.raises(ValueError, match=f"light.{next(iter(wrong))}"):
        LightConfig(**wrong)
