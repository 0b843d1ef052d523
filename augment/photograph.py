"""From linear radiance to the colours of an image, with a camera's noise or without."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

import seeds
from augment.color_camera import ColorCamera
from augment.light import LightConfig, expose
from augment.srgb import srgb


def develop(exposed: np.ndarray) -> np.ndarray:
    """The image of a camera without noise: (..., 3) uint8, round(255 srgb(exposed)), clipped."""
    return np.rint(255 * srgb(exposed)).astype(np.uint8)


def photograph(
    radiance: Iterable[np.ndarray],
    mask: np.ndarray,
    light: LightConfig,
    camera: ColorCamera | None,
    key: tuple[int, str, str],
    draw: int = 0,
) -> np.ndarray:
    """One side's images of a subject under `light`; colour is 0 outside the mask.

    Args:
        radiance: of each view the light of its foreground: (N, 3) float32 linear light per watt,
            in the order of the mask's pixels.
        mask: (V, H, W) bool.
        camera: whose noise the images have, or None for images without.
        key: the dataset's seed, the subject's id and the member, such as "rgb_front". Noise is
            keyed by these, the power and the view: it is the same on any machine, and no two
            powers share it.
        draw: which of several draws of the noise.

    Returns:
        (V, H, W, 3) uint8 sRGB.
    """
    images = np.zeros((*mask.shape, 3), dtype=np.uint8)
    seed, subject, member = key
    for view, (image, seen) in enumerate(zip(images, radiance, strict=True)):
        exposed = expose(seen, light)
        if camera is None:
            colors = develop(exposed)
        else:
            purpose = f"{member} at {float(light.power)!r} W"
            rng = seeds.generator(seed, subject, purpose, view, draw)
            colors = camera.photograph(exposed, rng)
        image[mask[view]] = colors
    return images
