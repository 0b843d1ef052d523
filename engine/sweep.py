"""Many light powers from one render: a dataset's colours under other lamps, the rest by reference.

Direct light is linear in the lamp's power, so the radiance of one render, or of a shard that kept
it, gives the image of every power (section 4.6 of the paper: twenty, from 2000 W down to 100 W).
"""

from __future__ import annotations

import json
import platform
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from augment.color_camera import ColorCamera
from augment.light import LightConfig
from augment.photograph import photograph
from engine.engines import Means
from engine.stage import run_stage
from engine.tasks import RECORD, ShardResult, read_subject, subject_folder
from render.camera import Camera
from render.capture import capture_radiance
from render.cycles import CyclesConfig
from shards.archive import Compression, Shard, ShardError, write_shard
from shards.checksum import file_sha256
from shards.dataset import BASE, MANIFEST, SUBJECTS, Dataset, DatasetWriter
from shards.lock import hold_folder
from shards.manifest import DatasetError, differences, read_manifest
from shards.schema import RADIANCE_WATTS
from shards.splits import Split
from shards.sweep import is_sweep, lock_sweep, power_folder, read_shared, write_index
from storage.atomic import remove_temporary_files
from storage.mirror import Mirror
from subjects.subject import Subject

_SIDES = ("front", "back")


@dataclass(frozen=True)
class SweepConfig:
    """Which lights a dataset is photographed under, and how."""

    powers: list[float] = field(default_factory=lambda: [2000.0 - 100 * k for k in range(20)])
    """Powers of the point light, watts; each becomes a dataset."""
    exposure: float | None = None
    """Factor on linear radiance, the same for every power (default: the dataset's)."""
    color_camera: ColorCamera | None = field(default_factory=ColorCamera)
    """The camera whose noise the colours have, such as {"full_well": 8000}; null for none."""
    draw: int = 0
    """Which draw of that noise; another number is another photograph of the same."""
    split: Split | None = None
    """Only the subjects of this split (default: all)."""
    subjects: list[str] | None = None
    """Only these subjects, by their ids (default: all)."""
    compression: Compression = "stored"
    """How shards lie on disk, as `shards.compression` of a build."""

    def __post_init__(self) -> None:
        if not self.powers:
            raise ValueError("powers: none is given; give watts, such as [2000, 1000, 100]")
        for power in self.powers:
            if not 0 < power < 1e9:
                raise ValueError(f"powers: {power} W; give watts above 0 and below 1e9")
        if len(set(self.powers)) < len(self.powers):
            raise ValueError(f"powers: {self.powers} names one twice; name each once")
        if self.exposure is not None and not 0 < self.exposure < 1e9:
            raise ValueError(f"exposure: {self.exposure}; give a factor above 0, such as 0.06")
        if self.draw < 0:
            raise ValueError(f"draw: {self.draw}; give a whole number from 0 on")
        if self.subjects is not None and not self.subjects:
            raise ValueError("subjects: none is given; give ids, or null for all")
        if self.draw and self.color_camera is None:
            raise ValueError(f"draw: {self.draw} of no noise; give a color_camera, or leave it 0")


