"""One open human from the draw of the body to the files on disk."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

import seeds
from subjects.mesh import MeshError
from subjects.open import texture
from subjects.open.base import wavefront
from subjects.open.base.template import bare_body
from subjects.open.bodies import body, penetration, skeleton
from subjects.open.bodies.estimate import EstimatorName, estimated
from subjects.open.bodies.face import draw_face
from subjects.open.bodies.posed import Posed, approach, draw_pose
from subjects.open.bodies.poses import POSES
from subjects.open.clothes.drape import DrapeError
from subjects.open.clothes.outfit import Outfit, draw_outfit
from subjects.open.figure import Figure, figure
from subjects.wavefront import write_mesh

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DRESSED = 0.06
"""What soles and hair may add to a bare body's height, metres."""
MATERIAL = "material0"
PACKAGES = ("anny", "bpy", "numpy", "pillow", "scipy", "torch")
"""What a human's bytes depend on."""
ESTIMATED = "estimated.obj"
DRAPES = 5
"""Draws of an outfit, where the cloth of one tears or goes through the body."""
SHAPES = 10
"""Shapes that the body passes through on the way to its pose, while cloth is draped."""


@dataclass(frozen=True)
class Wish:
    """What may be chosen of an open human.

    Attributes:
        ages: the youngest and the oldest, years.
        poses: names of the poses to choose from.
        hard_share: of the poses whose front and back differ most.
        max_height: that the posed and dressed human may reach, metres.
        draped: whether the cloth solver drapes the clothes.
        texture_size: side of the texture in pixels.
        estimator: whose error the body that is written beside the exact one has.
    """

    ages: tuple[float, float]
    poses: tuple[str, ...]
    hard_share: float
    max_height: float
    draped: bool
    texture_size: int
    estimator: EstimatorName


def make_person(subject: str, seed: int, folder: Path, wish: Wish) -> dict[str, Any]:
    """Write one human's files and return what parameters.json holds.

    Raises:
        MeshError: none of the poses suits the body, or no cloth stays on it.
    """
    with _one_thread():
        age, phenotype = body.draw_phenotype(
            seeds.generator(seed, subject, "phenotype"), *wish.ages
        )
        rest = body.rest_body(phenotype, draw_face(seeds.generator(seed, subject, "face")))
        posed, outfit, look, whole, failed = _dressed(subject, seed, wish, rest, age, folder)
        estimate, guessed = estimated(
            posed.pose, rest, wish.estimator, seeds.generator(seed, subject, "estimate")
        )
    picture = texture.paint(
        look, outfit, wish.texture_size, seeds.generator(seed, subject, "texture")
    )
    used, skin = bare_body()
    down = np.array([0.0, whole.ground, 0.0])

    wavefront.write_textured(folder / f"{subject}.obj", whole.surface, f"{MATERIAL}.mtl", MATERIAL)
    wavefront.write_material(folder / f"{MATERIAL}.mtl", MATERIAL, f"{MATERIAL}.jpeg")
    write_mesh(folder / "body.obj", posed.vertices[used] - down, skin)
    if wish.estimator != "exact":
        write_mesh(folder / ESTIMATED, estimate[used] - down, skin)
    Image.fromarray(picture).save(folder / f"{MATERIAL}.jpeg", quality=95, subsampling=0)
    height = rest.vertices[used, 1]
    return {
        "body": {
            "model": "anny",
            "age_years": round(age, 3),
            "height_m": round(float(height.max() - height.min()), 4),
            "phenotype": {key: round(value, 6) for key, value in phenotype.items()},
            "face": rest.face,
            "pose": posed.name,
            "hard": POSES[posed.name].hard,
            "pose_parameters": skeleton.as_json(posed.pose),
            "ground_m": round(whole.ground, 6),
            "estimate": guessed,
        },
        "penetration": {
            "depth_m": round(posed.depth, 5),
            "where": posed.where,
            "allowed_m": penetration.ALLOWED,
            "draws": posed.attempts,
        },
        "outfit": outfit.as_json(),
        "drapes": {
            "cloth": "draped" if wish.draped else "laid",
            "garments": whole.garments,
            "failed": failed,
        },
        "look": look.as_json(),
        "triangles": len(whole.surface.faces),
        "seed": seed,
        "versions": {name: metadata.version(name) for name in PACKAGES},
    }


def _dressed(
    subject: str, seed: int, wish: Wish, rest: body.Rest, age: float, scratch: Path
) -> tuple[Posed, Outfit, texture.Look, Figure, list[str]]:
    """Pose and clothes that go together, and why earlier draws of them did not.

    A second outfit is tried on the first pose; after that each draw has another pose.

    Raises:
        MeshError: see `make_person`.
    """
    failed: list[str] = []
    poses = list(wish.poses)
    for attempt in range(DRAPES):
        # The first draw has the plain names: draped or laid, it is the same person.
        outfit_draw = _drawing(seed, subject, attempt)
        pose_draw = _drawing(seed, subject, max(attempt - 1, 0))
        posed = draw_pose(
            poses,
            wish.hard_share,
            wish.max_height - DRESSED,
            subject,
            pose_draw("pose"),
            rest,
        )
        gender = rest.phenotype["gender"]
        outfit = draw_outfit(outfit_draw("outfit"), posed.pose.skirt, gender)
        look = texture.draw_look(outfit_draw("look"), rest.phenotype, age, outfit)
        way = approach(posed.pose, rest, SHAPES) if wish.draped else ()
        shapes = np.stack([*way, posed.vertices])
        try:
            whole = figure(posed, shapes, outfit, look, outfit_draw("cloth"), scratch)
        except DrapeError as error:
            failed.append(f"{posed.name}: {error}")
            if attempt > 0 and len(poses) > 1:
                poses = [name for name in poses if name != posed.name]
        else:
            return posed, outfit, look, whole, failed
    raise MeshError(
        f"{subject}: no cloth stayed on in {DRAPES} draws ({'; '.join(failed)}); "
        "give other or more poses in subjects.poses, or --subjects.cloth laid"
    )


def _drawing(seed: int, subject: str, attempt: int) -> Callable[[str], np.random.Generator]:
    again = f" {attempt}" if attempt else ""
    return lambda what: seeds.generator(seed, subject, what + again)


@contextmanager
def _one_thread() -> Iterator[None]:
    """torch's sums in one order: the number of threads must not show in the bytes."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
