"""The back branch's generator: a U-Net that gives the body's bare back its clothes."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from trainer.networks.blocks import Decoder, Encoder, check_maps, check_width, initialise
from trainer.networks.detail import detail, visible

WINDOWS = (5, 11, 25)
"""Pixels across the surroundings that a bare body's relief differs from."""


@dataclass(frozen=True)
class BackNetConfig:
    """What a user chooses of the back's network."""

    width: int = 32
    """Channels of the first layer, a multiple of 8; the next have 2, 4 and, from the fourth on, 8
    times as many. Time and memory grow with it, parameters with its square; pix2pix has 64.
    """
    detail: bool = True
    """See the depth's detail and predict shares of it, for clothes hide what the body under them
    has; without it neither goes in nor comes out.
    """

    def __post_init__(self) -> None:
        check_width("branch.generator.width", self.width)


class BackNet(nn.Module):
    """The generator G of Eq. 5: coarse back depth to fine back depth and a silhouette.

    A U-Net of eight encoder layers and eight decoder layers, as pix2pix's for 256 x 256, at any
    size from one pixel: a layer halves a side and rounds up, so that 424 x 512 ends in 2 x 2 and a
    side of one pixel stays. It predicts how much of the depth's detail is to go, and a correction
    to what is left, zero before any training: the untrained network returns the depth it is given.
    There is no dropout, which pix2pix has for a generator's noise: one body has one back.

    Parameters: 63,615,365 at width 64, 15,912,133 at 32, 3,982,181 at 16 (two input channels).

    Args:
        inputs: channels of the input.
        correction: normalised depth that an output of 1 corrects: clothes are centimetres thick,
            a tenth of the range, and people some decimetres.

    Source: "Fine Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", section 3.4,
    Eq. 5 and 13. The silhouette is a second output, for its loss to have something to learn from.
    """

    def __init__(self, config: BackNetConfig, inputs: int, correction: float = 0.1) -> None:
        super().__init__()
        channels = [config.width * factor for factor in (1, 2, 4, 8, 8, 8, 8, 8)]
        self.inputs, self.correction, self.detailed = inputs, correction, config.detail
        details = len(WINDOWS) if config.detail else 0
        self.encoder = Encoder(inputs + details, channels)
        self.decoder = Decoder(channels[-1], inputs + details, channels, 2 + details)
        initialise(self)

    def forward(self, maps: Tensor, depth: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Fine back depth and the silhouette's logit, both (B, 1, H, W).

        The depth is in the units of `depth` and not clipped; a logit above 0 is inside.

        Args:
            maps: (B, inputs, H, W), about -1 to 1: what the network sees.
            depth: (B, 1, H, W), normalised to [-1, 1]: what is corrected.
            mask: (B, 1, H, W) bool, where the network sees that depth's detail.

        Raises:
            ValueError: a shape is another.
        """
        check_maps("maps", maps, self.inputs)
        check_maps("depth", depth, 1)
        check_maps("mask", mask, 1)
        if self.detailed:
            differences = detail(depth, mask, WINDOWS)
            maps = torch.cat([maps, visible(differences)], dim=1)
        *features, deepest = self.encoder(maps)
        outputs = self.decoder(deepest, [maps, *features])
        found = depth + self.correction * outputs[:, :1]
        if self.detailed:
            found = found - (outputs[:, 2:] * differences).sum(dim=1, keepdim=True)
        return found, outputs[:, 1:2]
