"""One mesh by BlenderProc's own API: RGB, depth and normals of every pose of a JSON job.

    PYTHON_OF_ITS_ENVIRONMENT benchmarks/blenderproc_loop.py JOB.json

`benchmarks.rivals` writes the jobs and runs this. Nothing of the project is imported: BlenderProc
has an environment of its own. A job has

    mesh            OBJ, y up, metres
    poses           camera to world, 4x4 each
    size            [rows, columns]
    width           of the image, metres (the camera is orthographic)
    light, energy   place in the camera's frame, metres; watts
    samples         null for BlenderProc's defaults: at most 1024, adaptive, denoised
    direct          direct light of the lamp alone, as the pipeline has it
    temporary       folder for the files that the images pass through
    colors          npz to make of the images, or null

Its camera is perspective, so the orthographic one is set through bpy; so are the matte material,
which all the rivals have, and the sRGB curve in place of Filmic. All else is BlenderProc's.
"""

from __future__ import annotations

import json
import sys
import types
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np


def import_blenderproc(temporary: str) -> Any:
    """BlenderProc in this process's own Python, with its `bpy`, and its defaults set.

    Its repository has a mode for that, USE_EXTERNAL_BPY_MODULE; the newest release on PyPI, 2.8.0,
    has not, and would install packages into a Blender of its own. The mode leaves that out.
    """
    import os

    name = "blenderproc.python.utility.SetupUtility"
    site = str(Path(np.__file__).parents[1])

    class SetupUtility:
        @staticmethod
        def setup(packages: list[str]) -> None:
            sys.path.append(site)  # BlenderProc takes it away, for the sake of its own Blender

    stand_in = types.ModuleType(name)
    stand_in.SetupUtility = SetupUtility  # type: ignore[attr-defined]
    sys.modules[name] = stand_in
    os.environ["INSIDE_OF_THE_INTERNAL_BLENDER_PYTHON_ENVIRONMENT"] = "1"
    import blenderproc
    from blenderproc.python.utility import Initializer
    from blenderproc.python.utility.Utility import Utility

    Utility.temp_dir = temporary
    # As `blenderproc.init`, which also sets a language that the wheel of bpy does not have.
    Initializer.clean_up(clean_up_camera=True)
    bpy.context.scene.render.engine = "CYCLES"
    blenderproc.renderer.set_render_devices()
    Initializer._Initializer.set_default_parameters()
    return blenderproc


def make_matte(thing: Any) -> None:
    """The texture on a Lambertian surface, in place of the importer's glossy one."""
    for slot in thing.material_slots:
        nodes, links = slot.material.node_tree.nodes, slot.material.node_tree.links
        texture = next(n for n in nodes if n.bl_idname == "ShaderNodeTexImage")
        diffuse = nodes.new("ShaderNodeBsdfDiffuse")
        output = next(n for n in nodes if n.bl_idname == "ShaderNodeOutputMaterial")
        links.new(texture.outputs["Color"], diffuse.inputs["Color"])
        links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])


def render(job: dict[str, Any]) -> dict[str, list[np.ndarray]]:
    """Every pose's images, as BlenderProc returns them."""
    bproc = import_blenderproc(job["temporary"])
    (thing,) = bproc.loader.load_obj(job["mesh"], forward_axis="NEGATIVE_Z", up_axis="Y")
    # The importer turns y up into z up; the cameras think in y up.
    thing.blender_obj.matrix_world = mathutils.Matrix.Identity(4)
    make_matte(thing.blender_obj)

    rows, columns = job["size"]
    bproc.camera.set_resolution(columns, rows)
    camera = bpy.context.scene.camera.data
    camera.type, camera.sensor_fit, camera.ortho_scale = "ORTHO", "HORIZONTAL", job["width"]
    bpy.context.scene.view_settings.view_transform = "Standard"

    light = bproc.types.Light("POINT")
    light.set_energy(job["energy"])
    light.set_radius(0)
    for frame, pose in enumerate(np.asarray(job["poses"])):
        bproc.camera.add_camera_pose(pose)
        light.set_location((pose @ [*job["light"], 1])[:3], frame)

    if job["samples"] is not None:
        bproc.renderer.set_max_amount_of_samples(job["samples"])
        bproc.renderer.set_noise_threshold(0)
        bproc.renderer.set_denoiser(None)
    if job["direct"]:
        bproc.renderer.set_light_bounces(0, 0, 0, 0, 0, 0, 0)
        bproc.renderer.set_world_background([0.0, 0.0, 0.0])
    bproc.renderer.enable_depth_output(activate_antialiasing=False)
    bproc.renderer.enable_normals_output()
    return bproc.renderer.render()


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text())
    images = render(job)
    if job["colors"] is not None:
        np.savez(job["colors"], **{k: np.stack(images[k]) for k in ("colors", "depth", "normals")})


if __name__ == "__main__":
    main()