class Sweep:
    """A sweep's folder, open to be filled: a dataset for each power, and the index of them.

    What earlier runs made there belongs to it: powers and subjects that are named later join
    those, and each run brings all of them up to date, so all powers have the same subjects in the
    same splits. Nobody else writes the folder meanwhile, and no build the dataset.

    Attributes:
        base: the dataset that is photographed.
        config: the sweep's.
        writers: power in watts -> the dataset of that power, strongest first.
        planned: the ids of the subjects.
        dropped: ids that earlier runs photographed and the dataset has no more.

    Args:
        config: the sweep's.
        data: folder of the dataset.
        output: folder of the sweep; made if missing, taken up again if it was interrupted.

    Raises:
        ValueError: `data` is no dataset, or has no such subjects, or is of a sweep itself;
            `output` cannot be written, holds something else or lies in `data`; either is in use.
    """

    def __init__(self, config: SweepConfig, data: Path, output: Path) -> None:
        self.config, self.folder = config, output
        self._open = ExitStack()
        self.writers: dict[float, DatasetWriter] = {}
        try:
            self.base = Dataset(data)  # first of all, for what is no dataset has no lock to hold
            held = hold_folder(self.base.folder)
            if held is not None:
                self._open.enter_context(held)
                self.base = Dataset(data)  # as it stands now that no build can change it
            self._refuse_place()
            wanted = self._wanted()
            self.exposure, kept = self._light(wanted)
            self._open.enter_context(lock_sweep(output))
            powers, made = self._take_up()
            self.planned = sorted(set(wanted) | (made & self.base.manifest.keys()))
            self.dropped = sorted(made - set(self.planned))
            for power in sorted({*powers, *map(float, config.powers)}, reverse=True):
                writer = DatasetWriter(
                    output / power_folder(power),
                    self._record(power),
                    self.planned,
                    self.base.description["seed"],
                    _versions(kept),
                    self.base,
                )
                self.writers[power] = self._open.enter_context(writer)
            # A power whose folder cannot be used never comes so far.
            write_index(output, self.base.folder, self._shared(), self.writers)
        except OSError as error:
            self._open.close()
            raise DatasetError(
                f"output '{output}' cannot be written ({error.strerror}); choose another folder"
            ) from error
        except BaseException:
            self._open.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._open.close()

    @property
    def lacking(self) -> dict[str, list[float]]:
        """Subject -> the powers that lack it."""
        powers = {
            subject: [power for power, w in self.writers.items() if subject not in w.finished]
            for subject in self.planned
        }
        return {subject: found for subject, found in powers.items() if found}

    def tasks(self, threads: int) -> list[SweepTask]:
        """What is missing, subject by subject."""
        versions = next(iter(self.writers.values())).versions
        return [
            SweepTask(
                subject,
                self.base.folder.resolve(),
                self.base.manifest[subject].file,
                self.base.manifest[subject].sha256,
                self.config,
                {power: self._record(power) for power in powers},
                {power: self.writers[power].shard_path(subject).resolve() for power in powers},
                versions,
                threads,
                self.base.url,
            )
            for subject, powers in self.lacking.items()
        ]

    def finish(self) -> None:
        """Put everything in order: every power's dataset, and no leftovers."""
        for writer in self.writers.values():
            writer.finish()
        remove_temporary_files(self.folder)

    def _refuse_place(self) -> None:
        """A sweep in its dataset would be a part of what it links, and the reverse."""
        output, data = self.folder.resolve(), self.base.folder.resolve()
        if output.is_relative_to(data) or data.is_relative_to(output):
            raise DatasetError(
                f"{self.folder} and {self.base.folder} lie in each other; choose another folder"
            )
        if (data / BASE).exists() and not (data / SUBJECTS).exists():
            raise ValueError(
                f"{self.base.folder} is a part of a sweep itself; give the dataset that it was "
                f"made of, {(data / BASE).resolve()}"
            )

    def _wanted(self) -> list[str]:
        known = self.base.subjects(self.config.split)
        wanted = known if self.config.subjects is None else sorted(set(self.config.subjects))
        for subject in wanted:
            if subject not in known:
                which = f"the {self.config.split} split of " if self.config.split else ""
                raise ValueError(
                    f"subjects: {which}{self.base.folder} has no finished subject '{subject}'; "
                    f"it has {', '.join(known[:4])}{', ...' if len(known) > 4 else ''}"
                )
        if not wanted:
            raise ValueError(f"{self.base.folder} has no subject to photograph; build it first")
        return wanted

    def _light(self, subjects: list[str]) -> tuple[float, bool]:
        """The exposure, and whether every shard that can be read kept its radiance."""
        exposure, kept = self.config.exposure, True
        for subject in subjects:
            try:
                shard = self.base.shard(subject)
            except ShardError:
                continue  # its task will say so
            exposure = shard.meta["light"]["exposure"] if exposure is None else exposure
            kept &= "radiance_front" in shard
        if exposure is None:
            raise ValueError(f"{self.base.folder} has no whole shard; build it again")
        return float(exposure), kept

    def _take_up(self) -> tuple[list[float], set[str]]:
        """The powers and the subjects of earlier runs; the index comes first of all files."""
        powers: list[float] = []
        made: set[str] = set()
        if is_sweep(self.folder):
            there, powers = read_shared(self.folder)
            for power in powers:
                made |= read_manifest(self.folder / power_folder(power) / MANIFEST).keys()
            here = json.loads(json.dumps(self._shared()))
            differing = differences(there, here)
            if differing and made:
                raise DatasetError(
                    f"{self.folder} holds a sweep of another configuration ({differing}); "
                    "choose another folder or delete the sweep"
                )
            # One that has no shard yet may still change its mind.
            powers = [] if differing else powers
        write_index(self.folder, self.base.folder, self._shared(), powers)
        return powers, made

    def _record(self, power: float) -> dict[str, Any]:
        """All that the bytes of one power's shards depend on, but for the base's."""
        return {"light": {"power": power}, **self._shared()}

    def _shared(self) -> dict[str, Any]:
        """What is the same for every power."""
        return {
            "exposure": self.exposure,
            "color_camera": _camera_record(self.config.color_camera),
            "draw": self.config.draw,
            "compression": self.config.compression,
            "base_config_sha256": self.base.description["config_sha256"],
        }


