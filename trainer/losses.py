"""The losses of both branches.

Section 3.6 of "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", by the
numbers of its equations, with the coefficients of its section 4.1.

The paper's norms are written without a denominator. Here each is a mean over the subject's pixels,
not the frame's: empty background has no error and would only scale a loss by how much of the frame
the subject fills. All terms share that region, so the coefficients keep their ratios.

Where torchrun started several processes they divide by the pixels of all: every loss here is a
meeting of all of them, each with its part of the batch, in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor
from torch.nn.functional import adaptive_max_pool2d, logsigmoid

from trainer import processes

Features = Callable[[Tensor], Sequence[Tensor]]
"""From (B, 3, H, W) normals to the maps of VGG19's five layers, see `trainer.networks.vgg`."""
Terms = dict[str, Tensor]
"""A total's terms by name, before their coefficients and cut from the graph: for logging."""

VGG_WEIGHTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0)
"""lambda_v of Eq. 9, from the first layer to the fifth."""

MILLIMETRES = 1000.0
"""In a metre."""

_LEAST = 1e-6
"""Pixels, in place of none."""


@dataclass(frozen=True)
class FrontWeights:
    """Coefficients gamma of Eq. 10; section 4.1."""

    depth: float = 1.0
    """Of L_D, millimetres."""
    normal: float = 20.0
    """Of L_N."""
    vgg: float = 20.0
    """Of L_V."""
    gan: float = 5.0
    """Of the generator's side of L_G, where a discriminator judges the front (Table 3's "nGAN")."""
    matching: float = 20.0
    """Of L_M, likewise."""

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class BackWeights:
    """Coefficients beta of Eq. 14; section 4.1."""

    depth: float = 10.0
    """Of L_D, millimetres."""
    gan: float = 5.0
    """Of the generator's side of L_G."""
    matching: float = 20.0
    """Of L_M, the discriminator's features."""
    silhouette: float = 20.0
    """Of L_P."""
    vgg: float = 1.0
    """Of L_V."""

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Surface:
    """Maps of one side of a batch, predicted or true."""

    depth: Tensor
    """(B, 1, H, W) metres from the front camera's plane."""
    normal: Tensor
    """(B, 3, H, W) unit, front camera's frame; a predicted one by `trainer.normals.normals`."""


def mean_l1(a: Tensor, b: Tensor, mask: Tensor) -> Tensor:
    """Mean absolute difference over the mask's pixels and all channels; 0 where the mask is empty.

    Args:
        a, b: (B, C, H, W). Values outside the mask do not matter, even where not finite.
        mask: (B, 1, H, W) bool.
    """
    return _mean((a - b).abs(), mask)


def depth_loss(depth: Tensor, true: Tensor, mask: Tensor) -> Tensor:
    """L_D, Eq. 7: millimetres.

    The paper names no unit of L_D; millimetres are chosen here. With the paper's coefficients a
    sensor's noise then weighs as much as that noise's normals (Eq. 10), and a back nearly five
    times as much as all other terms in the first epoch, 1.7 times in the last (Eq. 14). Metres
    would leave L_D no say.

    Args:
        depth, true: (B, 1, H, W) metres.
        mask: (B, 1, H, W) bool, the subject's silhouette.
    """
    return MILLIMETRES * mean_l1(depth, true, mask)


def normal_loss(normal: Tensor, true: Tensor, mask: Tensor) -> Tensor:
    """L_N, Eq. 8: of (B, 3, H, W) normals; the mean over their three parts too."""
    return mean_l1(normal, true, mask)


def vgg_loss(normal: Tensor, true: Tensor, mask: Tensor, vgg: Features) -> Tensor:
    """L_V, Eq. 9: features of VGG19, each layer's mean over the mask at the layer's scale."""
    total = normal.new_zeros(())
    for weight, ours, theirs in zip(VGG_WEIGHTS, vgg(normal), vgg(true), strict=True):
        total = total + weight * mean_l1(ours, theirs, at_scale(mask, ours))
    return total


