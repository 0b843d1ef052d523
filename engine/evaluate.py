"""Evaluation: a folder of meshes, by whatever method, against a dataset's surfaces."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import seeds
from engine.engines import processors
from engine.progress import Progress
from engine.stage import reason
from engine.workers import run
from shards.checksum import file_sha256
from shards.dataset import Dataset
from shards.lock import lock_folder
from shards.manifest import append_json_line, read_json_lines, write_json_lines
from storage.atomic import atomic_write
from surface.mesh import ENDINGS, SurfaceError, read_mesh
from surface.score import Convention, Score, score
from surface.table import Cell, Table
from surface.truth import SAMPLES, Truth, true_surface

PATTERNS = ("{subject}", "{subject}_{view}")
"""Of their names, one tried after the other."""

SCORES = "scores.jsonl"


@dataclass(frozen=True)
class EvaluateConfig:
    """How meshes are measured."""

    convention: Convention = "paper"
    """`paper` scales and moves each to its own box of side 1; `icon` has ICON's and ECON's scale
    and sums, of meshes in the truth's frame or with align; `metric` is in centimetres, likewise.
    """
    align: bool = False
    """First lay each mesh onto the truth by the best similarity."""
    samples: int = SAMPLES
    """Points of each surface whose distance is measured."""
    pattern: str | None = None
    """Of the files' names below the folder, without their ending, such as
    `result_{subject}_{view}_256`; by default {subject}_{view} or {subject}.
    """
    view: int | None = None
    """The view that a mesh is of whose name does not tell; by default the one turned least."""

    def __post_init__(self) -> None:
        if not 100 <= self.samples <= 10**7:
            raise ValueError(f"samples: {self.samples}; give 100 to 10000000")
        if self.pattern is not None and self.pattern.count("{subject}") != 1:
            raise ValueError(f"pattern: '{self.pattern}'; give one with {{subject}} once")
        if self.pattern is not None and self.pattern.count("{view}") > 1:
            raise ValueError(f"pattern: '{self.pattern}'; give one with {{view}} once, or without")


@dataclass(frozen=True)
class Task:
    """One mesh to be measured.

    Attributes:
        name: of the file, below the folder of meshes.
        key: of what its score depends on, hex.
        dataset: the dataset's folder.
    """

    name: str
    mesh: Path
    key: str
    dataset: Path
    subject: str
    view: int
    config: EvaluateConfig


@dataclass(frozen=True)
class Evaluation:
    """What is known of a method.

    Attributes:
        scores: file -> subject, view, and its figures.
        left_out: file -> why it is in no mean.
    """

    scores: dict[str, tuple[str, int, Score]]
    left_out: dict[str, str]

    def mean(self, convention: Convention) -> dict[str, Cell]:
        """Figure -> its mean over the meshes and its standard deviation."""
        figures = [found.figures(convention) for _, _, found in self.scores.values()]
        names = figures[0] if figures else {}
        return {
            name: Cell(
                float(np.mean([f[name] for f in figures])),
                float(np.std([f[name] for f in figures])),
            )
            for name in names
        }

    def told(self, convention: Convention) -> str:
        """The means in a table, and how many meshes are in them."""
        means = self.mean(convention)
        width = max((len(name) for name in means), default=0)
        lines = [f"{name:{width}}  {cell.text(4)}" for name, cell in means.items()]
        subjects = len({subject for subject, _, _ in self.scores.values()})
        lines.append(
            f"{len(self.scores)} meshes of {subjects} subjects measured, "
            f"{len(self.left_out)} left out"
        )
        return "\n".join(lines)


def find_meshes(
    folder: Path, dataset: Dataset, pattern: str | None, view: int | None
) -> tuple[dict[str, tuple[str, int]], dict[str, str]]:
    """Which mesh is of which view.

    Returns:
        file below the folder -> subject and view, and file -> why it is of none.

    Raises:
        ValueError: there is no mesh in the folder.
    """
    files = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.suffix.lower() in ENDINGS and path.is_file() and not path.name.startswith(".")
    )
    if not files:
        raise ValueError(f"{folder} holds no mesh; there have to be files of {', '.join(ENDINGS)}")
    ids = "|".join(re.escape(s) for s in sorted(dataset.subjects(), key=len, reverse=True))
    forms = [
        re.escape(form)
        .replace(re.escape("{subject}"), f"(?P<subject>{ids})")
        .replace(re.escape("{view}"), r"(?P<view>\d+)")
        for form in ((pattern,) if pattern else PATTERNS)
    ]
    found: dict[str, tuple[str, int]] = {}
    unknown: dict[str, str] = {}
    for file in files:
        stem = file[: file.rindex(".")]
        matches = [match for form in forms if (match := re.fullmatch(form, stem))]
        if not matches:
            unknown[file] = "its name is of no subject of the dataset; set pattern"
            continue
        subject, numbered = matches[0]["subject"], matches[0].groupdict().get("view")
        shard = dataset.shard(subject)
        given = view if numbered is None else int(numbered)
        index = int(np.abs(shard["yaw_deg"]).argmin()) if given is None else given
        if not 0 <= index < len(shard):
            unknown[file] = f"{subject} has views 0 to {len(shard) - 1}, not {index}"
        elif (subject, index) in found.values():
            unknown[file] = f"another file is of view {index} of {subject} too"
        else:
            found[file] = (subject, index)
    return found, unknown


def evaluate(
    data: Path,
    meshes: Path,
    output: Path,
    name: str,
    config: EvaluateConfig,
    jobs: int | None = None,
    subjects: Iterable[str] | None = None,
) -> Evaluation:
    """Measure every mesh of a folder, write NAME.json, .csv, .md and .tex, and tell the means.

    Scores that stand in the output's folder and are of the same files are not measured anew.

    Args:
        data: folder of the dataset.
        meshes: folder of the meshes, in the frame of the camera that saw the view (x right, y up, z
            towards the viewer).
        output: folder of what is written.
        name: the method's.
        jobs: worker processes; None takes one for each processor.
        subjects: only meshes of these.

    Raises:
        ValueError: the dataset, the meshes or the output cannot be used.
    """
    if not re.fullmatch(r"[\w][\w .+-]*", name):
        raise ValueError(f"name: '{name}'; use letters, digits, spaces, '.', '_', '+' and '-'")
    if not meshes.is_dir():
        raise ValueError(f"{meshes} is no folder of meshes")
    dataset = Dataset(data)
    found, left_out = find_meshes(meshes, dataset, config.pattern, config.view)
    if subjects is not None:
        chosen = set(subjects)
        if unknown := chosen - set(dataset.subjects()):
            raise ValueError(f"subjects: {data} has no finished {', '.join(sorted(unknown))}")
        found = {file: view for file, view in found.items() if view[0] in chosen}
        if not found:
            raise ValueError(f"{meshes} holds no mesh of the subjects that are asked for")
    output.mkdir(parents=True, exist_ok=True)
    with lock_folder(output):
        tasks = [
            Task(
                file,
                meshes / file,
                _key(meshes / file, dataset, *view, config),
                data,
                *view,
                config,
            )
            for file, view in found.items()
        ]
        scores, faults = _measured(tasks, output / SCORES, jobs)
        whole = Evaluation(scores, {**left_out, **faults})
        _write(whole, name, config, dataset, meshes, output)
    return whole


def _measured(
    tasks: list[Task], kept: Path, jobs: int | None
) -> tuple[dict[str, tuple[str, int, Score]], dict[str, str]]:
    """Every task's score, and why some have none."""
    names = [field.name for field in fields(Score)]
    known = {
        record["key"]: record
        for _, record in read_json_lines(kept)
        if {"key", *names} <= record.keys()
    }
    missing = [task for task in tasks if task.key not in known]
    if len(missing) < len(tasks):
        print(f"{len(tasks) - len(missing)} of {len(tasks)} scores stand", file=sys.stderr)
    faults: dict[str, str] = {}
    if missing:
        write_json_lines(kept, known.values())  # a torn last line would spoil the next
        progress = Progress("evaluate", len(missing))
        try:
            for task, result in run(measure, missing, processors(jobs, len(missing))[0]):
                why = None
                if isinstance(result, BaseException):
                    why = faults[task.name] = reason(result)
                else:
                    known[task.key] = {"key": task.key, **asdict(result)}
                    append_json_line(kept, known[task.key])
                progress.step(task.name, why)
        finally:
            progress.close()
    scores = {
        task.name: (
            task.subject,
            task.view,
            Score(**{name: known[task.key][name] for name in names}),
        )
        for task in tasks
        if task.key in known
    }
    return scores, faults


