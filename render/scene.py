"""A Blender scene of one surface: mesh, material, light and camera.

The only file that builds anything in Blender; imported in worker processes alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np

from render.camera import Camera
from render.cycles import FILTER_OFFSET, CyclesConfig, configure
from render.exr import read_layers
from subjects.mesh import Material, Mesh

# Cycles keeps the name "color" to itself and renders an attribute of that name black.
VERTEX_COLOR = "vertex_color"


class Scene:
    """One surface under one camera and, where colour is wanted, one point light.

    The surface never moves: camera and light turn around it, so Cycles builds its BVH once.
    Close it to give Blender's memory back.
    """

    def __init__(
        self,
        name: str,
        mesh: Mesh,
        camera: Camera,
        config: CyclesConfig,
        *,
        light_position: tuple[float, float, float] | None,
        threads: int,
    ) -> None:
        """Args:
        name: name of the Blender scene.
        mesh: the surface in the subject's world, metres.
        light_position: camera-frame metres of a 1 W point light, or None for no colour.
        threads: CPU threads.
        """
        self.camera = camera
        self._scene = bpy.data.scenes.new(name)
        self._light_position = light_position
        self._data: list[Any] = []
        configure(self._scene, config, beauty=light_position is not None, threads=threads)
        self._scene.render.resolution_x = camera.columns
        self._scene.render.resolution_y = camera.rows
        self._add_mesh(mesh, textured=light_position is not None)
        self._camera = self._add_camera()
        self._light = self._add_light() if light_position is not None else None

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
            `layer.pass.channel` to (rows, columns) float32.
        """
        to_world = self.camera.to_world(yaw, back)
        offset = np.eye(4)
        offset[:2, 3] = -FILTER_OFFSET * self.camera.pixel_size
        self._camera.matrix_world = mathutils.Matrix(to_world @ offset)
        if self._light is not None:
            place = np.eye(4)
            place[:3, 3] = self._light_position
            self._light.matrix_world = mathutils.Matrix(to_world @ place)
        self._set_border(*rectangle)
        path = folder / f"{self._scene.name}.exr"
        self._scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=self._scene.name)
        try:
            return read_layers(path)
        finally:
            path.unlink(missing_ok=True)

    def close(self) -> None:
        """Remove the scene and everything in it from Blender's memory."""
        bpy.data.scenes.remove(self._scene)
        bpy.data.batch_remove(self._data)

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
        thing = self._add(data, "camera")
        self._scene.camera = thing
        return thing

    def _add_light(self) -> Any:
        data = bpy.data.lights.new("light", "POINT")
        data.energy = 1.0
        data.shadow_soft_size = 0
        data.use_soft_falloff = False
        data.cycles.max_bounces = 0
        return self._add(data, "light")

    def _add_mesh(self, mesh: Mesh, textured: bool) -> None:
        data = bpy.data.meshes.new("surface")
        faces = len(mesh.faces)
        data.vertices.add(len(mesh.vertices))
        data.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
        data.loops.add(3 * faces)
        data.loops.foreach_set("vertex_index", mesh.faces.ravel())
        data.polygons.add(faces)
        data.polygons.foreach_set("loop_start", np.arange(0, 3 * faces, 3, dtype=np.int32))
        data.update(calc_edges=True)
        if textured:
            self._add_materials(data, mesh)
        self._add(data, "surface")

    def _add_materials(self, data: Any, mesh: Mesh) -> None:
        if mesh.vertex_colors is not None:
            colors = data.color_attributes.new(VERTEX_COLOR, "FLOAT_COLOR", "POINT")
            rgba = np.ones((len(mesh.vertices), 4), dtype=np.float32)
            rgba[:, :3] = _linear(mesh.vertex_colors / 255)
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
        self._data.append(data)
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
            diffuse.inputs["Color"].default_value = (*_linear(material.color), 1.0)
        return data

    def _image(self, texture: np.ndarray) -> Any:
        height, width = texture.shape[:2]
        image = bpy.data.images.new("texture", width, height, alpha=False)
        self._data.append(image)
        rgba = np.ones((height, width, 4), dtype=np.float32)
        # Blender's rows run upwards.
        np.divide(texture[::-1], np.float32(255), out=rgba[:, :, :3])
        image.pixels.foreach_set(rgba.ravel())
        image.update()
        return image

    def _add(self, data: Any, name: str) -> Any:
        thing = bpy.data.objects.new(name, data)
        self._scene.collection.objects.link(thing)
        self._data += [thing, data]
        return thing


def reset() -> None:
    """Empty Blender's memory of everything, the start-up file's objects included."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


def _linear(srgb: np.ndarray | tuple[float, float, float]) -> np.ndarray:
    """sRGB in [0, 1] to linear light (IEC 61966-2-1)."""
    srgb = np.asarray(srgb)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
