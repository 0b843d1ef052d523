"""Image files as textures."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from PIL import Image

from subjects.mesh import MeshError

TEXTURE_PIXELS = 16384 * 16384
"""The largest texture that is decoded; a small file can claim any size."""


@contextmanager
def images_bounded() -> Iterator[None]:
    """Within, Pillow refuses images of more than `TEXTURE_PIXELS`."""
    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = TEXTURE_PIXELS
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def decode_texture(content: bytes, name: str) -> np.ndarray:
    """(h, w, 3) uint8 of an image file's content."""
    return pixels(open_image(content, name), name)


def open_image(content: bytes, name: str) -> Image.Image:
    """The image, not decoded yet, after a check that it can become a texture."""
    try:
        image = Image.open(io.BytesIO(content))
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise MeshError(
            f"its texture '{name}' has more than {TEXTURE_PIXELS} pixels; scale it down"
        ) from None
    except Exception:
        raise MeshError(
            f"its texture '{name}' is no readable image; export it again as PNG or JPEG"
        ) from None
    if image.mode.startswith(("I", "F")):
        raise MeshError(f"its texture '{name}' has {image.mode} pixels; save it as 8-bit RGB")
    return image


def pixels(image: Image.Image, name: str) -> np.ndarray:
    """(h, w, 3) uint8, alpha left out."""
    try:
        return np.asarray(image.convert("RGB"))
    except Exception as error:
        raise MeshError(
            f"its texture '{name}' cannot be decoded ({error}); copy or export it again"
        ) from None
