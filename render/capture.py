"""What the cameras saw of one subject: aligned front and back maps of every view."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from render.camera import Camera
from render.cycles import CyclesConfig
from subjects.mesh import Mesh

if TYPE_CHECKING:
    from render.scene import Scene

# Rows and columns of the front camera's grid that hold the surface.
Rectangle = tuple[slice, slice]

# Cycles writes 1e10 where a ray meets nothing.
BACKGROUND_DEPTH = 1e9
# A grazing ray may hit from one side only; more of them than this means a broken surface.
MAX_DROPPED = 2e-4
# Front and back depth of a surface seen edge-on differ by rounding alone (metres).
DEPTH_ROUNDING = 1e-5


class CaptureError(ValueError):
    """A surface whose maps cannot be trusted; the message says why and what to do."""


@dataclass(frozen=True, eq=False)
class Capture:
    """The maps of one subject in V views, all in the front camera's grid and frame.

    Attributes:
        yaw: (V,) radians.
        camera_to_world: (V, 4, 4) float64.
        mask: (V, H, W) bool.
        depth_front, depth_back: (V, H, W) float32 metres from the front camera plane; 0 outside.
        normal_front, normal_back: (V, H, W, 3) float32 unit, camera frame; 0 outside.
        radiance_front, radiance_back: (V, H, W, 3) float32 linear light (Rec. 709 primaries)
            per watt of the lamp; 0 outside.
        body_depth_front, body_depth_back: (V, H, W) float32 metres; 0 outside the body.
        dropped_pixels: (V,) int, pixels that one side alone hit and no map holds.
    """

    camera: Camera
    yaw: np.ndarray
    camera_to_world: np.ndarray
    mask: np.ndarray
    depth_front: np.ndarray
    depth_back: np.ndarray
    normal_front: np.ndarray
    normal_back: np.ndarray
    radiance_front: np.ndarray
    radiance_back: np.ndarray
    body_depth_front: np.ndarray
    body_depth_back: np.ndarray
    dropped_pixels: np.ndarray


@dataclass(frozen=True, eq=False)
class Side:
    """Depth and normals of one view from one side, in a rectangle of the front camera's grid."""

    mask: np.ndarray
    depth: np.ndarray
    normal: np.ndarray


def capture(
    surface: Mesh,
    body: Mesh | None,
    camera: Camera,
    yaw: np.ndarray,
    light_position: tuple[float, float, float],
    cycles: CyclesConfig,
    threads: int,
) -> Capture:
    """Render a subject from the front and the back at every yaw. Needs `bpy`.

    Args:
        surface: the clothed surface in the subject's world, metres.
        body: the parametric body there, or None; its maps are 0 then.
        yaw: (V,) radians.
        light_position: of the point light, metres in the frame of the camera that sees it.
        threads: CPU threads Cycles may use.

    Raises:
        CaptureError: front and back disagree about the silhouette.
    """
    from render.scene import Scene, Surface, reset

    reset()
    views, grid = len(yaw), (camera.rows, camera.columns)
    maps = {
        name: np.zeros((views, *grid, *tail), dtype=np.float32)
        for name, tail in {
            "depth_front": (),
            "depth_back": (),
            "normal_front": (3,),
            "normal_back": (3,),
            "radiance_front": (3,),
            "radiance_back": (3,),
            "body_depth_front": (),
            "body_depth_back": (),
        }.items()
    }
    masks = np.zeros((views, *grid), dtype=bool)
    dropped = np.zeros(views, dtype=np.int64)

    shown = Surface(surface, textured=True)
    truth = Scene("truth", shown, camera, cycles, light_position=None, threads=threads)
    beauty = Scene("beauty", shown, camera, cycles, light_position=light_position, threads=threads)
    bare = None
    if body is not None:
        skin = Surface(body, textured=False)
        bare = Scene("body", skin, camera, cycles, light_position=None, threads=threads)
    with tempfile.TemporaryDirectory(prefix="rectoverso-") as name:
        folder = Path(name)
        places = [camera.rectangle(shown.outermost, angle) for angle in yaw]
        # Scene after scene: Blender takes a fifth of a second to turn from one to another.
        for i, (angle, place) in enumerate(zip(yaw, places, strict=True)):
            front, back = (_truth(truth, angle, side, place, folder) for side in (False, True))
            mask, dropped[i] = _silhouette(front.mask, back.mask, angle)
            masks[i][place] = mask
            view = {key: whole[i][place] for key, whole in maps.items()}
            for side, where in ((front, "front"), (back, "back")):
                view[f"depth_{where}"][mask] = side.depth[mask]
                view[f"normal_{where}"][mask] = side.normal[mask]
            _order(view["depth_front"], view["depth_back"], angle)
        for i, (angle, place) in enumerate(zip(yaw, places, strict=True)):
            mask = masks[i][place]
            for is_back, where in ((False, "front"), (True, "back")):
                radiance = _radiance(beauty, angle, is_back, place, folder)
                maps[f"radiance_{where}"][i][place][mask] = radiance[mask]
        if bare is not None:
            for i, angle in enumerate(yaw):
                place = camera.rectangle(skin.outermost, angle)
                front, back = (_truth(bare, angle, side, place, folder) for side in (False, True))
                both = front.mask & back.mask
                view = {key: whole[i][place] for key, whole in maps.items()}
                view["body_depth_front"][both] = front.depth[both]
                view["body_depth_back"][both] = back.depth[both]
                _order(view["body_depth_front"], view["body_depth_back"], angle)
    reset()  # gives the memory back
    return Capture(
        camera=camera,
        yaw=np.asarray(yaw, dtype=np.float64),
        camera_to_world=np.stack([camera.to_world(angle) for angle in yaw]),
        mask=masks,
        dropped_pixels=dropped,
        **maps,
    )


