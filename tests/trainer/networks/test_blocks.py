"""The building blocks: sizes, norms, weights that a seed decides."""

import pytest
import torch
from torch import nn

from trainer.networks.back import BackNet, BackNetConfig
from trainer.networks.blocks import (
    Decoder,
    Down,
    Encoder,
    Up,
    check_maps,
    convolution,
    even,
    initialise,
)
from trainer.networks.discriminator import Discriminator, DiscriminatorConfig
from trainer.networks.front import FrontNet, FrontNetConfig

NETWORKS = {
    "front": lambda: FrontNet(FrontNetConfig(8)),
    "back": lambda: BackNet(BackNetConfig(8), 1),
    "discriminator": lambda: Discriminator(DiscriminatorConfig(8), 3),
}


def test_an_odd_side_repeats_its_last_row_or_column():
    maps = torch.arange(15.0).reshape(1, 1, 3, 5)
    padded = even(maps)
    assert padded.shape == (1, 1, 4, 6)
    torch.testing.assert_close(padded[..., :3, :5], maps)
    torch.testing.assert_close(padded[..., 3, :5], maps[..., 2, :])
    torch.testing.assert_close(padded[..., :3, 5], maps[..., 4])
    assert even(padded) is padded


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (53, 37), (8, 1)])
def test_down_halves_and_rounds_up_and_up_returns(size):
    maps = torch.rand(2, 8, *size)
    halved = Down(8, 16)(maps)
    assert halved.shape == (2, 16, -(-size[0] // 2), -(-size[1] // 2))
    assert Up(16, 8, 24)(halved, maps).shape == (2, 24, *size)


def test_up_joins_pixels_in_their_places():
    """A pixel of the coarse map reaches its own 2 x 2 cell and the two convolutions' margin."""
    up = Up(8, 8, 8)
    for block in (up.join, up.refine):
        block[1] = nn.Identity()
    coarse, skip = torch.rand(1, 8, 8, 8), torch.rand(1, 8, 15, 16)
    before = up(coarse, skip)
    coarse[0, :, 3, 5] += 1
    rows, columns = (up(coarse, skip) - before)[0].abs().sum(0).nonzero().unbind(1)
    assert (rows.min(), rows.max()) == (6 - 2, 7 + 2)
    assert (columns.min(), columns.max()) == (10 - 2, 11 + 2)


def test_an_encoder_s_results_fit_its_decoder():
    channels = [8, 16, 24]
    maps = torch.rand(1, 5, 21, 10)
    encoder, decoder = Encoder(5, channels), Decoder(40, 5, channels, 3)
    features = encoder(maps)
    assert [tuple(each.shape[1:]) for each in features] == [(8, 11, 5), (16, 6, 3), (24, 3, 2)]
    deepest = torch.rand(1, 40, 3, 2)
    assert decoder(deepest, [maps, *features[:-1]]).shape == (1, 3, 21, 10)


@pytest.mark.parametrize("make", [NETWORKS["front"], NETWORKS["back"]], ids=["front", "back"])
def test_a_sample_does_not_see_its_batch(make):
    """In training too: the norm's statistics are of one sample."""
    torch.manual_seed(0)
    network = make().train()
    nn.init.normal_(network.decoder.head.weight)
    depth = torch.randn(3, 1, 20, 24)
    mask = torch.ones_like(depth, dtype=torch.bool)
    batch = [depth, depth, mask]
    if isinstance(network, FrontNet):
        batch = [torch.randn(3, 3, 20, 24), depth, mask, mask]
    whole = network(*batch)
    alone = network(*(maps[1:2] for maps in batch))
    first = whole if isinstance(whole, torch.Tensor) else whole[0]
    first_alone = alone if isinstance(alone, torch.Tensor) else alone[0]
    assert (first[1] - depth[1]).abs().max() > 0.01
    torch.testing.assert_close(first[1:2], first_alone, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", NETWORKS)
def test_the_seed_decides_the_weights(name):
    states = []
    for seed in (3, 3, 4):
        torch.manual_seed(seed)
        states.append(NETWORKS[name]().state_dict())
    first, again, other = states
    assert first.keys() == again.keys()
    assert all(torch.equal(first[key], again[key]) for key in first)
    assert any(not torch.equal(first[key], other[key]) for key in first)


def test_initial_weights_keep_a_signal_s_variance():
    torch.manual_seed(0)
    layers = nn.Sequential(
        *(nn.Sequential(nn.Linear(256, 256), nn.LeakyReLU(0.2)) for _ in range(8))
    )
    initialise(layers)
    with torch.no_grad():
        power = layers(torch.randn(512, 256)).square().mean()
    assert 0.5 < power < 2


def test_a_norm_of_one_pixel_still_tells_channels_apart():
    torch.manual_seed(0)
    assert convolution(8, 16)(torch.randn(1, 8, 1, 1)).std() > 0.3


@pytest.mark.parametrize("make", [FrontNetConfig, BackNetConfig, DiscriminatorConfig])
@pytest.mark.parametrize("width", [0, -8, 4, 20])
def test_a_width_that_groups_cannot_share_is_refused(make, width):
    with pytest.raises(ValueError, match=rf"^[\w.]+width: {width}; give a multiple of 8.*\Z"):
        make(width)


@pytest.mark.parametrize("shape", [(3, 8, 8), (1, 2, 8, 8), (1, 3, 0, 8)])
def test_maps_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError, match=r"^rgb: shape .*; give \(B, 3, H, W\)\Z"):
        check_maps("rgb", torch.zeros(shape), 3)
