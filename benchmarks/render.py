"""Seconds per side and error of the colour, beside a bare Blender loop on the same mesh.

    python -m benchmarks.render [--mesh FILE] [--views 6] [--rounds 3]

A side is one camera's RGB, depth and normals as arrays; a view has two, front and back. All start
from the OBJ and its texture on disk. The pipeline and the loops take turns in fresh processes, so
that a ratio holds while the machine's speed drifts. The loops are:

- `bare`: what a script writes first, one layer with Combined, Z and Normal at the samples of the
  colour, full frame; its normals are averages over the pixel, not the truth.
- `exact`: the same with the truth in a second layer of one sample, full frame.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from augment.light import LightConfig, expose
from augment.photograph import develop
from engine.workers import cpu_count, run
from render.camera import Camera, CameraConfig, place_camera
from render.capture import Capture, capture
from render.cycles import CyclesConfig
from subjects.meshfile import read_mesh
from subjects.open import OpenHumans

REFERENCE_SAMPLES = 1024
SLOWEST = 1.15
"""Times the bare loop's seconds that the pipeline may take."""
LARGEST_ERROR = 1.0
"""Of 255, on average inside the mask, that colour may differ from the reference."""


def pipeline(path: Path, camera: Camera, yaw: np.ndarray, samples: int, threads: int) -> Capture:
    """The project's own way, bodies left out."""
    return capture(
        read_mesh(path),
        None,
        camera,
        yaw,
        LightConfig().position,
        CyclesConfig(samples=samples),
        threads,
    )


def loop(
    path: Path, camera: Camera, yaw: np.ndarray, samples: int, threads: int, exact: bool
) -> list[dict[str, np.ndarray]]:
    """A bare Blender script: import the OBJ, turn the camera, render, read the EXR."""
    import bpy
    import mathutils
    import OpenEXR

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.wm.obj_import(filepath=str(path), forward_axis="NEGATIVE_Z", up_axis="Y")
    thing = bpy.context.selected_objects[0]
    # The importer turns y up into z up; the camera below thinks in y up.
    thing.matrix_world = mathutils.Matrix.Identity(4)
    for slot in thing.material_slots:
        nodes, links = slot.material.node_tree.nodes, slot.material.node_tree.links
        texture = next(n for n in nodes if n.bl_idname == "ShaderNodeTexImage")
        diffuse = nodes.new("ShaderNodeBsdfDiffuse")
        output = next(n for n in nodes if n.bl_idname == "ShaderNodeOutputMaterial")
        links.new(texture.outputs["Color"], diffuse.inputs["Color"])
        links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
    data = bpy.data.cameras.new("camera")
    data.type, data.sensor_fit = "ORTHO", "HORIZONTAL"
    data.ortho_scale = camera.columns * camera.pixel_size
    eye = bpy.data.objects.new("camera", data)
    lamp_data = bpy.data.lights.new("lamp", "POINT")
    lamp_data.energy, lamp_data.shadow_soft_size = 1.0, 0
    lamp = bpy.data.objects.new("lamp", lamp_data)
    for new in (eye, lamp):
        scene.collection.objects.link(new)
    scene.camera = eye

    render, cycles = scene.render, scene.cycles
    render.engine, cycles.device, cycles.samples = "CYCLES", "CPU", samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    render.film_transparent = render.use_persistent_data = True
    render.resolution_x, render.resolution_y = camera.columns, camera.rows
    render.threads_mode, render.threads = "FIXED", threads
    image = render.image_settings
    image.file_format, image.color_depth = "OPEN_EXR_MULTILAYER", "32"
    image.exr_codec = "NONE"
    truth = scene.view_layers.new("truth") if exact else scene.view_layers[0]
    truth.use_pass_z = truth.use_pass_normal = True
    if exact:
        truth.samples = 1

    views = []
    with tempfile.TemporaryDirectory() as folder:
        render.filepath = f"{folder}/view.exr"
        for angle in yaw:
            for back in (False, True):
                to_world = camera.to_world(angle, back)
                eye.matrix_world = mathutils.Matrix(to_world.tolist())
                place = mathutils.Matrix.Translation(LightConfig().position)
                lamp.matrix_world = eye.matrix_world @ place
                bpy.ops.render.render(write_still=True)
                with OpenEXR.File(render.filepath, separate_channels=True) as file:
                    views.append({k: np.array(c.pixels) for k, c in file.channels().items()})
    return views


