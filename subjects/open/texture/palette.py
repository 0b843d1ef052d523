"""The colours that skin, hair, eyes, cloth and leather come in, sRGB."""

from __future__ import annotations

import numpy as np

Colour = tuple[float, float, float]
Swatches = tuple[tuple[int, int, int], ...]

# The ten tones of the Monk Skin Tone scale (Monk 2019, skintone.google), lightest first; the
# first are warmed a little, since the scale's swatches are paler than lit skin.
SKIN = (
    np.array(
        [
            [243, 226, 214],
            [241, 220, 203],
            [243, 212, 186],
            [232, 196, 164],
            [213, 170, 130],
            [168, 122, 86],
            [132, 92, 64],
            [99, 67, 50],
            [64, 46, 38],
            [48, 38, 35],
        ]
    )
    / 255.0
)
HAIR_COLOURS: dict[str, tuple[int, int, int]] = {
    "black": (30, 26, 25),
    "dark brown": (54, 38, 29),
    "brown": (88, 62, 43),
    "light brown": (126, 94, 64),
    "blond": (184, 150, 104),
    "red": (136, 70, 40),
    "grey": (140, 137, 133),
    "white": (206, 203, 198),
}
EYE_COLOURS: dict[str, tuple[int, int, int]] = {
    "dark brown": (62, 40, 27),
    "brown": (98, 66, 40),
    "hazel": (122, 98, 56),
    "green": (98, 118, 84),
    "blue": (92, 126, 156),
    "grey": (122, 132, 138),
}
# Colours that go with everything.
NEUTRALS: Swatches = (
    (236, 234, 229),
    (222, 212, 194),
    (176, 175, 174),
    (108, 109, 112),
    (62, 64, 68),
    (32, 33, 36),
    (34, 44, 70),
    (158, 138, 112),
    (92, 74, 58),
    (86, 90, 70),
)
# Colours of which a person wears one.
ACCENTS: Swatches = (
    (66, 98, 146),
    (128, 162, 196),
    (142, 40, 46),
    (194, 82, 64),
    (218, 166, 70),
    (92, 112, 72),
    (44, 82, 68),
    (112, 76, 114),
    (212, 156, 162),
    (92, 158, 154),
    (196, 196, 150),
    (206, 120, 66),
    (150, 178, 150),
    (176, 158, 200),
)
DENIM: Swatches = (
    (44, 58, 90),
    (66, 88, 124),
    (34, 38, 48),
    (104, 128, 158),
    (54, 72, 104),
    (150, 168, 188),
    (58, 60, 64),
)
TROUSERS: Swatches = (
    (36, 38, 42),
    (78, 79, 82),
    (150, 132, 104),
    (190, 172, 142),
    (66, 70, 54),
    (38, 46, 68),
    (88, 66, 52),
    (216, 208, 194),
)
LEATHER: Swatches = ((30, 27, 26), (64, 42, 30), (98, 64, 40), (134, 92, 58), (40, 40, 44))
TRAINERS: Swatches = (
    (232, 232, 229),
    (34, 34, 36),
    (66, 78, 112),
    (146, 46, 46),
    (122, 124, 126),
    (210, 200, 180),
    (70, 92, 80),
)
RUBBER: Swatches = ((234, 232, 226), (40, 38, 36), (186, 150, 106))
BUTTONS: Swatches = ((222, 216, 202), (44, 42, 42), (112, 82, 58), (150, 146, 140))
METAL: Swatches = ((188, 188, 190), (168, 140, 92), (74, 74, 78))


def rounded(rgb: np.ndarray) -> Colour:
    """A colour with four digits, within [0, 1]."""
    r, g, b = np.clip(np.round(rgb, 4), 0.0, 1.0).tolist()
    return (r, g, b)


def picked(generator: np.random.Generator, swatches: Swatches) -> Colour:
    """One of the swatches, a little different each time."""
    base = np.array(swatches[generator.integers(len(swatches))]) / 255.0
    return rounded(base * (1.0 + generator.normal(0, 0.05)) + generator.normal(0, 0.012, 3))


def lightness(colour: Colour | np.ndarray) -> float:
    """Rec. 601 luma in [0, 1]."""
    return float(np.asarray(colour) @ [0.299, 0.587, 0.114])


def contrasting(generator: np.random.Generator, base: Colour, least: float = 0.25) -> Colour:
    """A neutral, or a lighter or darker tone of `base`, that stands out from it."""
    for _ in range(24):
        if generator.random() < 0.45:
            other = np.array(picked(generator, NEUTRALS))
        elif generator.random() < 0.3:
            other = np.array(picked(generator, ACCENTS))
        else:
            change = generator.uniform(0.3, 0.6)
            other = np.array(base) + change * (1.0 - np.array(base))
            if lightness(base) > 0.5:
                other = np.array(base) * (1.0 - change)
        if abs(lightness(other) - lightness(base)) >= least:
            return rounded(other)
    return (0.93, 0.92, 0.90) if lightness(base) < 0.5 else (0.13, 0.14, 0.16)
