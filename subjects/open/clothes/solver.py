"""Blender's cloth solver as a process of its own.

    python -m subjects.open.clothes.solver IN.npz OUT.npz PARENT

The only file under subjects that imports Blender. IN.npz holds the moving body and the layers of
cloth from the innermost outwards, OUT.npz gets each layer's last two shapes.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

PR_SET_PDEATHSIG = 1
STEPS = 5
"""Steps of the solver in each frame (1/25 s)."""


def main(source: Path, target: Path) -> None:
    """Solve every layer of `source`, each over the body and the layers below it."""
    with np.load(source) as data:
        body, faces = data["body"], data["body_faces"]
        moving, settling = map(int, data["frames"])
        reach = float(data["reach"])
        keys = ("start", "goal", "faces", "pin", "material")
        layers = [{key: data[f"{key}_{i}"] for key in keys} for i in range(int(data["layers"]))]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 1 + moving + settling
    scene.gravity = (0.0, -9.81, 0.0)
    _make_collider(_add("body", body, faces, moving), 0.6 * reach)
    results: dict[str, np.ndarray] = {}
    for i, layer in enumerate(layers):
        # The first shape is where the cloth begins, the others are where it is held.
        shapes = np.concatenate([layer["start"][None], layer["goal"][1:]])
        cloth = _add("cloth", shapes, layer["faces"], moving)
        shapes = _solve(scene, cloth, layer["pin"], layer["material"], 0.4 * reach)
        bpy.data.objects.remove(cloth)
        _make_collider(_add("inner", shapes, layer["faces"], len(shapes) - 1), 0.3 * reach)
        results[f"last_{i}"], results[f"before_{i}"] = shapes[-1], shapes[-2]
    np.savez(target, **results)


def _add(name: str, shapes: np.ndarray, faces: np.ndarray, frames: int) -> Any:
    """A mesh that passes through `shapes` (K, N, 3), evenly over `frames`."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(shapes.shape[1])
    mesh.vertices.foreach_set("co", shapes[0].astype(np.float32).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)

    thing.shape_key_add(name="0")
    keys = mesh.shape_keys
    keys.use_relative = False  # one shape after the other, by the time they are evaluated at
    keys.eval_time = keys.key_blocks[0].frame
    if len(shapes) == 1:
        return thing
    for k, shape in enumerate(shapes[1:], 1):
        key = thing.shape_key_add(name=str(k))
        key.data.foreach_set("co", shape.astype(np.float32).ravel())
    for k, key in enumerate(keys.key_blocks):
        keys.eval_time = key.frame
        keys.keyframe_insert("eval_time", frame=1 + k * frames / (len(shapes) - 1))
    for curve in keys.animation_data.action.fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    return thing


def _make_collider(thing: Any, thickness: float) -> None:
    thing.modifiers.new("collision", "COLLISION")
    thing.collision.thickness_outer = thickness
    thing.collision.thickness_inner = 0.02
    thing.collision.cloth_friction = 5


def _solve(
    scene: Any, cloth: Any, pin: np.ndarray, material: np.ndarray, distance: float
) -> np.ndarray:
    """(frames, N, 3) the cloth's shapes. `material`: mass, stiffness, bending, slack."""
    mass, stiffness, bending, slack = map(float, material)
    group = cloth.vertex_groups.new(name="pin")
    for weight in np.unique(pin[pin > 0]):
        group.add(np.flatnonzero(pin == weight).tolist(), float(weight), "REPLACE")
    modifier = cloth.modifiers.new("cloth", "CLOTH")
    settings, collision = modifier.settings, modifier.collision_settings
    settings.quality = STEPS
    settings.mass = mass
    settings.air_damping = 1
    settings.tension_stiffness = settings.compression_stiffness = stiffness
    settings.shear_stiffness = stiffness / 3
    settings.bending_stiffness = bending
    settings.tension_damping = settings.compression_damping = settings.shear_damping = 5
    settings.bending_damping = 0.5
    settings.shrink_min = settings.shrink_max = -slack
    settings.vertex_group_mass = "pin"
    collision.collision_quality = 3
    collision.distance_min = distance
    collision.friction = 5
    collision.use_self_collision = False
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 1, scene.frame_end

    shapes = []
    for frame in range(1, scene.frame_end + 1):
        scene.frame_set(frame)
        mesh = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        shape = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        mesh.vertices.foreach_get("co", shape)
        shapes.append(shape.reshape(-1, 3))
    return np.array(shapes)


def _die_with(parent: int) -> None:
    """Have the kernel end this process with the one that waits for it."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it went before it could be asked
        sys.exit(1)


if __name__ == "__main__":
    _die_with(int(sys.argv[3]))
    main(Path(sys.argv[1]), Path(sys.argv[2]))
