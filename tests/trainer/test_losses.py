"""Eq. 7 to 15 against values worked by hand."""

from math import e, log

import pytest
import torch

from seeds import generator
from trainer import losses
from trainer.losses import BackWeights, FrontWeights, Surface

NAN = float("nan")


def drawn(shape: tuple[int, ...], purpose: str) -> torch.Tensor:
    return torch.from_numpy(generator(0, "", purpose).standard_normal(shape))


def block() -> torch.Tensor:
    """(1, 1, 8, 8): a mask of 4 x 4 in the corner of a frame."""
    mask = torch.zeros(1, 1, 8, 8, dtype=torch.bool)
    mask[..., :4, :4] = True
    return mask


def five(normal: torch.Tensor) -> list[torch.Tensor]:
    """Five maps of a normal map, k times the red of every 2^k-th pixel."""
    return [k * normal[:, :1, :: 2**k, :: 2**k] for k in range(5)]


def batch(mask: torch.Tensor) -> dict:
    """What the generator's total takes, with a gradient for all that is predicted."""
    two, rows, columns = len(mask), *mask.shape[-2:]
    maps = {
        "predicted": Surface(
            drawn((two, 1, rows, columns), "d"), drawn((two, 3, rows, columns), "n")
        ),
        "true": Surface(drawn((two, 1, rows, columns), "D"), drawn((two, 3, rows, columns), "N")),
        "silhouette": torch.sigmoid(drawn((two, 1, rows, columns), "s")),
        "fake": [drawn((two, 2, 4, 4), f"f{k}") for k in range(4)] + [drawn((two, 1, 3, 3), "f")],
        "real": [drawn((two, 2, 4, 4), f"r{k}") for k in range(4)] + [drawn((two, 1, 3, 3), "r")],
        "mask": mask,
    }
    for values in (maps["predicted"].depth, maps["predicted"].normal, maps["silhouette"]):
        values.requires_grad_()
    for values in maps["fake"]:
        values.requires_grad_()
    return maps


@pytest.mark.parametrize(("loss", "unit"), [(losses.mean_l1, 1), (losses.depth_loss, 1000)])
def test_the_mean_is_over_the_masks_pixels_and_of_depth_in_millimetres(loss, unit):
    a = torch.tensor([[1.0, 2.0], [3.0, 100.0]])[None, None]
    b = torch.tensor([[1.5, 0.0], [3.5, 0.0]])[None, None]
    mask = torch.tensor([[True, True], [True, False]])[None, None]
    assert loss(a, b, mask).item() == pytest.approx(unit * (0.5 + 2 + 0.5) / 3)


def test_depths_mean_is_over_all_pixels_of_a_batch_alike():
    mask = torch.zeros(2, 1, 2, 2, dtype=torch.bool)
    mask[0] = True
    mask[1, 0, 0, 0] = True
    error = torch.tensor([1.0, 6.0]).view(2, 1, 1, 1).expand(2, 1, 2, 2)
    assert losses.mean_l1(error, torch.zeros_like(error), mask).item() == 2  # (4 + 6) / 5


def test_a_normals_three_parts_share_the_mean():
    ours = torch.tensor([0.6, 0.0, 0.8]).view(1, 3, 1, 1).expand(1, 3, 8, 8)
    true = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(1, 3, 8, 8)
    assert losses.normal_loss(ours, true, block()).item() == pytest.approx(0.8 / 3)


def test_what_lies_outside_the_mask_has_no_part_and_no_gradient():
    mask = block()
    a, b = drawn((1, 3, 8, 8), "a"), drawn((1, 3, 8, 8), "b")
    plain = losses.mean_l1(a, b, mask)
    a = torch.where(mask, a, NAN).requires_grad_()
    found = losses.mean_l1(a, torch.where(mask, b, torch.inf), mask)
    assert found == plain
    found.backward()
    expected = torch.where(mask, torch.sign(a.detach() - b) / 48, 0)
    torch.testing.assert_close(a.grad, expected)


