"""One open human from the draw of the body to the files on disk."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

import seeds
from subjects.mesh import MeshError
from subjects.open import body, garments, hair, penetration, poses, surface, texture, wavefront
from subjects.open.atlas import chart
from subjects.open.drape import DrapeError
from subjects.open.dressing import dress
from subjects.open.garments import Solid
from subjects.open.subdivision import refine, triangles
from subjects.open.surface import Piece
from subjects.open.template import BODY, EYES, template

if TYPE_CHECKING:
    from collections.abc import Iterator

ATTEMPTS = 18
"""Draws of one pose, each standing a little more clear of itself, before another is tried."""
CLEARANCE_STEP = 0.3
DRESSED = 0.06
"""What soles and hair may add to a bare body's height, metres."""
MATERIAL = "material0"
DRAPES = 3
"""Draws of pose and outfit, where the cloth of one tears or goes through the body."""
SHAPES = 11
"""Shapes that the body passes through on the way to its pose, while cloth is draped."""


@dataclass(frozen=True, eq=False)
class Posed:
    """A posed bare body and how it came about.

    Attributes:
        vertices: (19158, 3) base mesh in the world frame, before it is set on the ground.
        last: the same with the feet of the tights made into shoes.
    """

    name: str
    pose: poses.Pose
    vertices: np.ndarray
    last: np.ndarray
    depth: float
    where: str
    attempts: int


def make_person(
    subject: str,
    seed: int,
    folder: Path,
    *,
    ages: tuple[float, float],
    names: list[str],
    max_height: float,
    texture_size: int,
    draped: bool,
) -> dict[str, Any]:
    """Write one human's files and return what parameters.json holds.

    Args:
        ages: the youngest and the oldest, years.
        names: of the poses to choose from.
        max_height: that the posed and dressed human may reach, metres.
        texture_size: side of the texture in pixels.
        draped: whether the cloth solver drapes the clothes.

    Raises:
        MeshError: none of the poses suits the body.
    """
    with _one_thread():
        age, phenotype = body.draw_phenotype(seeds.generator(seed, subject, "phenotype"), *ages)
        rest = body.rest_body(phenotype)
        reasons: list[str] = []
        for attempt in range(DRAPES):
            # The first draw has the plain names: draped or laid, it is the same person.
            again = f" {attempt}" if attempt else ""

            def draw(what: str, again: str = again) -> np.random.Generator:
                return seeds.generator(seed, subject, what + again)

            posed = draw_pose(names, max_height - DRESSED, subject, draw("pose"), rest)
            outfit = garments.draw_outfit(draw("outfit"), posed.pose.skirt, phenotype["gender"])
            look = texture.draw_look(draw("look"), phenotype, age, outfit)
            try:
                way = _approach(posed.pose, rest) if draped else ()
                surface_of, ground, drapes = _dressed(
                    posed, [*way, posed.vertices], outfit, look.hair_style, draw("cloth")
                )
            except DrapeError as error:
                reasons.append(str(error))
            else:
                break
        else:
            raise MeshError(f"{subject}: no cloth stayed on in {DRAPES} draws ({reasons[-1]})")
    picture = texture.paint(look, outfit, texture_size, seeds.generator(seed, subject, "texture"))
    bare = posed.vertices - [0.0, ground, 0.0]
    skin = triangles(template().groups[BODY].quads)
    used, skin = np.unique(skin, return_inverse=True)

    wavefront.write_textured(folder / f"{subject}.obj", surface_of, f"{MATERIAL}.mtl", MATERIAL)
    wavefront.write_material(folder / f"{MATERIAL}.mtl", MATERIAL, f"{MATERIAL}.jpeg")
    wavefront.write_mesh(folder / "body.obj", bare[used], skin.reshape(-1, 3))
    Image.fromarray(picture).save(folder / f"{MATERIAL}.jpeg", quality=95, subsampling=0)
    height = rest.vertices[used, 1]
    return {
        "body": {
            "model": "anny",
            "age_years": round(age, 3),
            "height_m": round(float(height.max() - height.min()), 4),
            "phenotype": {key: round(value, 6) for key, value in phenotype.items()},
            "pose": posed.name,
            "pose_parameters": poses.as_json(posed.pose),
            "ground_m": round(float(ground), 6),
        },
        "penetration": {
            "depth_m": round(posed.depth, 5),
            "where": posed.where,
            "allowed_m": penetration.ALLOWED,
            "draws": posed.attempts,
        },
        "outfit": outfit.as_json(),
        "drapes": {"garments": drapes, "failed": reasons},
        "look": look.as_json(),
        "triangles": len(surface_of.faces),
        "seed": seed,
        "versions": {name: metadata.version(name) for name in ("anny", "numpy", "torch", "scipy")},
    }


