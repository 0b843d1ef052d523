"""The front's network."""

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from trainer.networks.front import FrontNet, FrontNetConfig


def images(height, width, batch=1):
    torch.manual_seed(5)
    rgb, depth = (torch.rand(batch, channels, height, width) * 2 - 1 for channels in (3, 1))
    return rgb, depth, torch.ones_like(depth, dtype=torch.bool)


@pytest.mark.parametrize(("attention", "detail"), [(True, True), (False, True), (True, False)])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (16, 16), (53, 37), (424, 512)])
def test_untrained_it_returns_its_depth_at_any_size(size, attention, detail):
    rgb, depth, mask = images(*size)
    with torch.no_grad():
        result = FrontNet(FrontNetConfig(8, attention, detail))(rgb, depth, mask, mask)
    assert result.shape == depth.shape
    assert torch.equal(result, depth)


@pytest.mark.parametrize(("attention", "detail"), [(True, True), (False, True), (True, False)])
def test_gradients_reach_every_parameter(attention, detail):
    torch.manual_seed(0)
    network = FrontNet(FrontNetConfig(8, attention, detail))
    optimizer = torch.optim.SGD(network.parameters(), lr=0.1)
    rgb, depth, mask = images(37, 53, batch=2)
    for _ in range(2):  # the last convolution is zero before the first step and lets nothing pass
        optimizer.zero_grad()
        (network(rgb, depth, mask, mask) - rgb[:, :1]).square().mean().backward()
        optimizer.step()
    still = [name for name, weight in network.named_parameters() if not weight.grad.any()]
    assert not still


def test_a_few_steps_learn_to_shift_depth_where_colour_says_so():
    torch.manual_seed(0)
    network = FrontNet(FrontNetConfig(8))
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    rgb, depth, mask = images(32, 32, batch=2)
    depth = torch.full_like(depth, 0.2)
    wanted = depth + 0.03 * (rgb[:, :1] > 0)
    losses = []
    for _ in range(90):
        loss = (network(rgb, depth, mask, mask) - wanted).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.3 * losses[0]


def test_an_output_of_one_takes_a_window_s_whole_difference_away():
    """The depth becomes the mean of the window's pixels; without detail there is one output."""
    rgb, depth, mask = images(9, 9)
    for window, mean in ((0, depth[..., 3:6, 3:6].mean()), (2, depth.mean())):
        network = FrontNet(FrontNetConfig(8))
        network.decoder.head.bias.data[1 + window] = 1
        with torch.no_grad():
            found = network(rgb, depth, mask, mask)[0, 0, 4, 4]
        torch.testing.assert_close(found, mean)
    assert FrontNet(FrontNetConfig(8, detail=False)).decoder.head.out_channels == 1


def test_a_correction_is_local_or_global_as_attention_says():
    """Five hundred pixels away a U-Net of 16 x 16 cells sees nothing but the norms' statistics."""
    for attention in (True, False):
        torch.manual_seed(0)
        network = FrontNet(FrontNetConfig(8, attention)).eval()
        torch.nn.init.normal_(network.decoder.head.weight)
        _without_norms(network)
        rgb, depth, mask = images(16, 528)
        with torch.no_grad():
            before = network(rgb, depth, mask, mask)[..., 520:]
            rgb[..., :8] += 1
            change = (network(rgb, depth, mask, mask)[..., 520:] - before).abs().max()
        assert bool(change > 0) is attention


def _without_norms(network):
    for module in network.modules():
        for name, child in module.named_children():
            if isinstance(child, torch.nn.GroupNorm):
                setattr(module, name, torch.nn.Identity())


@pytest.mark.parametrize(("width", "attention"), [(32, True), (16, True), (32, False), (16, False)])
def test_the_docstring_counts_the_parameters(width, attention):
    network = FrontNet(FrontNetConfig(width, attention))
    assert f"{sum(weight.numel() for weight in network.parameters()):,}" in FrontNet.__doc__


def test_images_of_another_shape_are_refused():
    network = FrontNet(FrontNetConfig(8))
    rgb, depth, mask = images(16, 16)
    with pytest.raises(ValueError, match=r"^rgb: shape"):
        network(depth, depth, mask, mask)
    with pytest.raises(ValueError, match=r"^depth: shape"):
        network(rgb, depth[0], mask, mask)
    with pytest.raises(ValueError, match=r"^valid: shape"):
        network(rgb, depth, mask[:, 0], mask)
    with pytest.raises(ValueError, match=r"^mask: shape"):
        network(rgb, depth, mask, mask[:, 0])


def test_a_small_one_takes_little_work():
    """1.1 billion operations a frame, about 0.02 s of one core: more, and a layer became dearer."""
    network = FrontNet(FrontNetConfig(8))
    rgb, depth, mask = images(416, 256)
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(rgb, depth, mask, mask)
    assert 1e9 < counter.get_total_flops() < 1.3e9
