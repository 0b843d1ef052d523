"""How far a branch is off on views that it has not learned from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import torch

from trainer import processes
from trainer.learner import Learner
from trainer.losses import Surface
from trainer.views import Sample

Figures = dict[str, float | None]
"""Of a branch on some views; None where there was nothing to compare."""


def errors(
    learner: Learner, batches: Iterable[Sample], known: Mapping[str, float | None] | None = None
) -> Figures:
    """Means over the silhouettes' pixels: of what is predicted and of the depth that was given.

    Where there are several processes each brings its own batches; all get the means of all.

    Args:
        known: what an earlier call found of the same batches: what they give is not measured anew.

    Returns:
        "depth_mm" of depth, absolute; "normal_deg", the angle between the normals of Eq. 6 and
        those of the true depth; "given_mm" and "given_deg", the same of what was given, over the
        views that gave something (a back without a body has nothing coarse); the ratios
        "depth_ratio" and "normal_ratio".
    """
    both = torch.zeros(2, 3, dtype=torch.float64, device=learner.device)
    with torch.no_grad():
        for batch in batches:
            true = learner.surface(learner.branch.true(batch), batch)
            both[0] += sums(learner.surface(learner.predict(batch), batch), true, batch.mask)
            if known is None:
                depth = learner.branch.given(batch)
                gave = batch.mask & (depth > 0).any(dim=(1, 2, 3), keepdim=True)
                both[1] += sums(learner.surface(depth, batch), true, gave)
    (depth_mm, normal_deg), (given_mm, given_deg) = map(means, processes.total(both))
    if known is not None:
        given_mm, given_deg = known["given_mm"], known["given_deg"]
    return {
        "given_mm": given_mm,
        "given_deg": given_deg,
        "depth_mm": depth_mm,
        "normal_deg": normal_deg,
        "depth_ratio": _ratio(depth_mm, given_mm),
        "normal_ratio": _ratio(normal_deg, given_deg),
    }


def told(figures: Mapping[str, float | None]) -> str:
    """Figures in a line."""
    said = []
    for kind, unit, digits in (("depth", "mm", 2), ("normal", "deg", 1)):
        found, given = figures[f"{kind}_{unit}"], figures[f"given_{unit}"]
        ratio = figures[f"{kind}_ratio"]
        line = f"{kind} off by " + ("nothing" if found is None else f"{found:.{digits}f} {unit}")
        if given is not None and ratio is not None:
            line += f" of {given:.{digits}f} given ({ratio:.1%})"
        said.append(line)
    return ", ".join(said)


def angle(normal: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """(B, 1, H, W) degrees between (B, 3, H, W) unit normals; by the chord, exact at 0."""
    chord = (normal - true).norm(dim=1, keepdim=True)
    return torch.rad2deg(2 * torch.asin((chord / 2).clamp(max=1)))


def sums(found: Surface, true: Surface, mask: torch.Tensor) -> torch.Tensor:
    """(3,) float64, what `means` divides: the mask's pixels, millimetres and degrees over them."""
    depth = torch.where(mask, 1000 * (found.depth - true.depth).abs(), 0)
    turned = torch.where(mask, angle(found.normal, true.normal), 0)
    return torch.stack([part.double().sum() for part in (mask, depth, turned)])


def means(total: torch.Tensor) -> tuple[float | None, float | None]:
    """Millimetres and degrees per pixel, of some `sums` added up; None of no pixels."""
    pixels, millimetres, degrees = total.tolist()
    return (millimetres / pixels, degrees / pixels) if pixels else (None, None)


def _ratio(found: float | None, given: float | None) -> float | None:
    return None if found is None or not given else found / given
