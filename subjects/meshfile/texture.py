"""Image files as textures."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

from subjects.limits import Limits
from subjects.mesh import MeshError
from subjects.meshfile.folder import Folder

FORMATS = ("BMP", "DDS", "GIF", "JPEG", "JPEG2000", "PNG", "PPM", "TGA", "TIFF", "WEBP")
"""What Pillow may take a texture for; to decode EPS it would run Ghostscript."""


@contextmanager
def images_bounded(limits: Limits) -> Iterator[None]:
    """Within, Pillow refuses images of more than the limits' pixels; its bound is a global."""
    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = max(int(limits.texture_megapixels * 1e6), 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def read_texture(path: Path, limits: Limits) -> np.ndarray:
    """(h, w, 3) uint8 of an image file.

    Raises:
        MeshError: it cannot be read, or is above the limits.
    """
    try:
        with images_bounded(limits):
            folder = Folder(path.parent, limits)
            return decode_texture(folder.read(path), path.name, folder)
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened ({error.strerror}); check its rights") from None
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None


def decode_texture(content: bytes, name: str, folder: Folder) -> np.ndarray:
    """(h, w, 3) uint8 of an image file's content."""
    return pixels(open_image(content, name, folder.limits), name, folder)


def open_image(content: bytes, name: str, limits: Limits) -> Image.Image:
    """The image, not decoded yet, after a check that it can become a texture."""
    try:
        image = Image.open(io.BytesIO(content), formats=FORMATS)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        limits.check_pixels(int(re.findall(r"\d+", str(error))[0]), name)
        raise
    except Exception:
        raise MeshError(
            f"its texture '{name}' is no readable image; export it again as PNG or JPEG"
        ) from None
    if image.mode.startswith(("I", "F")):
        raise MeshError(f"its texture '{name}' has {image.mode} pixels; save it as 8-bit RGB")
    return image


def pixels(image: Image.Image, name: str, folder: Folder) -> np.ndarray:
    """(h, w, 3) uint8, alpha left out; counted to the folder's pixels before it is decoded."""
    folder.count_pixels(image.width * image.height, name)
    try:
        return np.asarray(image.convert("RGB"))
    except Exception as error:
        raise MeshError(
            f"its texture '{name}' cannot be decoded ({error}); copy or export it again"
        ) from None
