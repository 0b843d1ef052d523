"""The back branch's discriminator: true or made, patch by patch."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from trainer.networks.blocks import SLOPE, check_maps, check_width, initialise

LAYERS = 5
"""Convolutions, the last to the logits."""


@dataclass(frozen=True)
class DiscriminatorConfig:
    """What a user chooses of the discriminator."""

    width: int = 64
    """Channels of the first layer, a multiple of 8; the next three have 2, 4 and 8 times as many.

    pix2pix has 64.
    """
    strided: int = 4
    """Layers that halve the grid: 4 judges patches of 94 x 94 pixels, 3 patches of 70 x 70 as
    pix2pix does, with about four times as many logits.
    """

    def __post_init__(self) -> None:
        check_width("discriminator.width", self.width)
        if not 1 <= self.strided < LAYERS:
            raise ValueError(
                f"discriminator.strided: {self.strided}; give 1 to {LAYERS - 1} of its layers"
            )

    @property
    def patch(self) -> int:
        """Pixels across the patch that a logit judges."""
        across = 1
        for layer in reversed(range(LAYERS)):
            across = (across - 1) * (2 if layer < self.strided else 1) + 4
        return across

    @property
    def least(self) -> int:
        """Pixels that each side of a map needs at least, for one logit."""
        return (1 + LAYERS - self.strided) * 2**self.strided


class Discriminator(nn.Module):
    """The Markovian discriminator D: every logit judges one patch of a map.

    Five 4 x 4 convolutions, the first `strided` of stride 2, with leaky ReLU 0.2; instance norm
    after all but the first and the last. A norm's mean and spread are of the whole map: by them
    alone a logit depends on more than its patch.

    Parameters: 2,763,841 for normals, 2,761,793 for depth, at width 64; 174,865 for normals at 16.

    Args:
        inputs: channels of the maps it judges: 3 of normals, 1 of depth (Table 4's "dGAN").

    Source: Isola et al., "Image-to-image translation with conditional adversarial networks", CVPR
    2017; all layers' features are for the matching loss of Wang et al., CVPR 2018 (Eq. 12 of "Fine
    Back Surfaces Oriented Human Reconstruction for Single RGB-D Images", section 3.4 and 3.6).
    """

    def __init__(self, config: DiscriminatorConfig, inputs: int) -> None:
        super().__init__()
        self.config, self.inputs = config, inputs
        channels = [inputs, *(config.width * factor for factor in (1, 2, 4, 8)), 1]
        self.layers = nn.ModuleList(
            _layer(
                *channels[k : k + 2],
                stride=2 if k < config.strided else 1,
                norm=0 < k < LAYERS - 1,
                activation=k < LAYERS - 1,
            )
            for k in range(LAYERS)
        )
        initialise(self)

    def forward(self, maps: Tensor) -> list[Tensor]:
        """Every layer's features, the first first; the last are the logits, (B, 1, h, w).

        A logit above 0 calls its patch true.

        Args:
            maps: (B, inputs, H, W), about -1 to 1, `config.least` pixels or more each way.

        Raises:
            ValueError: the shape is another or too small.
        """
        check_maps("maps", maps, self.inputs)
        height, width = maps.shape[-2:]
        if min(height, width) < self.config.least:
            least = self.config.least
            raise ValueError(f"maps: {height} x {width} pixels; give {least} x {least} or more")
        features = []
        for layer in self.layers:
            maps = layer(maps)
            features.append(maps)
        return features


def _layer(
    inputs: int, outputs: int, *, stride: int, norm: bool, activation: bool
) -> nn.Sequential:
    """A convolution with what follows it. A bias before a norm would do nothing."""
    layers = [nn.Conv2d(inputs, outputs, 4, stride, padding=1, bias=not norm)]
    if norm:
        layers.append(nn.InstanceNorm2d(outputs))
    if activation:
        layers.append(nn.LeakyReLU(SLOPE, inplace=True))
    return nn.Sequential(*layers)
