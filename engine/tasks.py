"""What a worker process does for one subject. Imports Blender or torch only when called."""

from __future__ import annotations

import json
import os
import platform
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import seeds
from augment.photograph import photograph
from augment.sensors import read
from engine.config import BuildConfig
from engine.memory import PeakMemory
from render.camera import place_camera
from render.capture import Capture, CaptureError, capture
from shards.archive import write_shard
from shards.checksum import file_sha256
from shards.dataset import RECORD, SHARDS, SUBJECTS
from shards.schema import RADIANCE_WATTS, SCHEMA_VERSION
from storage.atomic import atomic_write
from storage.store import Store
from subjects.subject import Subject

COST = "cost.json"
"""What making a subject took: seconds and memory, which are no two times the same."""


@dataclass(frozen=True, eq=False)
class Task:
    """One subject on its way to a shard.

    Attributes:
        subject: its id.
        dataset: the dataset's folder, absolute; that of its mirror where it lies in a store.
        shard: the file to make.
        config: of the whole build.
        threads: threads of the CPU that the task may use.
        store: the URL that the dataset lies at, or None: the files are made in a folder that goes
            when they are in the store.
    """

    subject: str
    dataset: Path
    shard: Path
    config: BuildConfig
    threads: int
    store: str | None = None


@dataclass(frozen=True)
class ShardResult:
    """A shard that stands on disk: what its line in the manifest says of it."""

    bytes: int
    sha256: str
    views: int
    seconds: float
    licence: str


def subject_folder(dataset: Path, subject: str) -> Path:
    """Where a subject's files lie in a dataset."""
    return dataset / SUBJECTS / subject


def make_subject(task: Task) -> None:
    """Make the subject's files and, last of all, the record that says they are whole."""
    with _at_work(task) as here:
        _subject(here)
        _put_subject(here)


def make_shard(task: Task) -> ShardResult:
    """Render, sense, write: from a subject's record to its shard on disk."""
    with _at_work(task) as here:
        if here.store is not None:
            _fetch_subject(here)
        made = _shard(here, read_subject(subject_folder(here.dataset, here.subject)))
        _put(here, here.shard)
        return made


def make_both(task: Task) -> ShardResult:
    """`make_subject` and `make_shard`, for which the surface is read once.

    The source must not load torch: Blender comes into the same process.
    """
    with _at_work(task) as here:
        subject = _subject(here)
        _put_subject(here)
        made = _shard(here, subject)
        _put(here, here.shard)
        return made


@contextmanager
def _at_work(task: Task) -> Iterator[Task]:
    """The task with a folder to do it in: the dataset's own, or one that stands for it."""
    if task.store is None:
        yield task
        return
    with TemporaryDirectory() as name:
        shards = Path(name) / SHARDS
        shards.mkdir()
        yield replace(task, dataset=Path(name), shard=shards / task.shard.name)


def _put_subject(task: Task) -> None:
    """Into the store, where there is one: the subject's files, the record last."""
    if task.store is None:
        return
    folder = subject_folder(task.dataset, task.subject)
    files = sorted(filter(Path.is_file, folder.rglob("*")), key=lambda file: file.name == RECORD)
    _put(task, *files)


def _put(task: Task, *files: Path) -> None:
    if task.store is not None:
        store = Store(task.store)
        for file in files:
            store.put(file, file.relative_to(task.dataset).as_posix())


def _fetch_subject(task: Task) -> None:
    """Have the files here that another process made of the subject."""
    assert task.store is not None
    store = Store(task.store)
    for name in store.files(f"{SUBJECTS}/{task.subject}"):
        store.fetch(name, task.dataset / name)


def stage_of(task: Task) -> str:
    """The stage that a task which failed was in."""
    record = subject_folder(task.dataset, task.subject) / RECORD
    if task.store is None:
        return "render" if record.exists() else "subjects"
    try:
        Store(task.store).stat(record.relative_to(task.dataset).as_posix())
    except FileNotFoundError:
        return "subjects"
    return "render"


def _subject(task: Task) -> Subject:
    folder = subject_folder(task.dataset, task.subject)
    recipe = _recipe(task.config)
    if _is_whole(folder, recipe):
        return read_subject(folder)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    start = time.monotonic()
    with PeakMemory() as peak:
        subject = task.config.subjects.make(task.subject, task.config.seed, folder)
    record = {
        "recipe": recipe,
        "sha256": subject.content_sha256(),
        "subject": subject.to_json(folder),
    }
    cost = {"seconds": round(time.monotonic() - start, 2), "peak_memory_mb": peak.megabytes}
    with atomic_write(folder / COST) as file:  # never through a link
        file.write(json.dumps(cost).encode() + b"\n")
    # A record says that the files are whole: they reach the disk before it does.
    for path in filter(Path.is_file, folder.rglob("*")):
        with path.open("rb") as file:
            os.fsync(file.fileno())
    with atomic_write(folder / RECORD) as file:
        file.write(json.dumps(record, indent=1, sort_keys=True).encode() + b"\n")
    return subject


def _recipe(config: BuildConfig) -> str:
    """What a subject's files depend on, as text: other files than these are made again."""
    source = config.subjects
    return repr((type(source).__name__, source, config.seed, sorted(versions(config).items())))


