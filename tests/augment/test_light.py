"""Exposure and the sRGB curve."""

import numpy as np
import pytest

from augment.light import LightConfig, expose, srgb


def test_the_srgb_curve_at_published_points():
    # IEC 61966-2-1: linear 0.0031308 is where line and power meet; 0.2140 is sRGB one half.
    np.testing.assert_allclose(
        srgb(np.array([0.0, 0.0031308, 0.21404, 1.0, 7.0, -1.0])),
        [0.0, 0.04045, 0.5, 1.0, 1.0, 0.0],
        atol=1e-5,
    )


def test_power_and_exposure_multiply_and_the_background_is_black():
    radiance = np.full((2, 2, 3), 1e-4, dtype=np.float32)
    mask = np.array([[True, False], [True, True]])
    image = expose(radiance, mask, LightConfig(power=1000.0, exposure=2.15861))
    assert image.dtype == np.uint8
    assert (image[mask] == 128).all()
    assert not image[~mask].any()
    same = expose(radiance, mask, LightConfig(power=500.0, exposure=4.31722))
    np.testing.assert_array_equal(image, same)


@pytest.mark.parametrize(
    "wrong", [{"power": 0.0}, {"exposure": -1.0}, {"position": (0.0, np.nan, 0.0)}]
)
def test_a_wrong_setting_is_named(wrong):
    with pytest.raises(ValueError, match=f"light.{next(iter(wrong))}"):
        LightConfig(**wrong)