@contextmanager
def _one_thread() -> Iterator[None]:
    """Sums in one order: the number of threads must not show in the bytes."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def draw_pose(
    names: list[str],
    max_height: float,
    subject: str,
    generator: np.random.Generator,
    rest: body.Rest,
) -> Posed:
    """The first draw whose limbs stay out of each other, and which is low enough.

    Raises:
        MeshError: there is none.
    """
    skin = np.unique(template().groups[BODY].quads)
    last = garments.shoe_last(rest.vertices)
    draws = 0
    for name in generator.permutation(names):
        pose = poses.POSES[str(name)]
        if generator.random() < 0.5:
            pose = poses.mirrored(pose)
        arm_room = leg_room = 0.0
        for _ in range(ATTEMPTS):
            draws += 1
            drawn = poses.varied(pose, generator, arm_room, leg_room)
            transforms = body.bone_transforms(rest, poses.rotations(drawn, rest))
            vertices = body.skin(rest.vertices, transforms)
            if np.ptp(vertices[skin, 1]) > max_height:
                break  # arms that reach too high do so in every variation
            depth, where = penetration.penetration(vertices)
            if depth <= penetration.ALLOWED:
                shod = body.skin(last, transforms)
                return Posed(str(name), drawn, vertices, shod, depth, where, draws)
            if "arm" in where:
                arm_room += CLEARANCE_STEP
            else:
                leg_room += CLEARANCE_STEP
    raise MeshError(
        f"{subject}: no pose of {', '.join(names)} keeps this body's limbs apart and "
        f"below {max_height:.2f} m; allow more in subjects.poses or a larger subjects.max_height"
    )


def _approach(pose: poses.Pose, rest: body.Rest) -> Iterator[np.ndarray]:
    """Base meshes on the way from the reference pose to `pose`, each joint turning evenly."""
    turns = {
        bone: Rotation.from_matrix(matrix).as_rotvec()
        for bone, matrix in poses.rotations(pose, rest).items()
    }
    for k in range(SHAPES - 1):
        share = garments.ramp(np.array(k / (SHAPES - 1)), 0.0, 1.0)
        partial = {bone: Rotation.from_rotvec(share * t).as_matrix() for bone, t in turns.items()}
        yield body.skin(rest.vertices, body.bone_transforms(rest, partial))


def _dressed(
    posed: Posed,
    shapes: list[np.ndarray],
    outfit: garments.Outfit,
    style: str,
    generator: np.random.Generator,
) -> tuple[Piece, float, list[dict[str, Any]]]:
    """The whole surface with its lowest point at y = 0, what was taken off, and the drapes."""
    skin = template().groups[BODY]
    corners = np.concatenate([chart(BODY), skin.uv], axis=2)
    fine = refine(skin.quads, corners, len(template().vertices), 1)
    place = fine.matrix @ template().vertices
    vertices = fine.matrix @ posed.vertices
    faces = triangles(fine.quads)
    normal = surface.normals(vertices, faces)
    bare = Solid(vertices, normal, place)

    clothes, drapes = dress(outfit, np.array(shapes), fine, generator)
    upper = clothes[0] if outfit.tucked else clothes[1]
    shoes = garments.shoes(outfit, posed.last, bare)

    uv = triangles(fine.corners)
    grown = hair.growth(place, _per_vertex(fine.quads, fine.corners[..., 2:], len(place)))
    grown = np.where(place[:, 1] > 0.62, grown, -1.0)
    rough = generator.uniform(-1, 1, len(place))
    mean = surface.averaging(faces, len(place))
    for _ in range(3):
        rough = mean @ rough
    rough /= np.abs(rough).max()
    haired = hair.raised(vertices, normal, grown, style, rough)
    head = place[:, 1] > 0.60
    haired_normal = surface.normals(haired, faces)
    scalp = Solid(haired[grown > 0.004], haired_normal[grown > 0.004], place[grown > 0.004])
    around = Solid(
        np.concatenate([haired[head], upper.vertices]),
        np.concatenate([haired_normal[head], surface.normals(upper.vertices, upper.faces)]),
        np.zeros((int(head.sum()) + len(upper.vertices), 3)),
    )

    hidden = garments.covered(outfit, place, garments.arm_share(fine.matrix))
    shown = ~hidden[faces].all(axis=1)
    pieces = [Piece(haired, faces[shown], uv[shown][..., :2]), *clothes, shoes]
    for eye in EYES:
        ball = template().groups[eye]
        round_ball = refine(ball.quads, chart(eye), len(template().vertices), 1)
        pieces.append(
            Piece(
                round_ball.matrix @ posed.vertices,
                triangles(round_ball.quads),
                triangles(round_ball.corners),
            )
        )
    pieces += hair.extras(style, scalp, around, generator)
    whole = surface.compact(surface.joined(pieces))
    ground = float(whole.vertices[:, 1].min())
    return Piece(whole.vertices - [0.0, ground, 0.0], whole.faces, whole.uv), ground, drapes


def _per_vertex(quads: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Corner values (F, 4, D) as one value per vertex, (count, D); a seam keeps one side's."""
    result = np.zeros((count, values.shape[2]))
    result[quads.ravel()] = values.reshape(-1, values.shape[2])
    return result
