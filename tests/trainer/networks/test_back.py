"""The back's generator."""

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from trainer.networks.back import WINDOWS, BackNet, BackNetConfig


def coarse(height, width, channels=1, batch=1):
    torch.manual_seed(6)
    return torch.rand(batch, channels, height, width) * 2 - 1


def whole(maps):
    return torch.ones_like(maps, dtype=torch.bool)


@pytest.mark.parametrize("detail", [True, False])
@pytest.mark.parametrize("channels", [1, 4])
@pytest.mark.parametrize("size", [(1, 1), (40, 1), (16, 16), (53, 37), (256, 256), (424, 512)])
def test_untrained_it_returns_its_depth_at_any_size(size, channels, detail):
    maps, given = coarse(*size, channels), coarse(*size) / 2
    with torch.no_grad():
        depth, logit = BackNet(BackNetConfig(8, detail), channels)(maps, given, whole(given))
    assert depth.shape == logit.shape == (1, 1, *size)
    assert torch.equal(depth, given)
    assert not logit.any()


def test_eight_layers_end_where_the_docstring_says():
    with torch.no_grad():
        features = BackNet(BackNetConfig(8, detail=False), 1).encoder(coarse(424, 512))
    sizes = [tuple(each.shape[2:]) for each in features]
    assert sizes[:4] == [(212, 256), (106, 128), (53, 64), (27, 32)]
    assert sizes[4:] == [(14, 16), (7, 8), (4, 4), (2, 2)]
    assert [each.shape[1] // 8 for each in features] == [1, 2, 4, 8, 8, 8, 8, 8]


@pytest.mark.parametrize("size", [(37, 53), (260, 100)])
def test_gradients_reach_every_parameter(size):
    torch.manual_seed(0)
    network = BackNet(BackNetConfig(8), 1)
    optimizer = torch.optim.SGD(network.parameters(), lr=0.1)
    maps, wanted = coarse(*size, batch=2), torch.rand(2, 1, *size)
    for _ in range(2):  # the last convolution is zero before the first step and lets nothing pass
        optimizer.zero_grad()
        depth, logit = network(maps, maps, whole(maps))
        ((depth - wanted).square().mean() + (logit - wanted).square().mean()).backward()
        optimizer.step()
    still = [name for name, weight in network.named_parameters() if not weight.grad.any()]
    assert not still


def test_depth_and_silhouette_are_learned_apart():
    torch.manual_seed(0)
    network = BackNet(BackNetConfig(8, detail=False), 1)
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    maps = coarse(32, 32, batch=2)
    inside = (maps > 0).float()
    for _ in range(60):
        depth, logit = network(maps, maps, whole(maps))
        loss = 10 * (depth - maps - 0.03 * maps.abs()).abs().mean()
        loss = loss + torch.nn.functional.binary_cross_entropy_with_logits(logit, inside)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    with torch.no_grad():
        depth, logit = network(maps, maps, whole(maps))
    assert (depth - maps - 0.03 * maps.abs()).abs().mean() < 0.5 * 0.03 * maps.abs().mean()
    assert ((logit > 0) == (maps > 0)).float().mean() > 0.9


@pytest.mark.parametrize("width", [64, 32, 16])
def test_the_docstring_counts_the_parameters(width):
    with torch.device("meta"):
        network = BackNet(BackNetConfig(width), 2)
    assert f"{sum(weight.numel() for weight in network.parameters()):,}" in BackNet.__doc__


def test_maps_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"^maps: shape .*; give \(B, 4, H, W\)\Z"):
        BackNet(BackNetConfig(8), 4)(coarse(16, 16), coarse(16, 16), whole(coarse(16, 16)))
    with pytest.raises(ValueError, match=r"^depth: shape .*; give \(B, 1, H, W\)\Z"):
        BackNet(BackNetConfig(8), 4)(coarse(16, 16, 4), coarse(16, 16, 4), whole(coarse(16, 16)))


def test_what_is_corrected_is_not_seen_without_detail():
    network = BackNet(BackNetConfig(8, detail=False), 1)
    for weight in network.parameters():
        torch.nn.init.normal_(weight, std=0.1)
    maps, given = coarse(32, 32), coarse(32, 32) / 2
    with torch.no_grad():
        one, other = (network(maps, depth, whole(depth)) for depth in (given, given + 0.25))
    assert not torch.equal(one[0], given)
    torch.testing.assert_close(other[0] - one[0], torch.full_like(given, 0.25))
    assert torch.equal(one[1], other[1])


def test_depth_itself_is_not_seen_but_its_detail_is():
    network = BackNet(BackNetConfig(8), 1)
    for weight in network.parameters():
        torch.nn.init.normal_(weight, std=0.1)
    maps = coarse(32, 32)
    given, mask = torch.full_like(maps, 0.3), whole(maps)
    with torch.no_grad():
        one, moved = network(maps, given, mask), network(maps, given + 0.25, mask)
        rough = network(maps, given + 0.01 * torch.rand_like(given), mask)
    torch.testing.assert_close(moved[0] - one[0], torch.full_like(given, 0.25), atol=1e-4, rtol=0)
    torch.testing.assert_close(moved[1], one[1], atol=1e-4, rtol=0)
    assert (rough[1] - one[1]).abs().max() > 1e-2


@pytest.mark.parametrize("channel", range(len(WINDOWS)))
def test_a_whole_share_of_a_detail_leaves_the_surroundings_mean(channel):
    network = BackNet(BackNetConfig(8), 1)
    with torch.no_grad():
        network.decoder.head.bias[2 + channel] = 1
        given = coarse(40, 40) / 2
        found, logit = network(coarse(40, 40), given, whole(given))
    across = WINDOWS[channel]
    margin = across // 2
    means = torch.nn.functional.avg_pool2d(given, across, 1)
    inner = found[..., margin:-margin, margin:-margin]
    torch.testing.assert_close(inner, means, atol=1e-5, rtol=0)
    assert not logit.any()
    assert BackNet(BackNetConfig(8, detail=False), 1).decoder.head.out_channels == 2


def test_a_small_one_takes_little_work():
    """Operations a frame, of which a core does a billion in 0.02 s."""
    network = BackNet(BackNetConfig(8), 1)
    maps = coarse(416, 256)
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(maps, maps, whole(maps))
    assert 1e9 < counter.get_total_flops() < 1.3e9
