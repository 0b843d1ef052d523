"""VGG19's features of normal maps, for Eq. 9.

The network is configuration E of Simonyan and Zisserman, Very Deep Convolutional Networks for
Large-Scale Image Recognition (2014), with the layers numbered as torchvision numbers them, so that
its file of weights fits; torchvision itself is not needed.
"""

from __future__ import annotations

from os import PathLike

import torch
from torch import Tensor, nn

WIDTHS = ((64, 64), (128, 128), (256,) * 4, (512,) * 4, (512,))
"""Channels of each block's convolutions up to relu5_1; a pooling stands between two blocks."""
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's, of the images that torchvision's weights were trained on."""

_REMEDY = "give the path of torchvision's vgg19 weights, e.g. vgg19-dcbb9e9d.pth, or null for none"


class VGG19(nn.Module):
    """relu1_1, relu2_1, relu3_1, relu4_1 and relu5_1 of a normal map; frozen."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        self.taken: list[int] = []  # each block's first ReLU
        channels = 3
        for widths in WIDTHS:
            if layers:
                layers.append(nn.MaxPool2d(2))
            self.taken.append(len(layers) + 1)
            for width in widths:
                layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU(inplace=True)]
                channels = width
        self.features = nn.Sequential(*layers)
        self.register_buffer("mean", torch.tensor(MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(3, 1, 1), persistent=False)
        self.requires_grad_(False).eval()

    def forward(self, normal: Tensor) -> list[Tensor]:
        """Five maps of 64, 128, 256, 512 and 512 channels, each half as wide and high as the last.

        Args:
            normal: (B, 3, H, W) of values in [-1, 1], H and W at least 16. They become colours in
                [0, 1], the background grey, and those are standardised as ImageNet's.
        """
        values = ((normal + 1) / 2 - self.mean) / self.std
        found = []
        for index, layer in enumerate(self.features):
            values = layer(values)
            if index in self.taken:
                found.append(values)
        return found


def load(path: str | PathLike[str]) -> VGG19:
    """VGG19 with the weights of a file such as torchvision's, on the CPU.

    Args:
        path: a state dict with `features.0.weight` and so on; other keys, such as the classifier's,
            are left alone. No pickle is loaded unrestricted.

    Raises:
        ValueError: there is no such file, or it holds something else.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise ValueError(f"vgg: {path} does not exist; {_REMEDY}") from None
    except Exception as error:  # torch raises anything of a file that is not its own
        raise ValueError(f"vgg: {path} is no file of weights; {_REMEDY}") from error
    if not isinstance(state, dict):
        raise ValueError(f"vgg: {path} holds no state dict; {_REMEDY}")
    network = VGG19()
    own = network.state_dict()
    for key, value in own.items():
        given = state.get(key)
        if not isinstance(given, Tensor):
            raise ValueError(f"vgg: {path} has no {key}; {_REMEDY}")
        if given.shape != value.shape:
            raise ValueError(
                f"vgg: {path} has {key} of shape {tuple(given.shape)} instead of "
                f"{tuple(value.shape)}; {_REMEDY}"
            )
    network.load_state_dict({key: state[key] for key in own})
    return network
