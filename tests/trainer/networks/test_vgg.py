"""VGG19 with made weights in the layout of torchvision's file."""

from pathlib import Path

import pytest
import torch
from torch.nn.functional import conv2d, max_pool2d, relu

from seeds import generator
from trainer import losses
from trainer.networks import vgg

BLOCKS = (
    ((0, 3, 64), (2, 64, 64)),
    ((5, 64, 128), (7, 128, 128)),
    ((10, 128, 256), (12, 256, 256), (14, 256, 256), (16, 256, 256)),
    ((19, 256, 512), (21, 512, 512), (23, 512, 512), (25, 512, 512)),
    ((28, 512, 512),),
)
"""torchvision's index, channels in and channels out of the convolutions up to conv5_1."""


@pytest.fixture(scope="module")
def state() -> dict[str, torch.Tensor]:
    rng = generator(0, "", "vgg")

    def normal(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.standard_normal(shape, dtype="f4"))

    made = {}
    for index, below, above in (layer for block in BLOCKS for layer in block):
        made[f"features.{index}.weight"] = normal(above, below, 3, 3) * (2 / (9 * below)) ** 0.5
        made[f"features.{index}.bias"] = 0.1 * normal(above)
    # Of the whole file, but not looked at.
    made["features.30.weight"] = torch.zeros(2, 2)
    made["classifier.0.weight"] = torch.zeros(2, 2)
    return made


@pytest.fixture(scope="module")
def weights(state, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("vgg") / "vgg19.pth"
    torch.save(state, path)
    return path


@pytest.fixture(scope="module")
def network(weights) -> vgg.VGG19:
    return vgg.load(weights)


@pytest.fixture
def normal() -> torch.Tensor:
    values = generator(0, "", "normal").standard_normal((2, 3, 37, 32), dtype="f4")
    return torch.nn.functional.normalize(torch.from_numpy(values), dim=1)


def expected(state: dict[str, torch.Tensor], normal: torch.Tensor) -> list[torch.Tensor]:
    mean = torch.tensor([0.485, 0.456, 0.406])[:, None, None]
    std = torch.tensor([0.229, 0.224, 0.225])[:, None, None]
    values, found = ((normal + 1) * 0.5 - mean) / std, []
    for number, block in enumerate(BLOCKS):
        if number:
            values = max_pool2d(values, kernel_size=2, stride=2)
        for place, (index, _, _) in enumerate(block):
            weight, bias = (state[f"features.{index}.{kind}"] for kind in ("weight", "bias"))
            values = relu(conv2d(values, weight, bias, padding=1))
            if place == 0:
                found.append(values)
    return found


def test_the_five_layers_are_those_of_the_file(network, state, normal):
    found, by_hand = network(normal), expected(state, normal)
    assert [tuple(layer.shape) for layer in found] == [
        (2, 64, 37, 32),
        (2, 128, 18, 16),
        (2, 256, 9, 8),
        (2, 512, 4, 4),
        (2, 512, 2, 2),
    ]
    for ours, theirs in zip(found, by_hand, strict=True):
        torch.testing.assert_close(ours, theirs)
        assert 0.1 < ours.std() < 10  # neither dead nor exploded, so agreement says something


def test_the_network_is_frozen_and_passes_gradients_to_the_normals(network, normal):
    assert not network.training
    assert not any(parameter.requires_grad for parameter in network.parameters())
    mask = torch.ones(2, 1, 37, 32, dtype=torch.bool)
    normal.requires_grad_()
    losses.vgg_loss(normal, torch.zeros_like(normal), mask, network).backward()
    assert torch.isfinite(normal.grad).all()
    assert (normal.grad != 0).any(dim=1).all()


def test_equal_normals_have_no_loss_and_smaller_differences_a_smaller_one(network, normal):
    mask = torch.ones(2, 1, 37, 32, dtype=torch.bool)
    other = normal.flip(0)
    found = [
        losses.vgg_loss(torch.lerp(normal, other, share), normal, mask, network).item()
        for share in (0.0, 0.1, 1.0)
    ]
    assert found[0] == 0 < found[1] < found[2]


def test_a_file_in_torchs_old_format_is_read_too(network, state, normal, tmp_path):
    """As torchvision's is."""
    path = tmp_path / "old.pth"
    torch.save(state, path, _use_new_zipfile_serialization=False)
    for ours, theirs in zip(vgg.load(path)(normal), network(normal), strict=True):
        assert torch.equal(ours, theirs)


def refuse(path: Path, problem: str) -> None:
    with pytest.raises(ValueError, match="vgg") as caught:
        vgg.load(path)
    message = str(caught.value)
    assert message.startswith(f"vgg: {path} {problem}")
    assert "vgg19-dcbb9e9d.pth" in message
    assert "\n" not in message


def test_a_missing_file_is_said(tmp_path):
    refuse(tmp_path / "none.pth", "does not exist")


@pytest.mark.parametrize("content", [b"", b"no weights", b"PK\x03\x04 torn", b"\x80\x02."])
def test_a_file_of_something_else_is_said(tmp_path, content):
    path = tmp_path / "other.pth"
    path.write_bytes(content)
    refuse(path, "is no file of weights")


def test_a_folder_is_said(tmp_path):
    refuse(tmp_path, "is no file of weights")


def test_a_file_cut_short_is_said(weights, tmp_path):
    path = tmp_path / "short.pth"
    path.write_bytes(weights.read_bytes()[:100_000])
    refuse(path, "is no file of weights")


class Trap:
    """Unpickled, it writes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_code_in_a_file_is_never_run(tmp_path):
    sprung, path = tmp_path / "sprung", tmp_path / "trap.pth"
    torch.save({"features.0.weight": Trap(sprung)}, path)
    refuse(path, "is no file of weights")
    assert not sprung.exists()


def test_a_value_that_is_no_state_dict_is_said(tmp_path):
    path = tmp_path / "list.pth"
    torch.save([torch.zeros(1)], path)
    refuse(path, "holds no state dict")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"features.16.weight": None}, "has no features.16.weight"),
        ({"features.28.bias": None}, "has no features.28.bias"),
        ({"features.5.bias": [0.0] * 128}, "has no features.5.bias"),
        (
            {"features.2.weight": torch.zeros(128, 64, 3, 3)},
            "has features.2.weight of shape (128, 64, 3, 3) instead of (64, 64, 3, 3)",
        ),
    ],
)
def test_weights_of_another_network_are_said(state, tmp_path, change, problem):
    path = tmp_path / "other.pth"
    changed = {name: value for name, value in {**state, **change}.items() if value is not None}
    torch.save(changed, path)
    refuse(path, problem)
