"""A dataset from a configuration: subjects, then shards, resumed where it stopped."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from engine.config import BuildConfig
from engine.progress import Progress
from engine.tasks import ShardResult, Task, make_shard, make_subject, versions
from engine.workers import WorkerDiedError, cpu_count, run
from render.camera import FrameError
from render.capture import CaptureError
from shards.archive import ShardError
from shards.atomic import atomic_write
from shards.dataset import SHARDS, SUBJECTS, DatasetWriter
from subjects.mesh import MeshError


def open_build(config: BuildConfig, record: dict[str, Any], output: Path) -> DatasetWriter:
    """The dataset that a build fills, or goes on to fill.

    Args:
        record: the configuration as plain JSON values, for the dataset to keep.

    Raises:
        ValueError: the source has no subjects, or `output` cannot be written, or
            holds or disturbs something else.
    """
    config.subjects.refuse_output(output)
    planned = config.subjects.ids()
    try:
        return DatasetWriter(output, record, planned, config.seed, versions(config))
    except OSError as error:
        raise ValueError(
            f"output '{output}' cannot be written ({error.strerror}); choose another folder"
        ) from error


def build(config: BuildConfig, writer: DatasetWriter, jobs: int | None) -> bool:
    """Make the shards that a dataset lacks; returns whether it has them all then.

    Args:
        jobs: worker processes; None takes one for each processor.
    """
    start = time.monotonic()
    missing = [subject for subject in writer.planned if subject not in writer.finished]
    if len(missing) < len(writer.planned):
        stand = len(writer.planned) - len(missing)
        print(f"{stand} of {len(writer.planned)} shards stand already", file=sys.stderr)
    if writer.unplanned:
        print(
            f"no longer part of the dataset: {', '.join(writer.unplanned)} "
            f"(their files in {writer.folder / SHARDS} may go)",
            file=sys.stderr,
        )
    workers = max(1, min(jobs or cpu_count(), len(missing)))
    threads = max(1, cpu_count() // workers)
    views = config.views.total
    if missing:
        people = "subject" if len(missing) == 1 else "subjects"
        print(f"{len(missing)} {people} of {views} views, {workers} workers", file=sys.stderr)
        wait = config.subjects.preparation()
        if wait is not None:
            print(wait, file=sys.stderr)
    refused = config.subjects.refused()
    for subject, reason in refused.items():
        writer.fail(subject, "subjects", reason)
    if refused:
        print(
            f"{len(refused)} set aside beforehand: {next(iter(refused.values()))}"
            + (" (and others like it)" if len(refused) > 1 else ""),
            file=sys.stderr,
        )
    dataset = writer.folder.resolve()
    _lay_papers(config, dataset)
    tasks = [
        Task(subject, dataset, writer.shard_path(subject).resolve(), config, threads)
        for subject in missing
    ]
    # Sums of one thread are the same wherever they are made.
    made = _stage("subjects", make_subject, tasks, workers, writer, threads=1)
    rendered = _stage("render", make_shard, made, workers, writer, threads, views)
    writer.finish()

    elapsed = time.monotonic() - start
    unmade = len(missing) - len(rendered)
    failures = unmade + len(refused)
    per_view = f", {elapsed / (len(rendered) * views):.2f} s per view" if rendered else ""
    print(
        f"{len(writer.planned) - unmade} shards of {views} views in {writer.folder}\n"
        f"{len(rendered)} made now in {elapsed:.0f} s{per_view}; {failures} set aside"
        + (f", see {writer.folder / 'failures.jsonl'}" if failures else "")
    )
    return failures == 0


def _lay_papers(config: BuildConfig, dataset: Path) -> None:
    """The source's licence and card, beside its subjects."""
    for name, text in config.subjects.papers().items():
        with atomic_write(dataset / SUBJECTS / name) as file:
            file.write(text.encode())


def _stage(
    name: str,
    function: Callable[[Task], ShardResult | None],
    tasks: list[Task],
    workers: int,
    writer: DatasetWriter,
    threads: int,
    views: int = 0,
) -> list[Task]:
    """Run one stage over its tasks; returns those that worked, in order.

    Every stage has worker processes of its own, so torch and Blender never share one.

    Args:
        threads: of the processor, that numerical libraries may use in a worker.
        views: that a task of this stage makes, for the progress.
    """
    if not tasks:
        return []
    progress = Progress(name, len(tasks), views)
    done = set()
    try:
        for task, result in run(function, tasks, workers, threads):
            why = None
            if isinstance(result, BaseException):
                why = reason(result)
                writer.fail(task.subject, name, why)
            else:
                done.add(task.subject)
                if isinstance(result, ShardResult):
                    writer.add(task.subject, **asdict(result))
            progress.step(task.subject, why)
    finally:
        progress.close()
    return [task for task in tasks if task.subject in done]


def reason(error: BaseException) -> str:
    """One line for the user; an error that is none of theirs brings its traceback along."""
    text = " ".join(str(error).split())
    if isinstance(
        error, (MeshError, FrameError, CaptureError, ShardError, WorkerDiedError, OSError)
    ):
        return text
    print("".join(traceback.format_exception(error)), file=sys.stderr)
    return f"a fault of the program, please report it: {type(error).__name__}: {text}"
