"""The front branch: a U-Net that takes the noise from a depth map."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from trainer.attention import CrossAttention
from trainer.blocks import Decoder, Encoder, check_maps, check_width, initialise


@dataclass(frozen=True)
class FrontNetConfig:
    """What a user chooses of the front's network."""

    width: int = 32
    """Channels of the first layer, a multiple of 8; the next three have 2, 4 and 8 times as many.

    Time and memory grow with it, parameters with its square.
    """
    attention: bool = True
    """Cross-attention at the bottleneck; without it a plain U-Net (Table 3's "U-Net")."""

    def __post_init__(self) -> None:
        check_width("front.width", self.width)


class FrontNet(nn.Module):
    """Colour and noisy front depth to denoised front depth, at any size from one pixel.

    A U-Net of four encoder layers, which halve the grid each, and four decoder layers. It predicts
    a correction to the depth, zero before any training: the untrained network returns the depth it
    is given.

    Parameters: 2,541,345 at width 32, 637,073 at 16; without attention 2,270,497 and 569,233.

    Source: "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", section 3.3,
    Figure 3. The widths, the layers' convolutions and the correction in place of the depth are
    choices made here.
    """

    def __init__(self, config: FrontNetConfig) -> None:
        super().__init__()
        channels = [config.width * factor for factor in (1, 2, 4, 8)]
        self.encoder = Encoder(4, channels)
        self.attention = CrossAttention(channels[3], channels[2]) if config.attention else None
        deepest = channels[3] if self.attention is None else self.attention.channels
        self.decoder = Decoder(deepest, 4, channels, 1)
        initialise(self)

    def forward(self, rgb: Tensor, depth: Tensor) -> Tensor:
        """Denoised depth, (B, 1, H, W), in the units of `depth` and not clipped.

        Args:
            rgb: (B, 3, H, W) colour, about -1 to 1.
            depth: (B, 1, H, W) noisy depth, normalised to [-1, 1].

        Raises:
            ValueError: a shape is another.
        """
        check_maps("rgb", rgb, 3)
        check_maps("depth", depth, 1)
        maps = torch.cat([rgb, depth], dim=1)
        features = self.encoder(maps)
        deepest = features[3]
        if self.attention is not None:
            deepest = self.attention(deepest, features[2])
        return depth + self.decoder(deepest, [maps, *features[:3]])
