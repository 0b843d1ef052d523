"""The estimated body errs as published, and stays where the exact one is."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import seeds
from subjects.open.base.template import BODY, template
from subjects.open.bodies import body, skeleton
from subjects.open.bodies.estimate import ESTIMATORS, estimated, similarity
from subjects.open.bodies.poses import POSES
from subjects.open.bodies.skeleton import Pose

DRAWS = 34


@pytest.fixture(scope="module")
def rests() -> list[body.Rest]:
    drawn = (
        body.draw_phenotype(seeds.generator(9, f"body {k}", "phenotype"), 18, 75) for k in range(4)
    )
    return [body.rest_body(phenotype) for _, phenotype in drawn]


def generator(key: str) -> np.random.Generator:
    return seeds.generator(9, key, "estimate")


def exact(pose: Pose, rest: body.Rest) -> np.ndarray:
    turns = skeleton.rotations(pose, rest)
    return body.skin(rest.vertices, body.bone_transforms(rest, turns))


def joints_of(vertices: np.ndarray) -> np.ndarray:
    """14 joints told by the skin alone: middles of the vertices around the template's joints."""
    skin = np.unique(template().groups[BODY].quads)
    place = template().vertices[skin]
    names = [
        f"{side}-{joint}"
        for joint in ("ankle", "knee", "upper-leg", "hand", "elbow", "shoulder")
        for side in "lr"
    ]
    points = [template().joints[name] for name in [*names, "neck", "head"]]
    near = [np.argsort(np.linalg.norm(place - point, axis=1))[:60] for point in points]
    return np.array([vertices[skin[index]].mean(axis=0) for index in near])


def aligned_error_mm(guess: np.ndarray, truth: np.ndarray) -> float:
    """Mean joint error after Procrustes alignment, by another way than the source's."""
    a, b = guess - guess.mean(axis=0), truth - truth.mean(axis=0)
    turned = Rotation.align_vectors(b, a)[0].apply(a)
    scaled = turned * (turned * b).sum() / (turned**2).sum()
    return 1000.0 * float(np.linalg.norm(scaled - b, axis=1).mean())


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_the_mean_error_is_the_published_one(rests: list[body.Rest], name: Any) -> None:
    told, shown = [], []
    for k in range(DRAWS):
        pose, rest = list(POSES.values())[2 * k], rests[k % 4]
        vertices, record = estimated(pose, rest, name, generator(f"mean {k}"))
        told.append(record["pa_mpjpe_mm"])
        shown.append(aligned_error_mm(joints_of(vertices), joints_of(exact(pose, rest))))
    assert np.mean(told) == pytest.approx(ESTIMATORS[name].error_mm, rel=0.1)
    # What the skin shows is what the record tells.
    assert np.corrcoef(told, shown)[0, 1] > 0.9
    assert np.mean(shown) == pytest.approx(ESTIMATORS[name].error_mm, rel=0.2)


def test_exact_is_exact(rests: list[body.Rest]) -> None:
    vertices, record = estimated(POSES["walk"], rests[0], "exact", generator("exact"))
    assert np.array_equal(vertices, exact(POSES["walk"], rests[0]))
    assert record == {"model": "exact"}


def test_the_same_generator_estimates_the_same_bytes(rests: list[body.Rest]) -> None:
    def digest(key: str) -> str:
        vertices, record = estimated(POSES["walk"], rests[1], "pixie", generator(key))
        told = json.dumps(record, sort_keys=True).encode()
        return hashlib.sha256(vertices.tobytes() + told).hexdigest()

    assert digest("a") == digest("a") != digest("b")


def test_the_body_stays_placed_and_limbs_err_most(rests: list[body.Rest]) -> None:
    errors = []
    for k, name in enumerate(("stand", "walk", "sit", "arms_open", "bow", "kick", "twist", "wave")):
        rest = rests[k % 4]
        vertices, record = estimated(POSES[name], rest, "pixie", generator(f"place {k}"))
        truth, guess = joints_of(exact(POSES[name], rest)), joints_of(vertices)
        assert np.linalg.norm(truth.mean(axis=0) - guess.mean(axis=0)) < 0.03
        assert np.isfinite(vertices).all()
        assert record["vertex_error_mm"] < 250.0
        errors.append(np.linalg.norm(truth - guess, axis=1))
    mean = np.mean(errors, axis=0)
    ankles, hips, wrists, shoulders = mean[0:2], mean[4:6], mean[6:8], mean[10:12]
    assert ankles.mean() > 1.3 * hips.mean()
    assert wrists.mean() > 1.3 * shoulders.mean()


def test_a_similarity_is_found_again() -> None:
    random = np.random.default_rng(2)
    points = random.normal(size=(14, 3))
    turn = Rotation.from_rotvec([0.4, -1.2, 0.3]).as_matrix()
    scale, found, shift = similarity(points, 1.7 * points @ turn.T + [1.0, 2.0, -3.0])
    assert scale == pytest.approx(1.7)
    assert np.allclose(found, turn)
    assert np.allclose(shift, [1.0, 2.0, -3.0])
    # A mirrored target is not reached by a reflection.
    _, found, _ = similarity(points, points * [-1.0, 1.0, 1.0])
    assert np.linalg.det(found) == pytest.approx(1.0)