def capture_radiance(
    surface: Mesh,
    camera: Camera,
    yaw: np.ndarray,
    mask: np.ndarray,
    light_position: tuple[float, float, float],
    cycles: CyclesConfig,
    threads: int,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The colour of `capture` alone, view by view, to the bit. Needs `bpy`.

    Args:
        surface: the clothed surface in the subject's world, metres.
        yaw: (V,) radians.
        mask: (V, H, W) bool, the silhouettes of `capture`.
        light_position: of the point light, metres in the frame of the camera that sees it.
        threads: CPU threads Cycles may use.

    Yields:
        front and back of a view: (H, W, 3) float32 linear light (Rec. 709 primaries) per watt of
        the lamp; 0 outside the mask.
    """
    from render.scene import Scene, Surface, reset

    reset()
    shown = Surface(surface, textured=True)
    beauty = Scene("beauty", shown, camera, cycles, light_position=light_position, threads=threads)
    with tempfile.TemporaryDirectory(prefix="rectoverso-") as name:
        for angle, silhouette in zip(yaw, mask, strict=True):
            place = camera.rectangle(shown.outermost, angle)
            inside = silhouette[place]
            sides = np.zeros((2, *silhouette.shape, 3), dtype=np.float32)
            for side, back in zip(sides, (False, True), strict=True):
                side[place][inside] = _radiance(beauty, angle, back, place, Path(name))[inside]
            yield sides[0], sides[1]
    reset()  # gives the memory back


def _truth(scene: Scene, yaw: float, back: bool, place: Rectangle, folder: Path) -> Side:
    """Depth and normals from one side."""
    camera = scene.camera
    channels = shoot(scene, yaw, back, place, folder)
    z = channels["Depth.Z"]
    mask = (z > 0) & (z < BACKGROUND_DEPTH)
    # The back camera stands as far behind the axis as the front one before it.
    depth = (2 * camera.distance - z.astype(np.float64)).astype(np.float32) if back else z
    normal = np.zeros((*mask.shape, 3), dtype=np.float32)
    seen = np.stack([channels[f"Normal.{axis}"][mask] for axis in "XYZ"], axis=-1)
    # Row vectors times the camera's rotation: world to the front camera's frame.
    normal[mask] = _unit_towards(seen @ camera.to_world(yaw)[:3, :3], -1.0 if back else 1.0)
    return Side(mask=mask, depth=depth, normal=normal)


def _radiance(scene: Scene, yaw: float, back: bool, place: Rectangle, folder: Path) -> np.ndarray:
    """(h, w, 3) linear light per watt from one side: the subject's own colour, edges included."""
    from render.scene import LAMP_WATTS

    channels = shoot(scene, yaw, back, place, folder)
    color = np.stack([channels[f"Combined.{c}"] for c in "RGB"], axis=-1)
    # Not the blend of the edge with an empty background.
    return color / np.maximum(channels["Combined.A"], 1e-6)[..., None] / np.float32(LAMP_WATTS)


def shoot(
    scene: Scene, yaw: float, back: bool, place: Rectangle, folder: Path
) -> dict[str, np.ndarray]:
    """Render one side; its channels in the rectangle `place` of the front camera's grid.

    The back camera's image is mirrored left-right: both cameras look along the same lines.
    """
    rows, columns = place
    if not back:
        return scene.render(yaw, back, place, folder)
    width = scene.camera.columns
    seen = slice(width - columns.stop, width - columns.start)
    channels = scene.render(yaw, back, (rows, seen), folder)
    return {name: image[:, ::-1] for name, image in channels.items()}


def _unit_towards(normal: np.ndarray, sign: float) -> np.ndarray:
    """Unit normals; one that interpolation tipped past the horizon is laid back upon it."""
    normal = normal.astype(np.float64)
    normal[..., 2] = sign * np.maximum(sign * normal[..., 2], 0)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return (normal / np.maximum(length, 1e-12)).astype(np.float32)


def _silhouette(front: np.ndarray, back: np.ndarray, yaw: float) -> tuple[np.ndarray, int]:
    mask = front & back
    dropped = int((front ^ back).sum())
    if not mask.any():
        raise CaptureError(f"nothing is seen at yaw {np.degrees(yaw):.2f} deg; check the mesh")
    if dropped > max(1, MAX_DROPPED * mask.sum()):
        raise CaptureError(
            f"front and back disagree in {dropped} of {int(mask.sum())} pixels at yaw "
            f"{np.degrees(yaw):.2f} deg (at most {MAX_DROPPED:.2%}); "
            "close the surface's holes and slits"
        )
    return mask, dropped


def _order(front: np.ndarray, back: np.ndarray, yaw: float) -> None:
    """Make the back depth at least the front depth where they differ by rounding, in place."""
    worst = float((front - back).max())
    if worst > DEPTH_ROUNDING:
        raise CaptureError(
            f"the back lies {worst:.2e} m before the front at yaw {np.degrees(yaw):.2f} deg; "
            "the surface's triangles are degenerate"
        )
    np.maximum(front, back, out=back)
