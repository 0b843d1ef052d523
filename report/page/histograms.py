"""The part of a page that says how depth, thickness, noise, yaw and coverage are distributed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any

import numpy as np

from report.page.measure import DEPTH_MM, MOST_RESIDUAL, RESIDUAL, SAMPLED, THICKNESS_MM

DEGREES, SHARE = 2.0, 0.01
"""Widths of the bins of yaw and coverage."""


@dataclass(frozen=True)
class Histogram:
    """Values in bins of `width` from `first` on.

    Attributes:
        name: of its place in the page.
        title, unit: of the plot and its axis.
        values: how many are in each bin.
        normal: whether the model says a normal distribution, which is drawn beside it.
    """

    name: str
    title: str
    unit: str
    values: Sequence[int]
    first: float
    width: float
    normal: bool = False

    def record(self) -> dict[str, Any]:
        """As the page's script takes it."""
        return asdict(self)

    def quantile(self, share: float) -> float:
        """Below which a share of the values lies; within a bin they are spread evenly."""
        ends = np.concatenate([[0], np.cumsum(self.values)])
        places = self.first + self.width * np.arange(len(ends))
        return float(np.interp(share * ends[-1], ends, places))

    def told(self) -> str:
        """What a reader sees in it, in words."""
        # To a tenth of a bin; 0 has no sign.
        digits = max(0, 1 - math.floor(math.log10(self.width)))
        low, median, high = (
            f"{round(self.quantile(share), digits) + 0.0:.{digits}f}" for share in (0.05, 0.5, 0.95)
        )
        return f"median {median}, nine tenths from {low} to {high}"

    def plot(self) -> str:
        """HTML of the place where the page draws it, with its words."""
        label = escape(f"Histogram: {self.title}, {self.unit}; {self.told()}")
        return (
            f'<figure class="plotted"><div class="plot" id="histogram-{self.name}" role="img" '
            f'aria-label="{label}"></div><figcaption>{escape(self.told())}</figcaption></figure>'
        )


@dataclass(frozen=True)
class Histograms:
    """All of a dataset, and what its sensor did.

    Attributes:
        read, lost: pixels of the subjects that the sensor saw, and did not see.
        residuals: in words.
    """

    plots: list[Histogram]
    read: int
    lost: int
    residuals: str

    @classmethod
    def of(cls, counts: Sequence[dict[str, Any]]) -> Histograms:
        """Of `measure.counts` of one subject or more."""

        def total(name: str) -> list[int]:
            return np.sum([of[name] for of in counts], axis=0).tolist()

        def binned(name: str, low: float, high: float, width: float) -> list[int]:
            values = np.concatenate([of[name] for of in counts])
            return np.histogram(values, np.arange(low, high + width / 2, width))[0].tolist()

        residual = total("residual")
        plots = [
            Histogram(
                name="depth",
                title="Depth, front and back",
                unit="metres from the camera plane",
                values=total("depth"),
                first=0,
                width=DEPTH_MM / 1000,
            ),
            Histogram(
                name="thickness",
                title="Thickness",
                unit="metres from front to back",
                values=total("thickness"),
                first=0,
                width=THICKNESS_MM / 1000,
            ),
            Histogram(
                name="residual",
                title="Sensor's residual beside its model",
                unit="standard deviations of the model",
                values=residual,
                first=-len(residual) * RESIDUAL / 2,
                width=RESIDUAL,
                normal=True,
            ),
            Histogram(
                name="yaw",
                title="Yaw of all views",
                unit="degrees",
                values=binned("yaw_deg", -180, 180, DEGREES),
                first=-180,
                width=DEGREES,
            ),
            Histogram(
                name="coverage",
                title="Coverage of all views",
                unit="share of the image's pixels",
                values=binned("coverage", 0, 1, SHARE),
                first=0,
                width=SHARE,
            ),
        ]
        read, lost, measured, beyond = (
            sum(of[name] for of in counts) for name in ("read", "lost", "measured", "beyond")
        )
        told = "There are no residuals: the sensor has no noise, or its model is not known here."
        if measured:
            low, high = (plots[2].quantile(share) for share in (0.1587, 0.8413))
            told = (
                f"Two thirds of its residuals lie within {(high - low) / 2:.2f} standard "
                "deviations of the model (1 where the reading follows it); "
                f"{beyond / measured:.1%} are larger than {MOST_RESIDUAL:g}, and are drawn in the "
                "outermost bars."
            )
        return cls([one for one in plots if any(one.values)], read, lost, told)

    def section(self) -> str:
        """HTML: the sensor in words, and the places of the plots."""
        said = (
            f"Depths, thickness and residuals of up to {SAMPLED} views of each subject; yaw and "
            f"coverage of all. The sensor read {self.read:,} pixels of the subjects and lost "
            f"{self.lost:,} ({self.lost / max(self.read + self.lost, 1):.1%}). {self.residuals}"
        )
        plots = "".join(one.plot() for one in self.plots)
        return f'<p>{said}</p><div class="plots">{plots}</div>'
