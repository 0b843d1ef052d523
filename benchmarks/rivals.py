"""Seconds per view and error of the colour, beside the bare Blender loop and BlenderProc.

    python -m benchmarks.rivals [--views 14] [--rounds 3] [--faces 400000]
    python -m benchmarks.rivals --alone --meshes 16    # the build in its render calls, no rivals

A view is a subject from the front and from behind. All take the same meshes from OBJ files, with
the same texture, lamp, orthographic cameras and 424 x 512 pixels, and all are timed from the start
of the process to its end, on all cores:

- `build`: `pipeline.py build`, RGB, depth, normals, the same of the bare body (its depth), the
  sensor's reading, written, brought to the disk, hashed and entered into the manifest.
- `bare loop`: that of `benchmarks.render`, what a script writes first; nothing is written.
- `BlenderProc`: from PyPI, in an environment of its own, RGB, depth and normals by its own calls
  (`benchmarks.blenderproc_loop`). It has no body maps, writes no HDF5 file here and leaves its
  images in a temporary folder, so it does less. Its defaults are at most 1024 samples, adaptive
  (0.01), denoised, three bounces, a grey world; then the samples of the build; then as many as give
  its images the error of the build's, both without denoising; and last with direct light alone, as
  the build has it.

A rival's error is that against 1024 samples of its own with the same light and filter, so that only
noise counts; the build takes each pixel's square alone, the others Blender's wider filter. The
whole build is also told in its render calls: the seconds of all its workers together, over those
that they spend in Blender's render operator, timed in the build itself.

They take turns, and ratios are medians over the rounds. Processor seconds stand beside the clock's:
they say what the clock would on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from augment.light import LightConfig, expose
from augment.photograph import develop
from benchmarks.humans import write_humans
from benchmarks.render import LARGEST_ERROR, REFERENCE_SAMPLES, color_error, fresh, loop, pipeline
from benchmarks.watch import seconds_watched, watching
from engine.workers import cpu_count
from render.camera import Camera, CameraConfig, place_camera
from subjects.meshfile import read_mesh

ROOT = Path(__file__).parents[1]
BLENDERPROC = "2.8.0"
# What its Blender has beside it, and Python's of its own needs (its docs/tutorials/bpy_module.md).
BESIDE = ["opencv-contrib-python-headless<5", "rich", "scikit-image", "scikit-learn", "scipy"]
BESIDE += ["gitpython", "imageio", "numpy<2", "pypng", "pytz", "trimesh"]

DEFAULTS = "BlenderProc, its defaults"
EQUAL_SAMPLES = "BlenderProc, equal samples"
EQUAL_ERROR = "BlenderProc, equal error"
DIRECT = "BlenderProc, equal samples and light"
LADDER = (8, 16, 32, 64)
"""Samples that the one of equal error is sought between."""

FASTER_THAN_DEFAULTS = 10.0
FASTER_AT_EQUAL_ERROR = 2.0
BUILD_OVER_RENDERS = 1.25


@dataclass(frozen=True)
class Rival:
    """How BlenderProc is told to render: `samples` None for its defaults."""

    samples: int | None
    direct: bool = False


@dataclass(frozen=True)
class Cost:
    """Of one run over all meshes: by the clock, and of all its processes' processors."""

    seconds: float
    processor: float


