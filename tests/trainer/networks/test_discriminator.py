"""The patch discriminator."""

import pytest
import torch
from torch import nn

from trainer.networks.discriminator import LAYERS, Discriminator, DiscriminatorConfig


def normals(height, width, channels=3, batch=1):
    torch.manual_seed(7)
    return torch.rand(batch, channels, height, width) * 2 - 1


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(32, 32), (53, 37), (424, 512)])
def test_all_layers_are_returned_and_the_logits_last(size, channels):
    with torch.no_grad():
        features = Discriminator(DiscriminatorConfig(8), channels)(normals(*size, channels))
    assert [each.shape[1] for each in features] == [8, 16, 32, 64, 1]
    grids = [(size[0] // 2**k, size[1] // 2**k) for k in (1, 2, 3, 4)]
    grids.append((grids[3][0] - 1, grids[3][1] - 1))
    assert [tuple(each.shape[2:]) for each in features] == grids


def test_features_are_each_layer_s_and_no_later_layer_changes_them():
    torch.manual_seed(0)
    network = Discriminator(DiscriminatorConfig(8), 3)
    maps = normals(160, 176)
    with torch.no_grad():
        features = network(maps)
        for layer, feature in zip(network.layers, features, strict=True):
            maps = layer(maps)
            torch.testing.assert_close(feature, maps)
    assert features[-1].min() < 0 < features[-1].max()  # logits, not their activation


@pytest.mark.parametrize(("strided", "across"), [(4, 94), (3, 70), (2, 46)])
def test_a_logit_judges_a_patch(strided, across):
    """Which pixels move the middle logit, with the norms' statistics left out."""
    torch.manual_seed(0)
    config = DiscriminatorConfig(8, strided=strided)
    network = Discriminator(config, 3)
    for layer in network.layers:
        for index, module in enumerate(layer):
            if isinstance(module, nn.InstanceNorm2d):
                layer[index] = nn.Identity()
    maps = normals(200, 240).requires_grad_()
    logits = network(maps)[-1]
    row, column = logits.shape[2] // 2, logits.shape[3] // 2
    logits[0, 0, row, column].backward()
    seen = maps.grad[0].abs().sum(0).nonzero()
    extent = seen.max(0).values - seen.min(0).values + 1
    assert extent.tolist() == [across, across]
    assert config.patch == across


def test_norm_follows_all_layers_but_the_first_and_the_last():
    layers = Discriminator(DiscriminatorConfig(8), 3).layers
    normed = [any(isinstance(module, nn.InstanceNorm2d) for module in layer) for layer in layers]
    assert normed == [False, True, True, True, False]
    slopes = {m.negative_slope for layer in layers for m in layer if isinstance(m, nn.LeakyReLU)}
    assert slopes == {0.2}


def test_a_sample_does_not_see_its_batch():
    network = Discriminator(DiscriminatorConfig(8), 3).train()
    maps = normals(48, 48, batch=3)
    with torch.no_grad():
        torch.testing.assert_close(
            network(maps)[-1][1:2], network(maps[1:2])[-1], rtol=1e-4, atol=1e-4
        )


@pytest.mark.parametrize("strided", [4, 3])
def test_gradients_reach_every_parameter(strided):
    network = Discriminator(DiscriminatorConfig(8, strided=strided), 3)
    network(normals(64, 72, batch=2))[-1].square().mean().backward()
    still = [name for name, weight in network.named_parameters() if not weight.grad.any()]
    assert not still


def test_a_few_steps_tell_smooth_from_rough():
    torch.manual_seed(0)
    network = Discriminator(DiscriminatorConfig(8), 3)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    rough = normals(64, 64, batch=2)
    smooth = nn.functional.avg_pool2d(rough, 9, stride=1, padding=4) * 9
    for _ in range(20):
        true, made = network(rough)[-1], network(smooth)[-1]
        loss = nn.functional.softplus(-true).mean() + nn.functional.softplus(made).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert (true > 0).all()
    assert (made < 0).all()


@pytest.mark.parametrize(("width", "inputs"), [(64, 3), (64, 1), (16, 3)])
def test_the_docstring_counts_the_parameters(width, inputs):
    network = Discriminator(DiscriminatorConfig(width), inputs)
    assert f"{sum(weight.numel() for weight in network.parameters()):,}" in Discriminator.__doc__


@pytest.mark.parametrize("strided", range(1, LAYERS))
def test_the_least_size_has_one_logit_and_less_is_refused(strided):
    config = DiscriminatorConfig(8, strided=strided)
    network = Discriminator(config, 3).train()
    assert network(normals(config.least, config.least))[-1].shape == (1, 1, 1, 1)
    for size in [(config.least - 1, 64), (64, config.least - 1), (1, 1)]:
        with pytest.raises(ValueError, match=rf"give {config.least} x {config.least} or more\Z"):
            network(normals(*size))


@pytest.mark.parametrize("option", [{"strided": 0}, {"strided": LAYERS}])
def test_options_out_of_bounds_are_refused(option):
    ((key, value),) = option.items()
    with pytest.raises(ValueError, match=rf"^discriminator\.{key}: {value}; give .*\Z"):
        DiscriminatorConfig(**option)
