"""The sRGB curve against published points."""

from __future__ import annotations

import numpy as np

from subjects.color import linear_to_srgb, srgb_to_linear

# IEC 61966-2-1: the two pieces meet at 0.04045; 18 % grey; the middle code value.
SRGB = [0.0, 0.04045, 0.46135612950044164, 0.5, 1.0]
LINEAR = [0.0, 0.0031308, 0.18, 0.21404114048223255, 1.0]


def test_published_points():
    assert np.allclose(srgb_to_linear(SRGB), LINEAR, atol=1e-7)
    assert np.allclose(linear_to_srgb(LINEAR), SRGB, atol=1e-6)


def test_every_8_bit_value_comes_back():
    values = np.arange(256)
    assert np.array_equal(np.round(255 * linear_to_srgb(srgb_to_linear(values / 255))), values)
