"""The back branch's generator: a U-Net that gives the body's bare back its clothes."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from trainer.networks.blocks import Decoder, Encoder, check_maps, check_width, initialise


@dataclass(frozen=True)
class BackNetConfig:
    """What a user chooses of the back's network."""

    width: int = 32
    """Channels of the first layer, a multiple of 8; the next have 2, 4 and, from the fourth on, 8
    times as many. Time and memory grow with it, parameters with its square; pix2pix has 64.
    """

    def __post_init__(self) -> None:
        check_width("back.width", self.width)


class BackNet(nn.Module):
    """The generator G of Eq. 5: coarse back depth to fine back depth and a silhouette.

    A U-Net of eight encoder layers and eight decoder layers, as pix2pix's for 256 x 256, at any
    size from one pixel: a layer halves a side and rounds up, so that 424 x 512 ends in 2 x 2 and a
    side of one pixel stays. It predicts a correction to a depth, zero before any training: the
    untrained network returns the depth it is given. There is no dropout, which pix2pix has for a
    generator's noise: one body has one back.

    Parameters: 63,608,834 at width 64, 15,908,866 at 32, 3,980,546 at 16 (two input channels).

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
        self.inputs, self.correction = inputs, correction
        self.encoder = Encoder(inputs, channels)
        self.decoder = Decoder(channels[-1], inputs, channels, 2)
        initialise(self)

    def forward(self, maps: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
        """Fine back depth and the silhouette's logit, both (B, 1, H, W).

        The depth is in the units of `depth` and not clipped; a logit above 0 is inside.

        Args:
            maps: (B, inputs, H, W), about -1 to 1: all that the network sees.
            depth: (B, 1, H, W), normalised to [-1, 1]: what is corrected.

        Raises:
            ValueError: a shape is another.
        """
        check_maps("maps", maps, self.inputs)
        check_maps("depth", depth, 1)
        *features, deepest = self.encoder(maps)
        correction, logit = self.decoder(deepest, [maps, *features]).split(1, dim=1)
        return depth + self.correction * correction, logit
