"""What the paper reports, for standing beside what is found here and never in one table with it.

Values of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", measured there
on THuman2.0, with its own networks, cameras and samples.
"""

from __future__ import annotations

WHERE = "as published, on THuman2.0"

TABLE1 = {
    "PIFuHD": (0.1658, 0.1680, 0.1197),
    "ICON": (0.1916, 0.1965, 0.1339),
    "ECON": (0.2121, 0.2206, 0.1516),
    "NormalGAN": (0.1590, 0.1549, 0.1053),
    "OPlanes": (0.2105, 0.2317, 0.1941),
    "the paper's method": (0.1227, 0.1254, 0.0897),
}
"""Method -> CD x 10^-2, P2S x 10^-2, L2."""

TABLE2 = {
    "PIFuHD": (0.0602, 0.0632, 0.0617),
    "ICON": (0.0688, 0.0711, 0.0700),
    "ECON": (0.0818, 0.0820, 0.0819),
    "NormalGAN": (0.0558, 0.0670, 0.0614),
    "OPlanes": (0.1896, 0.2067, 0.1982),
    "the paper's method": (0.0509, 0.0612, 0.0560),
}
"""Method -> L2 of the front, of the back, of both."""

TABLE3 = {
    "U-Net": (0.0538, 0.1344, 0.1386, 0.0966),
    "U-Net+nGAN": (0.0530, 0.1330, 0.1392, 0.0904),
    "U-Net+CA": (0.0509, 0.1227, 0.1254, 0.0897),
}
"""Front -> L2 of the front, CD x 10^-2, P2S x 10^-2, L2."""

TABLE4 = {
    "nGAN": (0.0670, 0.1574, 0.1551, 0.1002),
    "SMPL+dGAN": (0.0631, 0.1628, 0.1521, 0.0954),
    "SMPL+nGAN": (0.0611, 0.1227, 0.1254, 0.0897),
}
"""Back -> L2 of the back, CD x 10^-2, P2S x 10^-2, L2."""

FIGURE2 = {"easy_up_to_40_mm": 0.8861, "hard_above_100_mm": 0.2556}
"""Shares of the pixels of one easy and one hard image whose front and back differ so much."""