def timed(job: tuple) -> tuple[float, object]:
    """Seconds that `function(*arguments)` takes in this process, and its result if wanted."""
    function, arguments, keep = job
    if function is not pipeline:
        import bpy  # noqa: F401  # the loops' import is start-up, as the pipeline's is
    else:
        import render.scene  # noqa: F401
    start = time.perf_counter()
    result = function(*arguments)
    return time.perf_counter() - start, result if keep else None


def fresh(function, *arguments, keep: bool = False) -> tuple[float, object]:
    """`timed` in a process of its own."""
    job = (function, arguments, keep)
    ((_, result),) = run(timed, [job], jobs=1)
    if isinstance(result, BaseException):
        raise result
    return result


def open_human(folder: Path) -> Path:
    """The OBJ of an open human, made in a worker."""
    ((_, result),) = run(_make, [str(folder)], jobs=1)
    if isinstance(result, BaseException):
        raise result
    return result


def _make(folder: str) -> Path:
    return OpenHumans(count=1).make("open_0000", 0, Path(folder)).mesh


def color_error(quick: Capture, reference: Capture) -> float:
    """Mean absolute difference inside the mask, sRGB 8-bit units, front and back."""
    errors = []
    for name in ("radiance_front", "radiance_back"):
        a, b = (develop(expose(getattr(c, name), LightConfig())) for c in (quick, reference))
        errors.append(np.abs(a.astype(np.int16) - b)[quick.mask].mean())
    return float(np.mean(errors))


def main() -> int:
    """Print the table; 1 if a bound is broken, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, help="textured OBJ, y up, metres (an open human)")
    parser.add_argument("--views", type=int, default=6, help="yaws, each front and back")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--reference-views", type=int, default=2, help="yaws at 1024 samples")
    options = parser.parse_args()
    threads = cpu_count()
    with tempfile.TemporaryDirectory() as folder:
        path = options.mesh or open_human(Path(folder))
        mesh = read_mesh(path)
        camera = place_camera(CameraConfig(), mesh.vertices)
        yaw = np.radians(np.linspace(-30, 30, options.views))
        print(f"{len(mesh.faces)} faces, {threads} threads, {options.samples} samples")

        seconds: dict[str, list[float]] = {"pipeline": [], "bare": [], "exact": []}
        common = (camera, yaw, options.samples, threads)
        for _ in range(options.rounds):
            seconds["pipeline"].append(fresh(pipeline, path, *common)[0])
            seconds["bare"].append(fresh(loop, path, *common, False)[0])
            seconds["exact"].append(fresh(loop, path, *common, True)[0])
        shots = 2 * options.views
        ratios: dict[str, float] = {}
        print(f"{'':10} {'s per side':>10} {'pipeline /':>11}")
        for name, values in seconds.items():
            ratios[name] = median(a / b for a, b in zip(seconds["pipeline"], values, strict=True))
            print(f"{name:10} {median(values) / shots:10.3f} {ratios[name]:11.2f}")

        few = yaw[: options.reference_views]
        quick = fresh(pipeline, path, camera, few, options.samples, threads, keep=True)[1]
        best = fresh(pipeline, path, camera, few, REFERENCE_SAMPLES, threads, keep=True)[1]
        error = color_error(quick, best)
        print(
            f"colour against {REFERENCE_SAMPLES} samples, mean inside the mask: {error:.2f} / 255"
        )
    return int(ratios["bare"] > SLOWEST or error > LARGEST_ERROR)


if __name__ == "__main__":
    sys.exit(main())