@dataclass(frozen=True, eq=False)
class SweepTask:
    """One subject on its way to a shard for each power.

    Attributes:
        subject: its id.
        base: folder of the dataset that is photographed, absolute.
        shard: the subject's shard there, a path below it.
        sha256: of that shard, as the manifest has it.
        config: the sweep's.
        records: watts -> the configuration of that power's dataset.
        powers: watts -> the file to make.
        versions: what makes the shards.
        threads: threads of the CPU that the task may use.
        store: the URL that the base lies at, or None; `base` is a mirror of it then, here.
    """

    subject: str
    base: Path
    shard: str
    sha256: str
    config: SweepConfig
    records: dict[float, dict[str, Any]]
    powers: dict[float, Path]
    versions: dict[str, str]
    threads: int
    store: str | None = None


def sweep(work: Sweep, means: Means) -> bool:
    """Make the shards that a sweep lacks; returns whether it has them all then.

    Args:
        means: to do it with.

    Raises:
        OSError: there is no room to write.
        EngineError: `means` cannot be had.
    """
    start = time.monotonic()
    lacking = len(work.lacking)
    powers, subjects = len(work.writers), len(work.planned)
    if lacking < subjects:
        print(f"{subjects - lacking} of {subjects} subjects stand already", file=sys.stderr)
    if work.dropped:
        print(f"no longer part of the sweep: {', '.join(work.dropped)}", file=sys.stderr)

    def add(task: SweepTask, shards: dict[float, ShardResult]) -> None:
        for power, shard in shards.items():
            work.writers[power].add(task.subject, **asdict(shard))

    def fail(task: SweepTask, why: str) -> None:
        for power in task.powers:
            work.writers[power].fail(task.subject, "sweep", why)

    lit = 0
    if lacking:
        with means.open(lacking, work.folder) as engine:
            tasks = work.tasks(engine.threads)
            lit = len(run_stage("sweep", light_subject, tasks, engine, fail, add))
    failed = lacking - lit
    work.finish()
    elapsed = time.monotonic() - start
    print(
        f"{_count(powers, 'power')} of {_count(subjects - failed, 'subject')} in {work.folder}\n"
        f"{_count(lacking - failed, 'subject')} made now in {elapsed:.0f} s; {failed} set aside"
        + (f", see {work.folder}/*/failures.jsonl" if failed else "")
    )
    return failed == 0


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def light_subject(task: SweepTask) -> dict[float, ShardResult]:
    """Photograph one subject under every power that lacks it; each shard appears whole."""
    start = time.monotonic()
    if task.store is not None:  # perhaps on another machine, with a mirror of its own
        mirror = Mirror(task.store)
        mirror.path(task.shard)
        mirror.bring(f"{SUBJECTS}/{task.subject}")
        task = replace(task, base=mirror.folder)
    path = task.base / task.shard
    if not path.is_file() or file_sha256(path) != task.sha256:
        raise ShardError(f"{path} is not the file that the manifest lists; build it again")
    base = Shard(path, alone=True)
    mask = base["mask"]
    radiance = dict(zip(_SIDES, _foreground(task, base, mask), strict=True))
    shared = (time.monotonic() - start) / len(task.powers)
    camera, draw = task.config.color_camera, task.config.draw
    written = {}
    for power, target in task.powers.items():
        start = time.monotonic()
        meta = _meta(task, base, power)
        light = LightConfig(**meta["light"])
        arrays = {}
        for side in _SIDES:
            name = f"rgb_{side}"
            key = (meta["seed"], task.subject, name)
            arrays[name] = photograph(radiance[side], mask, light, camera, key, draw)
        made = write_shard(target, arrays, meta, task.config.compression, base)
        seconds = shared + time.monotonic() - start
        written[power] = ShardResult(*made, seconds, meta["licence"])
    return written