def test_a_wider_frame_changes_no_loss():
    def found(margin: int) -> torch.Tensor:
        def grown(values: torch.Tensor) -> torch.Tensor:
            return torch.nn.functional.pad(values, (0, margin, 0, margin))

        mask = grown(block())
        ours, true, soft, logits, others = (
            grown(drawn((1, channels, 8, 8), f"{k}") * block())
            for k, channels in enumerate((3, 3, 1, 1, 1))
        )
        return torch.stack(
            [
                losses.depth_loss(logits, others, mask),
                losses.normal_loss(ours, true, mask),
                losses.vgg_loss(ours, true, mask, five),
                losses.silhouette_loss(soft, mask),
                losses.matching_loss(five(ours), five(true), mask),
                losses.gan_loss(logits, others, mask),
                losses.generator_gan_loss(others, mask),
            ]
        )

    assert (found(0) != 0).all()
    torch.testing.assert_close(found(8), found(0))


def test_each_layer_of_vgg_has_its_weight():
    ours, true = torch.full((1, 3, 32, 32), 0.5), torch.zeros(1, 3, 32, 32)
    mask = torch.ones(1, 1, 32, 32, dtype=torch.bool)
    # Layer k differs by k / 2.
    by_hand = 0.5 * (1 / 16 + 2 / 8 + 3 / 4 + 4)
    assert losses.vgg_loss(ours, true, mask, five).item() == pytest.approx(by_hand)
    for k, weight in enumerate((1 / 32, 1 / 16, 1 / 8, 1 / 4, 1)):

        def only(normal, k=k):
            return [normal if layer == k else 0 * normal for layer in range(5)]

        assert losses.vgg_loss(ours, true, mask, only).item() == pytest.approx(weight / 2)


def test_a_network_of_other_than_five_layers_is_refused():
    normal, mask = torch.zeros(1, 3, 32, 32), torch.ones(1, 1, 32, 32, dtype=torch.bool)
    with pytest.raises(ValueError, match="zip"):
        losses.vgg_loss(normal, normal, mask, lambda values: five(values)[:4])


def test_a_mask_at_another_scale_holds_every_cell_that_it_touches():
    mask = torch.zeros(1, 1, 8, 12, dtype=torch.bool)
    mask[0, 0, 3, 5] = mask[0, 0, 7, 11] = True
    found = losses.at_scale(mask, torch.zeros(1, 7, 2, 3))
    assert found.tolist() == [[[[False, True, False], [False, False, True]]]]
    assert torch.equal(losses.at_scale(mask, torch.zeros(1, 1, 8, 12)), mask)


def test_features_away_from_the_subject_do_not_count():
    mask = block()
    ours = torch.zeros(1, 1, 2, 2)
    ours[..., 1] = 7.0
    assert losses.mean_l1(ours, torch.zeros_like(ours), losses.at_scale(mask, ours)) == 0


def test_the_gan_loss_is_the_log_of_the_odds_of_being_right():
    mask = torch.ones(1, 1, 8, 8, dtype=torch.bool)
    # D = 3/4 and 1/2 of the real, 1/4 and 1/2 of the fake.
    real = torch.tensor([log(3), 0.0]).view(1, 1, 1, 2)
    by_hand = (log(3 / 4) + log(1 / 2)) / 2
    assert losses.gan_loss(real, -real, mask).item() == pytest.approx(2 * by_hand)
    assert losses.generator_gan_loss(real, mask).item() == pytest.approx(-by_hand)
    loss, terms = losses.discriminator_loss(real, -real, mask)
    assert loss.item() == terms["gan"].item() == pytest.approx(-2 * by_hand)


def test_patches_without_the_subject_are_not_judged():
    logits = torch.tensor([[0.0, 50.0], [50.0, 50.0]])[None, None]
    assert losses.gan_loss(logits, logits, block()).item() == pytest.approx(-2 * log(2))
    assert losses.generator_gan_loss(logits, block()).item() == pytest.approx(log(2))


@pytest.mark.parametrize("logit", [-1e4, -90.0, 90.0, 1e4])
def test_sure_discriminators_give_finite_losses_and_gradients(logit):
    mask = torch.ones(1, 1, 4, 4, dtype=torch.bool)
    real, fake = torch.full((1, 1, 2, 2), -logit), torch.full((1, 1, 2, 2), logit)
    for values in (real, fake):
        values.requires_grad_()
    loss, _ = losses.discriminator_loss(real, fake, mask)
    assert loss.item() == pytest.approx(2 * max(logit, 0))
    (loss + losses.generator_gan_loss(fake, mask)).backward()
    assert torch.isfinite(real.grad).all()
    assert torch.isfinite(fake.grad).all()