def front_loss(
    predicted: Surface,
    true: Surface,
    mask: Tensor,
    weights: FrontWeights,
    vgg: Features | None,
    fake: Sequence[Tensor] = (),
    real: Sequence[Tensor] = (),
) -> tuple[Tensor, Terms]:
    """L_front, Eq. 10; with a discriminator's layers also Eq. 11 and 12 (Table 3's "U-Net+nGAN").

    Args:
        mask: (B, 1, H, W) bool, the subject's silhouette.
        vgg: None leaves L_V out, of the sum and of the terms.
        fake, real: the discriminator's layers for the predicted maps and the true ones, as
            `matching_loss` takes them; none leave its terms out.

    Returns:
        The weighted sum, and its terms "depth", "normal", "vgg", "gan" and "matching".
    """
    terms = {
        "depth": depth_loss(predicted.depth, true.depth, mask),
        "normal": normal_loss(predicted.normal, true.normal, mask),
        **_adversarial(fake, real, mask),
        **_perceptual(predicted, true, mask, vgg),
    }
    return _total(terms, weights)


def gan_loss(real: Tensor, fake: Tensor, mask: Tensor) -> Tensor:
    """L_G, Eq. 11, as it stands: E[log D(real)] + E[log(1 - D(fake))], at most 0.

    A Markovian discriminator judges patches; the means run over those whose cell of the frame holds
    any of the subject. Logarithms are taken of logits, so a sure discriminator gives no infinity.

    Args:
        real, fake: (B, 1, h, w) logits, D before its sigmoid, for the true normals and the
            generator's.
        mask: (B, 1, H, W) bool, the subject's silhouette.
    """
    mask = at_scale(mask, real)
    return _mean(logsigmoid(real), mask) + _mean(logsigmoid(-fake), mask)


def generator_gan_loss(fake: Tensor, mask: Tensor) -> Tensor:
    """The generator's side of Eq. 11, in the form that does not saturate: -E[log D(fake)].

    The literal E[log(1 - D(fake))] has the same fixed point, but its gradient vanishes where the
    discriminator is sure, as it soon is of a young generator. Goodfellow et al. (Generative
    Adversarial Nets, 2014, section 3), whom the paper cites, train by this form for that reason.
    E[log D(real)] does not depend on the generator.
    """
    return -_mean(logsigmoid(fake), at_scale(mask, fake))


def matching_loss(fake: Sequence[Tensor], real: Sequence[Tensor], mask: Tensor) -> Tensor:
    """L_M, Eq. 12: the discriminator's features of layers 2 to T-1, the real ones constant.

    Args:
        fake, real: the maps of its T layers for the generator's normals and the true ones,
            (B, C, h, w) each; the last are the logits.
        mask: (B, 1, H, W) bool, the subject's silhouette.

    Raises:
        ValueError: there is no layer between the first and the last.
    """
    if len(fake) < 3:
        raise ValueError(f"the discriminator has {len(fake)} layers; Eq. 12 needs 3 or more")
    total = mask.new_zeros((), dtype=fake[0].dtype)
    for ours, theirs in zip(fake[1:-1], real[1:-1], strict=True):
        total = total + mean_l1(ours, theirs.detach(), at_scale(mask, ours))
    return total


def silhouette_loss(predicted: Tensor, mask: Tensor) -> Tensor:
    """L_P, Eq. 13: the absolute error of a soft silhouette, per pixel of the subject's.

    The paper's P_L is the silhouette of the estimated parametric body, which no generator changes:
    the literal term would be a constant without a gradient. P_L is therefore the silhouette that
    the generator predicts beside its depth, soon met where it is given H_L as well. Its error
    counts all over the frame, or a prediction of 1 everywhere would be perfect, and is divided by
    the subject's pixels like every other term.

    Args:
        predicted: P_L, (B, 1, H, W) from 0 to 1.
        mask: H_L, (B, 1, H, W) bool. Where it is empty the loss is 0.
    """
    error = (predicted - mask.to(predicted.dtype)).abs().sum()
    pixels = processes.mean(mask.sum().to(error.dtype))
    return torch.where(pixels > 0, error / pixels.clamp_min(_LEAST), 0)