def measure(task: Task) -> Score:
    """One mesh's score.

    Raises:
        SurfaceError: the mesh, or the subject's own, cannot be measured.
    """
    mesh = read_mesh(task.mesh)
    truth = _truth(task.dataset, task.subject, task.config.samples)
    shard = Dataset(task.dataset).shard(task.subject)
    to_camera = np.linalg.inv(shard["camera_to_world"][task.view])
    rng = seeds.generator(0, task.subject, "evaluate", task.view)
    config = task.config
    return score(
        mesh, truth.transformed(to_camera), rng, config.convention, config.align, config.samples
    )


@lru_cache(maxsize=1)
def _truth(data: Path, subject: str, samples: int) -> Truth:
    """A subject's surface in its world; tasks come by subject, so the last one is enough."""
    dataset = Dataset(data)
    try:
        mesh = true_surface(dataset, subject)
        return Truth.of(mesh, seeds.generator(0, subject, "truth"), samples)
    except SurfaceError as error:
        raise SurfaceError(f"{subject}'s own surface: {error}") from None


def _key(mesh: Path, dataset: Dataset, subject: str, view: int, config: EvaluateConfig) -> str:
    """What a score depends on."""
    counted = {"convention": config.convention, "align": config.align, "samples": config.samples}
    parts = [file_sha256(mesh), dataset.manifest[subject].sha256, view, counted]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _write(
    whole: Evaluation,
    name: str,
    config: EvaluateConfig,
    dataset: Dataset,
    meshes: Path,
    output: Path,
) -> None:
    means = whole.mean(config.convention)
    rows: list[dict[str, Any]] = [
        {"mesh": file, "subject": subject, "view": view, **found.figures(config.convention)}
        for file, (subject, view, found) in sorted(whole.scores.items())
    ]
    document: dict[str, Any] = {
        "method": name,
        "meshes": str(meshes),
        "data": str(dataset.folder),
        "data_config_sha256": dataset.description["config_sha256"],
        "options": asdict(config),
        "counts": {
            "measured": len(rows),
            "subjects": len({row["subject"] for row in rows}),
            "left_out": len(whole.left_out),
        },
        "left_out": dict(sorted(whole.left_out.items())),
        "means": {figure: asdict(cell) for figure, cell in means.items()},
        "subjects": {
            subject: {
                figure: float(np.mean([row[figure] for row in rows if row["subject"] == subject]))
                for figure in means
            }
            for subject in sorted({row["subject"] for row in rows})
        },
        "scores": rows,
    }
    table = Table(list(means), {name: list(means.values())} if means else {})
    texts = {
        "json": json.dumps(document, indent=1, allow_nan=False) + "\n",
        "csv": _csv(rows),
        "md": table.markdown(),
        "tex": table.latex(),
    }
    for ending, text in texts.items():
        with atomic_write(output / f"{name}.{ending}") as file:
            file.write(text.encode())


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()