def test_a_generator_that_is_found_out_still_learns():
    mask = torch.ones(1, 1, 4, 4, dtype=torch.bool)
    fake = torch.full((1, 1, 2, 2), -30.0, requires_grad=True)
    losses.generator_gan_loss(fake, mask).backward()
    torch.testing.assert_close(fake.grad, torch.full_like(fake, -1 / 4))  # descent raises D(fake)
    fake.grad = None
    losses.gan_loss(torch.zeros(1, 1, 2, 2), fake, mask).backward()
    assert fake.grad.abs().max() < e**-29


def test_both_sides_of_the_gan_loss_pull_their_own_way():
    mask = torch.ones(1, 1, 4, 4, dtype=torch.bool)
    real, fake = (torch.zeros(1, 1, 2, 2, requires_grad=True) for _ in range(2))
    losses.discriminator_loss(real, fake, mask)[0].backward()
    assert (real.grad < 0).all()
    assert (fake.grad > 0).all()


def test_matching_takes_the_layers_between_the_first_and_the_last():
    mask = torch.ones(1, 1, 8, 8, dtype=torch.bool)
    real = [torch.zeros(1, 2, 4, 4, requires_grad=True) for _ in range(5)]
    fake = [
        torch.full((1, 2, 4, 4), difference, requires_grad=True)
        for difference in (100.0, 1.0, -2.0, 4.0, 100.0)
    ]
    loss = losses.matching_loss(fake, real, mask)
    assert loss.item() == 7
    loss.backward()
    assert [layer.grad is not None for layer in fake] == [False, True, True, True, False]
    assert all(layer.grad is None for layer in real)


@pytest.mark.parametrize(("ours", "theirs", "message"), [(2, 2, "2 layers"), (4, 5, "zip")])
def test_layers_that_cannot_be_matched_are_refused(ours, theirs, message):
    layer, mask = torch.zeros(1, 2, 4, 4), torch.ones(1, 1, 8, 8, dtype=torch.bool)
    with pytest.raises(ValueError, match=message):
        losses.matching_loss([layer] * ours, [layer] * theirs, mask)


def test_a_silhouettes_error_counts_everywhere_and_per_pixel_of_the_subject():
    mask = block()
    soft = torch.where(mask, 0.75, 0.1).requires_grad_()
    loss = losses.silhouette_loss(soft, mask)
    assert loss.item() == pytest.approx((16 * 0.25 + 48 * 0.1) / 16)
    loss.backward()
    torch.testing.assert_close(soft.grad, torch.where(mask, -1 / 16, 1 / 16))
    assert losses.silhouette_loss(mask.float(), mask) == 0
    assert losses.silhouette_loss(torch.ones(1, 1, 8, 8), mask) == 3


def test_the_coefficients_are_those_of_the_paper():
    assert FrontWeights() == FrontWeights(depth=1, normal=20, vgg=20)
    assert BackWeights() == BackWeights(depth=10, gan=5, matching=20, silhouette=20, vgg=1)
    assert losses.VGG_WEIGHTS == (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1)


@pytest.mark.parametrize("value", [-1.0, NAN, float("inf")])
@pytest.mark.parametrize(
    ("kind", "name"),
    [(FrontWeights, name) for name in ("depth", "normal", "vgg")]
    + [(BackWeights, name) for name in ("depth", "gan", "matching", "silhouette", "vgg")],
)
def test_a_coefficient_below_zero_or_not_finite_is_refused(kind, name, value):
    with pytest.raises(ValueError, match=rf"^{kind.__name__}\.{name}: {value}; give .* such as \d"):
        kind(**{name: value})
    assert getattr(kind(**{name: 0.0}), name) == 0


