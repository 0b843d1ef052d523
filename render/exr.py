"""Multilayer EXR files to arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR


def read_channels(path: Path) -> dict[str, np.ndarray]:
    """Every channel of a multilayer EXR of one layer: `pass.channel` to (h, w) float32.

    Raises:
        OSError: the file is missing or no EXR.
    """
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {
                name.split(".", 1)[1]: np.array(channel.pixels)
                for name, channel in file.channels().items()
            }
    except (RuntimeError, ValueError) as error:
        raise OSError(f"{path}: cannot be read as EXR ({error})") from error
