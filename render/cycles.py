"""Every setting of Cycles, in one place. Imports nothing of Blender: scenes are handed in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class CyclesConfig:
    """How Cycles renders the colour images; the ground truth takes one sample by its nature."""

    samples: int = 16
    """Samples per pixel of the colour images (the most, where `adaptive_threshold` is set). Powers
    of two fill a pixel most evenly: 16 leave less noise than 18."""
    adaptive_threshold: float = 0.0
    """Noise level at which a pixel stops sampling, looked at every 16 samples, as Cycles has it for
    an image of common brightness; 0 takes every sample everywhere."""
    seed: int = 0
    """Seed of Cycles' sampling pattern."""
    device: Literal["CPU", "CUDA", "OPTIX", "HIP", "ONEAPI", "METAL"] = "CPU"
    """What renders; bytes are promised per kind of machine, so a GPU's differ from a CPU's."""

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= 65536:
            raise ValueError(f"cycles.samples: {self.samples}; give 1 to 65536, such as 16")
        if not 0 <= self.adaptive_threshold < 1:
            raise ValueError(
                f"cycles.adaptive_threshold: {self.adaptive_threshold}; give 0 (off) to below 1"
            )
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"cycles.seed: {self.seed}; give 0 to 2147483647")


def configure_beauty(scene: Any, config: CyclesConfig, preferences: Any, threads: int) -> None:
    """Set up a Blender scene to render colour: `config.samples` samples, spread over the pixel.

    A pixel's colour is the light of its own square, as that of a sensor's pixel. Blender's usual
    filter reaches a pixel beyond it on every side, so to the colours of a silhouette's neighbours
    too, and leaves 1.4 times the noise.

    Args:
        scene: a `bpy.types.Scene` with one view layer.
        preferences: `bpy.context.preferences`, which know the devices.
        threads: threads of the CPU that Cycles uses.
    """
    _configure(scene, config, preferences, threads)
    cycles, layer = scene.cycles, scene.view_layers[0]
    cycles.samples = config.samples
    cycles.use_adaptive_sampling = config.adaptive_threshold > 0
    if config.adaptive_threshold > 0:
        cycles.adaptive_threshold = config.adaptive_threshold
        cycles.adaptive_min_samples = min(4, config.samples)
    cycles.pixel_filter_type = "BOX"
    # Blue noise, the usual one, leaves the same error and takes a tenth longer.
    cycles.sampling_pattern = "TABULATED_SOBOL"
    layer.use_pass_z = False


def configure_truth(scene: Any, config: CyclesConfig, preferences: Any, threads: int) -> None:
    """Set up a Blender scene to render depth and normals along the ray through a pixel's centre.

    Cycles takes sample 0 there, and Z from sample 0 alone; the normal is a sum over the samples,
    so there is but one. The filter is narrow because Cycles looks its middle up in a table, which
    puts the ray off the centre by a part of its width: 2.6 micrometres for the common filter and
    pixels of 5 mm.

    Args:
        scene: a `bpy.types.Scene` with one view layer.
        preferences: `bpy.context.preferences`, which know the devices.
        threads: threads of the CPU that Cycles uses.
    """
    _configure(scene, config, preferences, threads)
    cycles, layer = scene.cycles, scene.view_layers[0]
    cycles.samples = 1
    cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.filter_width = 0.01
    layer.use_pass_combined = False
    layer.use_pass_z = True
    layer.use_pass_normal = True


def _configure(scene: Any, config: CyclesConfig, preferences: Any, threads: int) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    _choose_device(cycles, config.device, preferences)
    cycles.seed = config.seed
    cycles.use_animated_seed = False
    # Light that reaches the camera after one reflection: linear in the lamp's power, to the bit.
    cycles.max_bounces = 0
    cycles.sample_clamp_direct = 0
    cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.use_light_tree = False
    cycles.use_denoising = False
    cycles.film_exposure = 1
    cycles.use_auto_tile = False
    # Cycles keeps the mesh and its BVH from one render call to the next, but only while the scene
    # has a single view layer; a second one makes it load everything again in every call.
    render.use_persistent_data = True

    render.film_transparent = True
    render.use_motion_blur = False
    render.use_compositing = False
    render.use_sequencer = False
    render.use_simplify = False
    render.resolution_percentage = 100
    render.threads_mode = "FIXED"
    # With a single thread Cycles' caller waits for it by spinning, on a core that another worker
    # could use: two workers of two threads finish in four fifths of the time of two of one.
    render.threads = max(2, threads)
    render.use_border = True
    render.use_crop_to_border = True

    image = render.image_settings
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_mode = "RGBA"
    image.color_depth = "32"
    image.exr_codec = "NONE"
    render.use_file_extension = True
    render.use_overwrite = True
    # Float EXR stays linear; the view transform is applied later, to arrays.
    scene.view_settings.view_transform = "Raw"
    scene.view_settings.look = "None"
    scene.view_settings.exposure = 0
    scene.view_settings.gamma = 1


def _choose_device(cycles: Any, device: str, preferences: Any) -> None:
    cycles.device = "CPU" if device == "CPU" else "GPU"
    if device == "CPU":
        return
    known = preferences.addons["cycles"].preferences
    try:
        known.compute_device_type = device
    except TypeError:  # this build of Blender has no such devices at all
        found = []
    else:
        known.get_devices()
        found = [d for d in known.devices if d.type == device]
    if not found:
        raise OSError(f"cycles.device: no {device} device here; set it to CPU")
    for d in known.devices:
        d.use = d.type == device