def _foreground(
    task: SweepTask, base: Shard, mask: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Of front and back, for each view: (N, 3) float32 light per watt of the mask's pixels."""
    if "radiance_front" in base:
        unit = np.float32(RADIANCE_WATTS)
        front, back = (
            [
                light[seen].astype(np.float32) / unit
                for light, seen in zip(base[f"radiance_{side}"], mask, strict=True)
            ]
            for side in _SIDES
        )
        return front, back
    pairs = [
        (front[seen], back[seen])
        for (front, back), seen in zip(_render(task, base, mask), mask, strict=True)
    ]
    return [front for front, _ in pairs], [back for _, back in pairs]


def _render(
    task: SweepTask, base: Shard, mask: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The radiance that the shard did not keep, rendered as its build did."""
    meta = base.meta
    files = {meta["mesh"]: meta["mesh_sha256"], **meta["files"]}
    for name, sha256 in files.items():
        path = task.base / name
        if not path.is_file() or file_sha256(path) != sha256:
            raise ShardError(
                f"{path} is not the file that the shard was rendered from; "
                f"build {task.base} again, or keep its light with --shards.radiance true"
            )
    subject = _subject(task, meta)
    return capture_radiance(
        subject.surface(),
        Camera.of(meta["camera"]),
        np.radians(base["yaw_deg"].astype(np.float64)),
        mask,
        tuple(meta["light"]["position"]),
        CyclesConfig(**meta["cycles"]),
        task.threads,
    )


def _subject(task: SweepTask, meta: Mapping[str, Any]) -> Subject:
    """The subject whose surface the shard shows.

    Raises:
        ShardError: its record is missing, torn, or of another surface than the shard's.
    """
    folder = subject_folder(task.base, task.subject)
    try:
        subject = read_subject(folder)
        same = subject.mesh.samefile(task.base / meta["mesh"])
        same &= np.array_equal(subject.mesh_to_world, meta["mesh_to_world"])
        same &= subject.flip_faces == meta["flip_faces"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        same = False
    if not same:
        raise ShardError(
            f"{folder / RECORD} is missing or not of the surface that the shard shows; "
            f"build {task.base} again, or keep its light with --shards.radiance true"
        )
    return subject


def _meta(task: SweepTask, base: Shard, power: float) -> dict[str, Any]:
    """The base's meta under another light; its files lie behind the link."""
    meta, record = base.meta, task.records[power]
    return {
        **meta,
        "mesh": f"{BASE}/{meta['mesh']}",
        "body": None if meta["body"] is None else f"{BASE}/{meta['body']}",
        "files": {f"{BASE}/{name}": sha256 for name, sha256 in meta.get("files", {}).items()},
        "light": {**meta["light"], "power": power, "exposure": record["exposure"]},
        "color_camera": record["color_camera"],
        "sweep": record,
        "base": {
            "shard": f"{BASE}/{task.shard}",
            "contents": base.contents,
            "sha256": task.sha256,
        },
        "versions": task.versions,
    }


def _camera_record(camera: ColorCamera | None) -> dict[str, float | int] | None:
    """JSON values that do not depend on whether 8000 was given or 8000.0."""
    if camera is None:
        return None
    whole, read = float(camera.full_well), float(camera.read_noise)
    return {"full_well": whole, "read_noise": read, "bits": camera.bits}


def _versions(kept: bool) -> dict[str, str]:
    """What the shards depend on; `kept`: every shard of the base holds its radiance."""
    names: Iterable[str] = ("numpy", "rectoverso")
    if not kept:
        names = (*names, "bpy", "openexr", "trimesh")
    found: Mapping[str, str] = {name: version(name) for name in names}
    return {"python": platform.python_version(), **found}
