"""The colour camera of a depth camera: shot noise, read noise, converter, sRGB."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from augment.srgb import srgb

DAZZLING = 1e6
"""Times saturation; light beyond it is white whatever the noise, and would overflow."""


@dataclass(frozen=True)
class ColorCamera:
    """A sensor with linear response: EMVA Standard 1288's camera without its nonuniformity.

    A pixel under light x (1 = saturation) collects x full_well electrons on average. Their number
    is Poisson, reading it out adds Gaussian noise, and the converter's last code stands at the full
    well, so one clip is both the pixel's and the converter's. The black level is taken off.

    One normal variable of variance x full_well + read_noise^2 stands for both noises (Foi et al.,
    Practical Poissonian-Gaussian Noise Modeling and Fitting for Single-Image Raw-Data, IEEE TIP
    2008). Against true Poisson counts it gives, for the default camera at any light, at most 1.6 %
    of the pixels another code; the mean is off by at most 0.007 of a code and the standard
    deviation by 0.8 %, all between 3 and 12 electrons. The Poisson law's skewness is worth about a
    sixth of an electron, and a code is 2. A sensor that nearly tells single electrons apart would
    need the Poisson law: with a read noise of 1 it is 4.4 % of the pixels and 3.8 %.

    The defaults are a small consumer sensor at its lowest gain; of a Kinect v2's we know no data
    sheet. Published: the AR0330 (1/3 inch, 2.2 um pixels) has 39 dB of signal to noise at best and
    69.5 dB of dynamic range (data sheet AR0330CM/D, 2017), which are 7,900 and 2.7 electrons. The
    IMX477 (1/2.3 inch, 1.55 um) was measured at 8,180 and 3 (Strolls with my Dog, Pi HQ Cam Sensor
    Performance). EMVA 1288 figures of the MT9F002 (1.4 um) and the MT9M034 (3.75 um) come to 3,200
    and 5,900, and about 4 each (Balluff, BVS CA-SF). The first two convert to 12 bits. Assumed:
    that a depth camera has such a sensor, and that a depth pixel takes its colour from one pixel,
    the nearest, as libfreenect2 does. The mean of n pixels would be a pixel of n full_well and
    sqrt(n) read_noise.

    Left out: demosaicing and what it does to noise, white balance and colour matrix with their
    gains, auto exposure and analogue gain, dark current, fixed pattern, vignetting, blur,
    denoising, sharpening, tone curves other than sRGB, compression.
    """

    full_well: float = 8000.0
    """Electrons in a pixel under linear light 1."""
    read_noise: float = 3.0
    """Standard deviation of the noise in the dark, electrons, without the converter's rounding."""
    bits: int = 12
    """Of the linear converter."""

    def __post_init__(self) -> None:
        if not 1 <= self.full_well <= 1e9:
            raise ValueError(
                f"color_camera.full_well: {self.full_well} electrons; give 1 to 1e9, such as 8000"
            )
        if not 0 <= self.read_noise < self.full_well:
            raise ValueError(
                f"color_camera.read_noise: {self.read_noise} electrons; give 0 or more and less "
                "than full_well, such as 3"
            )
        if not (isinstance(self.bits, int) and 1 <= self.bits <= 16):
            raise ValueError(
                f"color_camera.bits: {self.bits}; give a whole number from 1 to 16, such as 12"
            )

    def photograph(self, exposed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """sRGB bytes of a scene, with noise; `augment.light.expose` makes them without.

        Args:
            exposed: (..., 3) float32 or float64 linear light, Rec. 709 primaries, 1 = saturation.
            rng: the only source of chance. One normal number a value is drawn, whatever the light.

        Returns:
            (..., 3) uint8.

        Raises:
            ValueError: the light is of another shape or type, negative or not finite.
        """
        return _srgb_bytes(self.bits).take(self.raw(exposed, rng))

    def raw(self, exposed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The converter's linear codes, black at 0: (..., 3) uint16. `photograph` says the rest."""
        if exposed.dtype not in (np.float32, np.float64) or exposed.shape[-1:] != (3,):
            raise ValueError(
                f"the light is {exposed.dtype} of shape {exposed.shape}; give (..., 3) float32"
            )
        # A minimum is NaN where anything is.
        if not (exposed.min(initial=0) >= 0 and exposed.max(initial=0) < np.inf):
            raise ValueError(
                "the light holds NaN, infinite or negative values; give linear light of 0 or more"
            )
        last = (1 << self.bits) - 1
        gain = last / self.full_well  # codes per electron
        codes = np.minimum(exposed, DAZZLING).astype(np.float32, copy=False)
        codes *= np.float32(last)
        sigma = codes * np.float32(gain)
        sigma += np.float32((gain * self.read_noise) ** 2)
        np.sqrt(sigma, out=sigma)
        sigma *= rng.standard_normal(exposed.shape, dtype=np.float32)
        codes += sigma
        np.rint(codes, out=codes)
        return np.clip(codes, 0, last, out=codes).astype(np.uint16)


@cache
def _srgb_bytes(bits: int) -> np.ndarray:
    """(2^bits,) uint8: sRGB of every linear code."""
    return np.rint(255 * srgb(np.linspace(0, 1, 1 << bits))).astype(np.uint8)
