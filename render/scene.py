"""A surface in Blender and the scenes that show it: mesh, material, light and camera.

The only file that builds anything in Blender; imported in worker processes alone.
"""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np

from render.camera import Camera, outermost
from render.cycles import CyclesConfig, configure_beauty, configure_truth
from render.exr import read_channels
from subjects.color import srgb_to_linear
from subjects.mesh import Material, Mesh

# Cycles keeps the name "color" to itself and renders an attribute of that name black.
VERTEX_COLOR = "vertex_color"

LAMP_WATTS = 64.0
"""Of the lamp that colour is rendered under. About as bright as images are shown, which is what
Cycles' noise level is told in; a power of two, so that light per watt is exact."""

_LARGEST_EXR = 2**23
"""Bytes of an image of all channels, and more."""


class Surface:
    """A mesh and its materials in Blender's memory, shared by the scenes that show it.

    Attributes:
        outermost: (K, 3) those of its vertices that bound its image at any yaw.
    """

    def __init__(self, mesh: Mesh, textured: bool) -> None:
        """Upload a surface.

        Args:
            mesh: in the subject's world, metres.
            textured: whether its colours are wanted.
        """
        self.outermost = outermost(mesh.vertices)
        self.data = bpy.data.meshes.new("surface")
        faces = len(mesh.faces)
        self.data.vertices.add(len(mesh.vertices))
        self.data.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
        self.data.loops.add(3 * faces)
        # Of Blender's own type, or it takes number by number.
        self.data.loops.foreach_set("vertex_index", mesh.faces.astype(np.int32).ravel())
        self.data.polygons.add(faces)
        self.data.polygons.foreach_set("loop_start", np.arange(0, 3 * faces, 3, dtype=np.int32))
        self.data.update(calc_edges=True)
        if textured:
            self._add_materials(mesh)

    def _add_materials(self, mesh: Mesh) -> None:
        data = self.data
        if mesh.vertex_colors is not None:
            colors = data.color_attributes.new(VERTEX_COLOR, "FLOAT_COLOR", "POINT")
            rgba = np.ones((len(mesh.vertices), 4), dtype=np.float32)
            rgba[:, :3] = srgb_to_linear(mesh.vertex_colors / 255)
            colors.data.foreach_set("color", rgba.ravel())
            data.materials.append(self._matte(Material(), attribute=VERTEX_COLOR))
            return
        if mesh.uv is not None:
            data.uv_layers.new(name="uv").data.foreach_set("uv", mesh.uv.astype(np.float32).ravel())
        for material in mesh.materials:
            data.materials.append(self._matte(material))
        data.polygons.foreach_set("material_index", mesh.face_material)

    def _matte(self, material: Material, attribute: str | None = None) -> Any:
        data = bpy.data.materials.new("matte")
        data.use_nodes = True
        nodes, links = data.node_tree.nodes, data.node_tree.links
        nodes.clear()
        diffuse = nodes.new("ShaderNodeBsdfDiffuse")
        output = nodes.new("ShaderNodeOutputMaterial")
        links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
        if attribute is not None:
            color = nodes.new("ShaderNodeAttribute")
            color.attribute_name = attribute
            links.new(color.outputs["Color"], diffuse.inputs["Color"])
        elif material.texture is not None:
            color = nodes.new("ShaderNodeTexImage")
            color.image = self._image(material.texture)
            links.new(color.outputs["Color"], diffuse.inputs["Color"])
        else:
            diffuse.inputs["Color"].default_value = (*srgb_to_linear(material.color), 1.0)
        return data

    def _image(self, texture: np.ndarray) -> Any:
        height, width = texture.shape[:2]
        image = bpy.data.images.new("texture", width, height, alpha=False)
        rgba = np.empty((height, width, 4), dtype=np.float32)
        rgba[:, :, 3] = 1
        # Blender's rows run upwards.
        np.divide(texture[::-1], np.float32(255), out=rgba[:, :, :3])
        image.pixels.foreach_set(rgba.ravel())
        image.update()
        return image