def generator_loss(
    predicted: Surface,
    true: Surface,
    silhouette: Tensor,
    fake: Sequence[Tensor],
    real: Sequence[Tensor],
    mask: Tensor,
    weights: BackWeights,
    vgg: Features | None,
) -> tuple[Tensor, Terms]:
    """L_back^(G), Eq. 14: what the generator of the back descends.

    Args:
        silhouette: (B, 1, H, W) from 0 to 1, predicted.
        fake, real: the discriminator's layers for the predicted normals and the true ones, as
            `matching_loss` takes them.
        mask: (B, 1, H, W) bool, the subject's silhouette.
        vgg: None leaves L_V out, of the sum and of the terms.

    Returns:
        The weighted sum, and its terms "depth", "gan", "matching", "silhouette" and "vgg".
    """
    terms = {
        "depth": depth_loss(predicted.depth, true.depth, mask),
        "silhouette": silhouette_loss(silhouette, mask),
        **_adversarial(fake, real, mask),
        **_perceptual(predicted, true, mask, vgg),
    }
    return _total(terms, weights)


def discriminator_loss(real: Tensor, fake: Tensor, mask: Tensor) -> tuple[Tensor, Terms]:
    """L_back^(D), Eq. 15: what the discriminator descends.

    Eq. 15 equates it with L_G, which the discriminator raises; a loss to descend is -L_G.
    At chance it is 2 log 2.

    Args:
        real, fake: (B, 1, h, w) logits; `fake` of normals that are detached from the generator.
        mask: (B, 1, H, W) bool, the subject's silhouette.

    Returns:
        The loss, and the same as its only term, "gan".
    """
    loss = -gan_loss(real, fake, mask)
    return loss, {"gan": loss.detach()}


def at_scale(mask: Tensor, like: Tensor) -> Tensor:
    """(B, 1, h, w) bool: a mask on the grid of another map, set where a cell holds any of it."""
    return adaptive_max_pool2d(mask.float(), like.shape[-2:]) > 0


def _adversarial(fake: Sequence[Tensor], real: Sequence[Tensor], mask: Tensor) -> Terms:
    if not fake:
        return {}
    return {
        "gan": generator_gan_loss(fake[-1], mask),
        "matching": matching_loss(fake, real, mask),
    }


def _perceptual(predicted: Surface, true: Surface, mask: Tensor, vgg: Features | None) -> Terms:
    return {} if vgg is None else {"vgg": vgg_loss(predicted.normal, true.normal, mask, vgg)}


def _mean(values: Tensor, mask: Tensor) -> Tensor:
    """Of (B, C, H, W) over the pixels of a (B, 1, H, W) mask; 0 where there are none.

    Where several processes share a batch it is divided by their mean number of pixels: the mean of
    their losses, and so of their gradients, is then that of the whole batch.
    """
    count = processes.mean(mask.sum().to(values.dtype)) * values.shape[1]
    return torch.where(mask, values, 0).sum() / count.clamp_min(_LEAST)


def _total(terms: Terms, weights: FrontWeights | BackWeights) -> tuple[Tensor, Terms]:
    """The weighted sum, and the terms without a graph."""
    total = sum(getattr(weights, name) * term for name, term in terms.items())
    return total, {name: term.detach() for name, term in terms.items()}


def _check(weights: FrontWeights | BackWeights) -> None:
    for field in fields(weights):
        value = getattr(weights, field.name)
        if not 0 <= value < math.inf:
            raise ValueError(
                f"{type(weights).__name__}.{field.name}: {value}; give a number of 0 or more, "
                f"such as {field.default:g}"
            )
