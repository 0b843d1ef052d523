"""Multilayer EXR files to arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR


def read_layers(path: Path) -> dict[str, np.ndarray]:
    """Every channel of a multilayer EXR as (h, w) float32, by its name (`layer.pass.channel`).

    Raises:
        OSError: the file is missing or no EXR.
    """
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: np.array(c.pixels) for name, c in file.channels().items()}
    except RuntimeError as error:
        raise OSError(f"{path}: cannot be read as EXR ({error})") from error