def test_the_front_total_is_the_weighted_sum_of_its_terms():
    ones, zeros = torch.ones(1, 3, 32, 32), torch.zeros(1, 3, 32, 32)
    mask = torch.ones(1, 1, 32, 32, dtype=torch.bool)
    ours, true = Surface(0.01 * ones[:, :1], 0.5 * ones), Surface(zeros[:, :1], zeros)
    loss, terms = losses.front_loss(ours, true, mask, FrontWeights(), five)
    layers = 0.5 * (1 / 16 + 2 / 8 + 3 / 4 + 4)
    assert {name: term.item() for name, term in terms.items()} == pytest.approx(
        {"depth": 10, "normal": 0.5, "vgg": layers}
    )
    assert loss.item() == pytest.approx(10 + 20 * 0.5 + 20 * layers)
    loss, terms = losses.front_loss(ours, true, mask, FrontWeights(depth=3, normal=7), None)
    assert set(terms) == {"depth", "normal"}
    assert loss.item() == pytest.approx(3 * 10 + 7 * 0.5)


def test_the_generators_total_is_the_weighted_sum_of_its_terms():
    mask = torch.ones(1, 1, 32, 32, dtype=torch.bool)
    given = batch(mask)
    weights = BackWeights(depth=2, gan=3, matching=5, silhouette=7, vgg=11)
    loss, terms = losses.generator_loss(**given, weights=weights, vgg=five)
    ours, true = given["predicted"], given["true"]
    by_hand = {
        "depth": 1000 * (ours.depth - true.depth).abs().mean(),
        "gan": -torch.log(torch.sigmoid(given["fake"][-1])).mean(),
        "matching": sum(
            (f - r).abs().mean()
            for f, r in zip(given["fake"][1:4], given["real"][1:4], strict=True)
        ),
        "silhouette": (1 - given["silhouette"]).mean(),
        "vgg": sum(
            weight * (f - r).abs().mean()
            for weight, f, r in zip(
                (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1), five(ours.normal), five(true.normal), strict=True
            )
        ),
    }
    assert {name: term.item() for name, term in terms.items()} == pytest.approx(
        {name: term.item() for name, term in by_hand.items()}
    )
    total = (
        2 * by_hand["depth"]
        + 3 * by_hand["gan"]
        + 5 * by_hand["matching"]
        + 7 * by_hand["silhouette"]
        + 11 * by_hand["vgg"]
    )
    torch.testing.assert_close(loss, total)
    assert loss.requires_grad
    assert not any(term.requires_grad for term in terms.values())
    without, terms = losses.generator_loss(**given, weights=weights, vgg=None)
    torch.testing.assert_close(without, total - 11 * by_hand["vgg"])
    assert "vgg" not in terms


def test_the_totals_gradients_are_those_of_finite_differences():
    given = batch(block())
    true, real, mask = given["true"], given["real"], given["mask"]

    def back(depth, normal, silhouette, *fake):
        ours = Surface(depth, normal)
        return losses.generator_loss(ours, true, silhouette, fake, real, mask, BackWeights(), five)[
            0
        ]

    def front(depth, normal):
        return losses.front_loss(Surface(depth, normal), true, mask, FrontWeights(), five)[0]

    def judge(*logits):
        return losses.discriminator_loss(*logits, mask)[0]

    depth, normal = given["predicted"].depth, given["predicted"].normal
    assert torch.autograd.gradcheck(back, (depth, normal, given["silhouette"], *given["fake"]))
    assert torch.autograd.gradcheck(front, (depth, normal))
    assert torch.autograd.gradcheck(judge, (real[-1].requires_grad_(), given["fake"][-1]))


def test_without_a_subject_every_term_is_zero_and_so_is_every_gradient():
    given = batch(torch.zeros(2, 1, 16, 16, dtype=torch.bool))
    back, terms = losses.generator_loss(**given, weights=BackWeights(), vgg=five)
    ours, true, mask = (given[name] for name in ("predicted", "true", "mask"))
    front, more = losses.front_loss(ours, true, mask, FrontWeights(), five)
    judge, last = losses.discriminator_loss(given["real"][-1], given["fake"][-1], mask)
    for found in (*terms.values(), *more.values(), *last.values()):
        assert found.item() == 0
    (back + front + judge).backward()
    for values in (ours.depth, ours.normal, given["silhouette"], *given["fake"][1:]):
        assert not values.grad.any()  # NaN would be true