def read_subject(folder: Path) -> Subject:
    """The subject that `make_subject` left in `folder`."""
    record = json.loads((folder / RECORD).read_text())
    return Subject.from_json(record["subject"], folder)


def _is_whole(folder: Path, recipe: str) -> bool:
    try:
        record = json.loads((folder / RECORD).read_text())
        made = Subject.from_json(record["subject"], folder)
        return record["recipe"] == recipe and record["sha256"] == made.content_sha256()
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _shard(task: Task, subject: Subject) -> ShardResult:
    start = time.monotonic()
    config = task.config
    surface, body = subject.surface(), subject.body_surface()
    camera = place_camera(
        config.camera,
        surface.vertices if body is None else np.concatenate([surface.vertices, body.vertices]),
    )
    yaw_deg = config.views.draw(seeds.generator(config.seed, subject.id, "yaw"))
    seen = capture(
        surface,
        body,
        camera,
        np.radians(yaw_deg.astype(np.float64)),
        config.light.position,
        config.cycles,
        task.threads,
    )
    members = _members(seen, yaw_deg, subject.id, config)
    meta = {
        "schema_version": SCHEMA_VERSION,
        "subject": subject.id,
        "source": subject.source,
        "licence": subject.licence,
        "mesh": subject.mesh.relative_to(task.dataset).as_posix(),
        "mesh_to_world": subject.mesh_to_world.tolist(),
        "mesh_sha256": file_sha256(subject.mesh),
        "files": {
            path.relative_to(task.dataset).as_posix(): file_sha256(path)
            for path in sorted(subject.made_of)
            if path != subject.mesh
        },
        "flip_faces": subject.flip_faces,
        "body": subject.body.relative_to(task.dataset).as_posix() if subject.body else None,
        "body_parameters": subject.body_parameters,
        "camera": {
            "size": [camera.rows, camera.columns],
            "pixel_size": camera.pixel_size,
            "distance": camera.distance,
            "center_height": camera.center_height,
        },
        "light": asdict(config.light),
        "color_camera": None if config.color_camera is None else asdict(config.color_camera),
        "cycles": asdict(config.cycles),
        "sensor": {"model": config.sensor.name, **asdict(config.sensor)},
        "seed": config.seed,
        "dropped_pixels": seen.dropped_pixels.tolist(),
        "versions": versions(config),
    }
    members |= _readings(members, meta, config.shards.draws)
    written = write_shard(task.shard, members, meta, config.shards.compression)
    return ShardResult(*written, time.monotonic() - start, subject.licence)


def _members(
    seen: Capture, yaw_deg: np.ndarray, subject: str, config: BuildConfig
) -> dict[str, np.ndarray]:
    """A shard's arrays from what the cameras saw, but for the sensor's."""

    def colors(radiance: np.ndarray, name: str) -> np.ndarray:
        foreground = (light[mask] for light, mask in zip(radiance, seen.mask, strict=True))
        key = (config.seed, subject, name)
        return photograph(foreground, seen.mask, config.light, config.color_camera, key)

    members = {
        "yaw_deg": yaw_deg,
        "camera_to_world": seen.camera_to_world,
        "mask": seen.mask,
        "depth_front": seen.depth_front,
        "depth_back": seen.depth_back,
        "normal_front": seen.normal_front.astype(np.float16),
        "normal_back": seen.normal_back.astype(np.float16),
        "rgb_front": colors(seen.radiance_front, "rgb_front"),
        "rgb_back": colors(seen.radiance_back, "rgb_back"),
        "body_depth_front": seen.body_depth_front,
        "body_depth_back": seen.body_depth_back,
    }
    if config.shards.radiance:
        members["radiance_front"] = _half(seen.radiance_front)
        members["radiance_back"] = _half(seen.radiance_back)
    return members


def _half(radiance: np.ndarray) -> np.ndarray:
    """Light per watt as a shard keeps it.

    Raises:
        CaptureError: it is too bright for half precision.
    """
    if radiance.max() * RADIANCE_WATTS > np.finfo(np.float16).max:
        raise CaptureError(
            f"the lamp lights a place with {radiance.max():.3g} per watt, more than half precision "
            "holds; move light.position away from the surface, or set shards.radiance false"
        )
    return (radiance * np.float32(RADIANCE_WATTS)).astype(np.float16)


def _readings(
    members: dict[str, np.ndarray], meta: dict[str, Any], draws: int
) -> dict[str, np.ndarray]:
    """What the sensor reads of the stored maps, so that whoever has the shard can read it again."""
    names = ("depth_front", "normal_front", "rgb_front", "mask")
    depth = np.stack(
        [
            np.stack(
                [
                    read({n: members[n][i] for n in names}, meta, i, draw).depth
                    for draw in range(draws)
                ]
            )
            for i in range(len(members["mask"]))
        ]
    )
    readings = {"depth_sensor": depth[:, 0]}
    if draws > 1:
        readings["depth_sensor_more"] = depth[:, 1:]
    return readings


def versions(config: BuildConfig) -> dict[str, str]:
    """What a shard's bytes depend on beside its configuration: package to version."""
    packages = ("bpy", "numpy", "openexr", "rectoverso", "trimesh", *config.subjects.packages)
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}
