"""The front branch: a U-Net that takes the noise from a depth map."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from trainer.networks.attention import CrossAttention
from trainer.networks.blocks import Decoder, Encoder, check_maps, check_width, initialise
from trainer.networks.detail import detail, visible

CORRECTION = 0.02
"""Normalised depth that the network's output of 1 corrects: some 15 mm.

Adam's first steps change an output by about its rate times the layer's features, a tenth or so;
in normalised depth that would be many times the noise that is to be taken away.
"""

WINDOWS = (3, 5, 9)
"""Pixels across the surroundings that noise differs from."""


@dataclass(frozen=True)
class FrontNetConfig:
    """What a user chooses of the front's network."""

    width: int = 32
    """Channels of the first layer, a multiple of 8; the next three have 2, 4 and 8 times as many.

    Time and memory grow with it, parameters with its square.
    """
    attention: bool = True
    """Cross-attention at the bottleneck; without it a plain U-Net (Table 3's "U-Net")."""
    detail: bool = True
    """See the depth's detail and predict shares of it; without it neither goes in nor comes out."""

    def __post_init__(self) -> None:
        check_width("branch.net.width", self.width)


class FrontNet(nn.Module):
    """Colour and noisy front depth to denoised front depth, at any size from one pixel.

    It is told where the depth is a reading, and where a hole that was filled in.

    A U-Net of four encoder layers, which halve the grid each, and four decoder layers. Beside the
    depth it is given the depth's detail, what the depth differs by from the means of its
    surroundings. It predicts, at every pixel, how much of each of these differences is noise, and a
    correction to what is left, all zero before any training: the untrained network returns the
    depth it is given.

    Parameters: 2,545,412 at width 32, 639,108 at 16; without attention 2,274,564 and 571,268.

    Source: "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", section 3.3,
    Figure 3. The widths, the layers' convolutions and the shares and the correction in place of the
    depth are choices made here.
    """

    def __init__(self, config: FrontNetConfig) -> None:
        super().__init__()
        channels = [config.width * factor for factor in (1, 2, 4, 8)]
        self.detailed = config.detail
        details = len(WINDOWS) if config.detail else 0
        inputs = 5 + details
        self.encoder = Encoder(inputs, channels)
        self.attention = CrossAttention(channels[3], channels[2]) if config.attention else None
        deepest = channels[3] if self.attention is None else self.attention.channels
        self.decoder = Decoder(deepest, inputs, channels, 1 + details)
        initialise(self)

    def forward(self, rgb: Tensor, depth: Tensor, valid: Tensor, mask: Tensor) -> Tensor:
        """Denoised depth, (B, 1, H, W), in the units of `depth` and not clipped.

        Args:
            rgb: (B, 3, H, W) colour, about -1 to 1.
            depth: (B, 1, H, W) noisy depth, normalised to [-1, 1].
            valid: (B, 1, H, W) bool, where the depth is the sensor's own and not filled in.
            mask: (B, 1, H, W) bool, the silhouette.

        Raises:
            ValueError: a shape is another.
        """
        check_maps("rgb", rgb, 3)
        check_maps("depth", depth, 1)
        check_maps("valid", valid, 1)
        check_maps("mask", mask, 1)
        maps = torch.cat([rgb, depth, 2.0 * valid - 1], dim=1)
        if self.detailed:
            differences = detail(depth, mask, WINDOWS)
            maps = torch.cat([maps, visible(differences)], dim=1)
        features = self.encoder(maps)
        deepest = features[3]
        if self.attention is not None:
            deepest = self.attention(deepest, features[2])
        outputs = self.decoder(deepest, [maps, *features[:3]])
        found = depth + CORRECTION * outputs[:, :1]
        if self.detailed:
            found = found - (outputs[:, 1:] * differences).sum(dim=1, keepdim=True)
        return found
