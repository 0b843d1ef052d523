"""What the networks are built of: convolutions, the halving and the doubling layer of a U-Net."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

GROUP = 8
"""Channels that are normalised together; widths are multiples of it."""

SLOPE = 0.2
"""Of the leaky ReLU, as in pix2pix."""


def even(maps: Tensor) -> Tensor:
    """(B, C, H, W) maps with even sides: an odd side's last row or column is repeated.

    Padded so at every halving, a map of any size, one pixel included, has as many layers as a
    network asks for. It is the padding of the input to the next multiple of 2^layers without its
    waste: eight layers would make 512 x 512 of 424 x 512, and 256 x 256 of a crop of 53 x 37.
    """
    if maps.shape[-2] % 2:
        maps = torch.cat([maps, maps[..., -1:, :]], dim=-2)
    if maps.shape[-1] % 2:
        maps = torch.cat([maps, maps[..., -1:]], dim=-1)
    return maps


def convolution(inputs: int, outputs: int, *, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    """Convolution, group norm and leaky ReLU, in this order.

    The norm's statistics are of one sample, so batches may be small and training and inference
    agree; batch norm has neither. Instance norm has both, but nothing to say of the one pixel at
    the bottom of a deep U-Net, where a group still has its channels.
    """
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding=1, bias=False),
        nn.GroupNorm(outputs // GROUP, outputs),
        nn.LeakyReLU(SLOPE, inplace=True),
    )


class Down(nn.Module):
    """A layer of an encoder: (B, C, H, W) to (B, C', ceil(H / 2), ceil(W / 2))."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.halve = convolution(inputs, outputs, kernel=4, stride=2)
        self.refine = convolution(outputs, outputs)

    def forward(self, maps: Tensor) -> Tensor:
        return self.refine(self.halve(even(maps)))


class Up(nn.Module):
    """A layer of a decoder: twice the size, cropped to the encoder's map, which it joins.

    Pixels are repeated and then convolved. A transposed convolution leaves a checkerboard (Odena
    et al., "Deconvolution and checkerboard artifacts", 2016), which normals of depth would show.
    """

    def __init__(self, inputs: int, skip: int, outputs: int) -> None:
        super().__init__()
        self.join = convolution(inputs + skip, outputs)
        self.refine = convolution(outputs, outputs)

    def forward(self, maps: Tensor, skip: Tensor) -> Tensor:
        height, width = skip.shape[-2:]
        maps = functional.interpolate(maps, scale_factor=2.0, mode="nearest")
        return self.refine(self.join(torch.cat([maps[..., :height, :width], skip], dim=1)))


class Encoder(nn.Module):
    """Halving layers, one after the other.

    Args:
        inputs: channels of the input.
        channels: of each layer's result.
    """

    def __init__(self, inputs: int, channels: Sequence[int]) -> None:
        super().__init__()
        pairs = zip((inputs, *channels), channels, strict=False)
        self.layers = nn.ModuleList(Down(before, after) for before, after in pairs)

    def forward(self, maps: Tensor) -> list[Tensor]:
        """Every layer's result, the finest first."""
        results = []
        for layer in self.layers:
            maps = layer(maps)
            results.append(maps)
        return results


class Decoder(nn.Module):
    """Doubling layers that join an encoder's results and at last its input, and a convolution.

    The last convolution begins at zero: what is predicted begins at zero everywhere.

    Args:
        deepest: channels of what is decoded.
        inputs: channels of the encoder's input.
        channels: of each of the encoder's layers.
        outputs: channels of the prediction.
    """

    def __init__(self, deepest: int, inputs: int, channels: Sequence[int], outputs: int) -> None:
        super().__init__()
        skips = (inputs, *channels[:-1])
        after = (channels[0], *channels[:-1])
        before = (*after[1:], deepest)
        self.layers = nn.ModuleList(
            Up(*each) for each in reversed(list(zip(before, skips, after, strict=True)))
        )
        self.head = nn.Conv2d(channels[0], outputs, 3, padding=1)

    def forward(self, maps: Tensor, skips: Sequence[Tensor]) -> Tensor:
        """(B, outputs, H, W).

        Args:
            maps: what is decoded.
            skips: the encoder's input and its results but the last, the finest first.
        """
        for layer, skip in zip(self.layers, reversed(skips), strict=True):
            maps = layer(maps, skip)
        return self.head(maps)


def initialise(network: nn.Module) -> None:
    """Draws all weights anew from torch's generator: the same after the same `torch.manual_seed`.

    Normal, of the variance that keeps a signal's through leaky ReLUs (He et al., ICCV 2015);
    biases are 0, and so is a decoder's last convolution.
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.kaiming_normal_(module.weight, a=SLOPE)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
    for module in network.modules():
        if isinstance(module, Decoder):
            nn.init.zeros_(module.head.weight)


def check_width(key: str, width: int) -> None:
    """Raises ValueError where a network's `width` is no positive multiple of `GROUP`."""
    if width < GROUP or width % GROUP:
        raise ValueError(f"{key}: {width}; give a multiple of {GROUP}, {GROUP} or more")


def check_maps(name: str, maps: Tensor, channels: int) -> None:
    """Raises ValueError where `maps` are not (B, channels, H, W) with a pixel at least."""
    if maps.ndim != 4 or maps.shape[1] != channels or 0 in maps.shape[-2:]:
        raise ValueError(f"{name}: shape {tuple(maps.shape)}; give (B, {channels}, H, W)")