class Scene:
    """One surface under one camera: for its truth, or for its colour under one point light.

    The surface never moves: camera and light turn around it, so Cycles builds its BVH once.
    """

    def __init__(
        self,
        name: str,
        surface: Surface,
        camera: Camera,
        config: CyclesConfig,
        *,
        light_position: tuple[float, float, float] | None,
        threads: int,
    ) -> None:
        """Set the scene up.

        Args:
            name: of the Blender scene.
            surface: what is seen.
            light_position: camera-frame metres of a point light of LAMP_WATTS that colour is
                rendered under, or None for depth and normals.
            threads: threads of the CPU that Cycles uses.
        """
        self.name = name
        self.surface = surface
        self.camera = camera
        self._scene = bpy.data.scenes.new(name)
        configure = configure_truth if light_position is None else configure_beauty
        configure(self._scene, config, bpy.context.preferences, threads)
        self._scene.render.resolution_x = camera.columns
        self._scene.render.resolution_y = camera.rows
        self._link("surface", surface.data)
        self._eye = self._add_camera()
        self._scene.camera = self._eye
        self._light_position = light_position
        self._light = None
        if light_position is not None:
            self._light = self._add_light()
            self._add_twin()

    @property
    def layer(self) -> Any:
        """The `bpy.types.ViewLayer` that says which passes are rendered."""
        return self._scene.view_layers[0]

    def render(
        self, yaw: float, back: bool, rectangle: tuple[slice, slice], folder: Path
    ) -> dict[str, np.ndarray]:
        """One render call: the channels of `rectangle` in the image of the camera at `yaw`.

        Args:
            yaw: radians.
            back: from the camera's place turned by pi; the image is as that camera sees it.
            rectangle: rows and columns of that image.
            folder: where the EXR passes through.

        Returns:
            `pass.channel` to (rows, columns) float32.

        Raises:
            OSError: there is no room for the EXR.
        """
        to_world = self.camera.to_world(yaw, back)
        self._eye.matrix_world = mathutils.Matrix(to_world)
        if self._light is not None:
            place = np.eye(4)
            place[:3, 3] = self._light_position
            self._light.matrix_world = mathutils.Matrix(to_world @ place)
        self._set_border(*rectangle)
        path = folder / f"{self.name}.exr"
        self._scene.render.filepath = str(path)
        try:
            bpy.ops.render.render(write_still=True, scene=self._scene.name)
            return read_channels(path)
        except (OSError, RuntimeError) as error:
            # Neither Blender nor OpenEXR tells why it could not.
            if shutil.disk_usage(folder).free < _LARGEST_EXR:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder)) from error
            raise
        finally:
            path.unlink(missing_ok=True)

    def _set_border(self, rows: slice, columns: slice) -> None:
        # Blender truncates to whole pixels; half a pixel keeps rounding away from the edges.
        render, (height, width) = self._scene.render, (self.camera.rows, self.camera.columns)
        render.border_min_x = (columns.start + 0.5) / width
        render.border_max_x = (columns.stop + 0.5) / width
        render.border_min_y = (height - rows.stop + 0.5) / height
        render.border_max_y = (height - rows.start + 0.5) / height

    def _add_camera(self) -> Any:
        data = bpy.data.cameras.new("camera")
        data.type = "ORTHO"
        data.sensor_fit = "HORIZONTAL"
        data.ortho_scale = self.camera.columns * self.camera.pixel_size
        data.clip_start = 1e-3
        data.clip_end = 1e3
        return self._link("camera", data)

    def _add_light(self) -> Any:
        data = bpy.data.lights.new("light", "POINT")
        data.energy = LAMP_WATTS
        data.shadow_soft_size = 0
        data.use_soft_falloff = False
        data.cycles.max_bounces = 0
        return self._link("light", data)

    def _add_twin(self) -> None:
        # A mesh of two objects has a BVH of its own, below the scene's; one of a single object lies
        # in the scene's, which Cycles builds again for every place of the light. No ray sees this.
        twin = self._link("twin", self.surface.data)
        for rays in ("camera", "diffuse", "glossy", "transmission", "shadow"):
            setattr(twin, f"visible_{rays}", False)

    def _link(self, name: str, data: Any) -> Any:
        thing = bpy.data.objects.new(name, data)
        self._scene.collection.objects.link(thing)
        return thing


def reset() -> None:
    """Empty Blender's memory of every surface and scene, the start-up file's included."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