def environment(folder: Path) -> Path:
    """BlenderProc's Python; made in `folder` where it is missing, with this project's bpy."""
    python = folder / "bin" / "python"
    if (folder / "ready").exists():
        return python
    print(f"installing BlenderProc {BLENDERPROC} in {folder}", file=sys.stderr)
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
    (pin,) = re.findall(r"^bpy==.+$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    wanted = [f"blenderproc=={BLENDERPROC}", pin, *BESIDE]
    subprocess.run([python, "-m", "pip", "install", "--quiet", *wanted], check=True)
    (folder / "ready").touch()
    return python


def costs(work: Callable[[], object]) -> Cost:
    """Of `work`, which leaves all to processes that it waits for."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    work()
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def quietly(command: list[str], environ: dict[str, str]) -> None:
    """Run a command in the repository's folder; what it said is shown if it fails."""
    done = subprocess.run(command, cwd=ROOT, env=environ, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")


class Field:
    """The meshes and the views that all of them render."""

    def __init__(self, meshes: list[Path], yaw: np.ndarray, samples: int, python: Path) -> None:
        """Args:
        meshes: OBJ files with a texture, y up, metres, each in a folder of scans with its body.
        yaw: radians.
        samples: of the build's colour.
        python: BlenderProc's.
        """
        self.meshes = meshes
        self.yaw = yaw
        self.samples = samples
        self._python = python
        self.cameras = [place_camera(CameraConfig(), read_mesh(mesh).vertices) for mesh in meshes]
        self.workers = min(cpu_count(), len(meshes))

    def build(self) -> list[float]:
        """The whole command; the seconds of its render calls."""
        with tempfile.TemporaryDirectory() as name:
            output, watched = Path(name) / "data", Path(name) / "watched"
            watched.mkdir()
            command = [sys.executable, "pipeline.py", "build", "--config", "configs/scans.yaml"]
            command += ["--output", str(output), "--jobs", str(self.workers)]
            command += ["--views.yaw_deg", str(np.degrees(self.yaw).tolist())]
            command += ["--cycles.samples", str(self.samples)]
            command += ["--subjects.root", str(self.meshes[0].parents[1])]
            # Wide clothes and long hair are far from the body; here nothing is set aside.
            command += ["--subjects.max_scan_to_body", "1", "--subjects.max_body_to_scan", "1"]
            quietly(command, watching(watched))
            entered = (output / "manifest.jsonl").read_text().count("\n")
            assert entered == len(self.meshes), f"{entered} shards of {len(self.meshes)}"
            return seconds_watched(watched)

    def bare(self) -> None:
        """The bare loop, a process for each mesh."""
        for mesh, camera in zip(self.meshes, self.cameras, strict=True):
            fresh(loop, mesh, camera, self.yaw, self.samples, cpu_count(), False)

    def blenderproc(self, rival: Rival) -> None:
        """BlenderProc, a process for each mesh."""
        for mesh, camera in zip(self.meshes, self.cameras, strict=True):
            self._blenderproc(rival, mesh, camera, self.yaw, None)

    def images(self, rival: Rival, yaw: np.ndarray) -> dict[str, np.ndarray]:
        """What BlenderProc makes of the first mesh: `colors`, `depth`, `normals`."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "images.npz"
            self._blenderproc(rival, self.meshes[0], self.cameras[0], yaw, path)
            with np.load(path) as file:
                return dict(file)

    def _blenderproc(
        self, rival: Rival, mesh: Path, camera: Camera, yaw: np.ndarray, colors: Path | None
    ) -> None:
        light = LightConfig()
        memory = Path("/dev/shm")  # where BlenderProc keeps them itself
        with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
            job = {
                "mesh": str(mesh),
                "poses": [camera.to_world(y, back).tolist() for y in yaw for back in (False, True)],
                "size": [camera.rows, camera.columns],
                "width": camera.columns * camera.pixel_size,
                "light": light.position,
                "energy": light.power * light.exposure,
                "samples": rival.samples,
                "direct": rival.direct,
                "temporary": folder,
                "colors": None if colors is None else str(colors),
            }
            path = Path(folder) / "job.json"
            path.write_text(json.dumps(job))
            command = [
                str(self._python),
                str(ROOT / "benchmarks" / "blenderproc_loop.py"),
                str(path),
            ]
            quietly(command, {k: v for k, v in os.environ.items() if k != "PYTHONPATH"})

    def own_error(self, yaw: np.ndarray) -> float:
        """Of the build's colour on the first mesh."""
        common = (pipeline, self.meshes[0], self.cameras[0], yaw)
        quick, best = (
            fresh(*common, samples, cpu_count(), keep=True)[1]
            for samples in (self.samples, REFERENCE_SAMPLES)
        )
        return color_error(quick, best)

    def bare_error(self, yaw: np.ndarray) -> float:
        """Of the bare loop's: its lamp, its samples and its cameras are the build's, its filter
        and its sampling pattern Blender's."""
        common = (loop, self.meshes[0], self.cameras[0], yaw)
        quick, best = (
            _bare_images(fresh(*common, samples, cpu_count(), False, keep=True)[1])
            for samples in (self.samples, REFERENCE_SAMPLES)
        )
        return image_error(quick, best)


def _bare_images(views: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """What the bare loop's views show, as `Field.images`: `colors` developed as the build's."""
    red, green, blue, alpha, depth = (
        np.stack([view[f"ViewLayer.{name}"] for view in views])
        for name in (*(f"Combined.{c}" for c in "RGBA"), "Depth.Z")
    )
    light = np.stack([red, green, blue], axis=-1) / np.maximum(alpha, 1e-6)[..., None]
    return {"colors": develop(expose(light, LightConfig())), "depth": depth}


def image_error(quick: dict[str, np.ndarray], best: dict[str, np.ndarray]) -> float:
    """Mean absolute difference on the subject, 8-bit units, as `color_error`."""
    seen = best["depth"] < 1e9
    return float(np.abs(quick["colors"].astype(np.int16) - best["colors"])[seen].mean())


def equal_samples(errors: dict[int, float], error: float) -> int:
    """How many samples give `error`, between those whose errors are known."""
    known = sorted(errors.items(), key=lambda item: item[1])
    logs = np.log([value for _, value in known]), np.log([samples for samples, _ in known])
    return round(float(np.exp(np.interp(np.log(error), *logs))))


def rival_errors(field: Field, yaw: np.ndarray, own: float) -> tuple[dict[str, Rival], dict]:
    """The rivals, the one of equal error among them, and their errors."""
    best = field.images(Rival(REFERENCE_SAMPLES), yaw)
    ladder = {n: image_error(field.images(Rival(n), yaw), best) for n in LADDER}
    print("BlenderProc's error at " + ", ".join(f"{n}: {e:.2f}" for n, e in ladder.items()))
    equal = equal_samples(ladder, own)
    rivals = {
        DEFAULTS: Rival(None),
        EQUAL_SAMPLES: Rival(field.samples),
        EQUAL_ERROR: Rival(equal),
        DIRECT: Rival(field.samples, direct=True),
    }
    errors = {
        name: image_error(field.images(rivals[name], yaw), best)
        for name in (DEFAULTS, EQUAL_SAMPLES, EQUAL_ERROR)
    }
    direct = field.images(Rival(REFERENCE_SAMPLES, direct=True), yaw)
    errors[DIRECT] = image_error(field.images(rivals[DIRECT], yaw), direct)
    return rivals, errors


def main() -> int:
    """Print the table; 1 if a target is missed, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=14, help="yaws, each front and back")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--faces", type=int, default=400_000)
    parser.add_argument("--samples", type=int, default=16, help="of the build's colour")
    parser.add_argument("--meshes", type=int, default=2)
    parser.add_argument("--alone", action="store_true", help="the build, and no rivals")
    parser.add_argument("--scans", type=Path, help="folder to keep the meshes in, or to find them")
    parser.add_argument("--reference-views", type=int, default=1, help="yaws at 1024 samples")
    parser.add_argument(
        "--environment", type=Path, default=ROOT / "out" / "blenderproc", help="BlenderProc's"
    )
    options = parser.parse_args()
    python = Path(sys.executable)
    if not options.alone:
        python = environment(options.environment.resolve())
    with tempfile.TemporaryDirectory() as folder:
        root = (options.scans or Path(folder) / "scans").resolve()
        meshes = sorted(root.glob("*/open_*.obj"))
        if not meshes:
            meshes = write_humans(root, options.meshes, options.faces)
        yaw = np.radians(np.linspace(-30, 30, options.views))
        field = Field(meshes, yaw, options.samples, python)
        if options.alone:
            return alone(field, options.rounds)
        return compare(field, options.rounds, yaw[: options.reference_views])


def share_of_renders(field: Field) -> tuple[Cost, float]:
    """Of one build: what it cost, and its workers' seconds over those of their render calls."""
    calls: list[float] = []
    cost = costs(lambda: calls.extend(field.build()))
    return cost, field.workers * cost.seconds / sum(calls)


def alone(field: Field, rounds: int) -> int:
    """Print the build's cost and share; 1 if the target is missed, else 0."""
    shares = []
    for _ in range(rounds):
        cost, share = share_of_renders(field)
        shares.append(share)
        views = len(field.meshes) * len(field.yaw)
        print(
            f"{len(field.meshes)} meshes, {views} views: {cost.seconds / views:.2f} s a view, "
            f"{share:.3f} of its render calls",
            flush=True,
        )
    return int(median(shares) > BUILD_OVER_RENDERS)


def compare(field: Field, rounds: int, few: np.ndarray) -> int:
    """Errors at the yaws `few`, then rounds of all, then the table; 1 if a target is missed."""
    faces = " and ".join(str(len(read_mesh(mesh).faces)) for mesh in field.meshes)
    views = len(field.meshes) * len(field.yaw)
    print(f"{faces} faces, {views} views, {cpu_count()} cores, {field.samples} samples", flush=True)
    own = field.own_error(few)
    print(f"the build's error: {own:.2f} of 255", flush=True)
    rivals, errors = rival_errors(field, few, own)
    errors |= {"build": own, "bare loop": field.bare_error(few)}

    runs: dict[str, list[Cost]] = {name: [] for name in ("build", "bare loop", *rivals)}
    shares = []
    for k in range(rounds):
        cost, share = share_of_renders(field)
        runs["build"].append(cost)
        shares.append(share)
        runs["bare loop"].append(costs(field.bare))
        for name, rival in rivals.items():
            runs[name].append(costs(lambda rival=rival: field.blenderproc(rival)))
        print(f"round {k + 1} of {rounds}", file=sys.stderr, flush=True)

    samples = {name: rival.samples or "up to 1024" for name, rival in rivals.items()}
    print("| | samples | error of 255 | s per view | over build | processor s | over build |")
    print("|---|---|---|---|---|---|---|")
    ratios = {}
    for name, of_name in runs.items():
        cells = [f"{errors[name]:.2f}"]
        for clock in ("seconds", "processor"):
            ours, its = ([getattr(c, clock) for c in run] for run in (runs["build"], of_name))
            ratios[name, clock] = median(b / a for a, b in zip(ours, its, strict=True))
            cells += [f"{median(its) / views:.2f}", f"{ratios[name, clock]:.2f}"]
        print(f"| {name} | {samples.get(name, field.samples)} | {' | '.join(cells)} |")
    whole, faster = median(shares), {name: ratios[name, "seconds"] for name in runs}
    print(f"\nthe whole build over its render calls: {whole:.2f}")
    targets = {
        f"error at most {LARGEST_ERROR} of 255": own <= LARGEST_ERROR,
        f"{FASTER_THAN_DEFAULTS:g} x its defaults": faster[DEFAULTS] >= FASTER_THAN_DEFAULTS,
        f"{FASTER_AT_EQUAL_ERROR:g} x at equal error": faster[EQUAL_ERROR] >= FASTER_AT_EQUAL_ERROR,
        f"{BUILD_OVER_RENDERS:g} x the render calls": whole <= BUILD_OVER_RENDERS,
    }
    for target, met in targets.items():
        print(f"{'met' if met else 'MISSED'}: {target}")
    return int(not all(targets.values()))


if __name__ == "__main__":
    sys.exit(main())
