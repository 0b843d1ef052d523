"""The cross-attention between the two deepest features of the front's U-Net."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from trainer.networks.blocks import SLOPE, even


class CrossAttention(nn.Module):
    """The module CA: quiet global features decide what is taken from noisy finer ones.

        f_m  = sigmoid(M1(f_b) x M2(f_b)^T / sqrt(d) - ln N)
        f'_b = (f_m x M3(f_3)) || f_b

    f_b are the deepest features, f_3 those of the layer before, of twice the resolution; M1, M2
    and M3 are perceptrons of two layers, each applied to every token, to lower dimensions: d =
    C / 4 for queries and keys and C / 2 for values, where f_b has C channels.

    **How the grids meet.** The N tokens are the pixels of f_b's grid, and the token of f_3 is its
    cell of 2 x 2 pixels side by side, which M3 reduces: no feature is averaged or dropped. Were
    f_b spread over f_3's grid instead, the four pixels of a cell would have one query and one key
    and so one weight, and only the sum of their values would count, at 16 times the memory: a
    frame of 424 x 512 has 27 x 32 tokens, so f_m is 3 MB per sample, and not 46 MB.

    **What differs from the letter.** The equations have neither sqrt(d) nor ln N. Without them a
    sigmoid starts at one half, so the sum of N values is N / 2 times their mean: some hundreds,
    and another number for every size of frame. With ln N the weights of a token begin near 1 / N
    and their sum near 1, at any N, yet one weight alone may still grow to 1, which a division of
    the sum by N would forbid (Ramapuram et al., "Theory, analysis, and best practices for sigmoid
    self-attention", ICLR 2025). sqrt(d) keeps the scores' spread the same at any width. M1 and M2
    could learn both for one size of frame: what can be expressed there is the same.

    Source: "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", section
    3.3, Eq. 1 and 2, Figure 4.

    Args:
        deep: channels of f_b, a multiple of 4.
        finer: channels of f_3.
    """

    def __init__(self, deep: int, finer: int) -> None:
        super().__init__()
        self.query = _perceptron(deep, deep // 4)
        self.key = _perceptron(deep, deep // 4)
        self.value = _perceptron(4 * finer, deep // 2)
        self.channels = deep + deep // 2
        """Of f'_b."""

    def weights(self, deep: Tensor) -> Tensor:
        """Eq. 1: f_m, (B, N, N) between 0 and 1; row i holds what token i takes of each."""
        tokens = _tokens(deep)
        query, key = self.query(tokens), self.key(tokens)
        # In half precision ln N would be rounded by some hundredths.
        scores = query @ key.transpose(1, 2) / math.sqrt(query.shape[2])
        scores = scores.to(torch.promote_types(scores.dtype, torch.float32))
        return torch.sigmoid(scores - math.log(tokens.shape[1]))

    def forward(self, deep: Tensor, finer: Tensor) -> Tensor:
        """Eq. 2: f'_b, (B, 3 C / 2, H, W): what is attended, then f_b.

        Args:
            deep: f_b, (B, C, H, W).
            finer: f_3, (B, C', h, w) with H = ceil(h / 2), W = ceil(w / 2).
        """
        cells = functional.pixel_unshuffle(even(finer), 2)
        if cells.shape[-2:] != deep.shape[-2:]:
            raise ValueError(
                f"finer features {tuple(finer.shape)} are not twice the size of {tuple(deep.shape)}"
            )
        attended = self.weights(deep) @ self.value(_tokens(cells))
        attended = attended.transpose(1, 2).unflatten(2, deep.shape[-2:])
        return torch.cat([attended, deep], dim=1)


def _tokens(maps: Tensor) -> Tensor:
    """(B, C, H, W) maps as (B, H W, C) tokens, row by row."""
    return maps.flatten(2).transpose(1, 2)


def _perceptron(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, outputs), nn.LeakyReLU(SLOPE), nn.Linear(outputs, outputs)
    )
