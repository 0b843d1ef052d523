"""A dataset from a configuration: subjects, then shards, resumed where it stopped."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from engine.config import BuildConfig
from engine.progress import Progress
from engine.tasks import ShardResult, Task, make_shard, make_subject
from engine.workers import cpu_count, run
from shards.dataset import DatasetWriter


def build(config: BuildConfig, record: dict[str, Any], output: Path, jobs: int | None) -> bool:
    """Build the dataset at `output`, or what is missing of it.

    Args:
        record: the configuration as plain JSON values, for the dataset to keep.
        jobs: worker processes; None takes one for each processor.

    Returns:
        Whether every subject has its shard.

    Raises:
        ValueError: the source has no subjects, or `output` holds something else.
    """
    start = time.monotonic()
    config.subjects.refuse_output(output)
    planned = config.subjects.ids()
    writer = DatasetWriter(output, record, planned, config.seed)
    finished = set(writer.finished)
    missing = [subject for subject in planned if subject not in finished]
    if finished:
        print(f"{len(finished)} of {len(planned)} shards stand already", file=sys.stderr)
    dataset = output.resolve()
    tasks = [
        Task(subject, dataset, writer.shard_path(subject).resolve(), config, threads=1)
        for subject in missing
    ]
    made, failed = _stage("subjects", make_subject, tasks, jobs, writer)
    views = config.views.total
    rendered, broken = _stage("render", make_shard, made, jobs, writer, views)
    writer.finish()

    elapsed = time.monotonic() - start
    failures = failed + broken
    per_view = f", {elapsed / (len(rendered) * views):.2f} s per view" if rendered else ""
    print(
        f"{len(planned) - failures} shards of {views} views in {output}\n"
        f"{len(rendered)} made now in {elapsed:.0f} s{per_view}; "
        f"{failures} set aside" + (f", see {output / 'failures.jsonl'}" if failures else "")
    )
    return failures == 0


def _stage(
    name: str,
    function: Callable[[Task], ShardResult | None],
    tasks: list[Task],
    jobs: int | None,
    writer: DatasetWriter,
    views: int = 0,
) -> tuple[list[Task], int]:
    """Run one stage over its tasks; returns those that worked, in order, and a count of failures.

    Every stage has worker processes of its own, so torch and Blender never share one.
    """
    if not tasks:
        return [], 0
    workers = min(jobs or cpu_count(), len(tasks))
    threads = max(1, cpu_count() // workers)
    tasks = [replace(task, threads=threads) for task in tasks]
    progress = Progress(name, len(tasks), views)
    done, failures = set(), 0
    try:
        for task, result in run(function, tasks, workers, threads):
            reason = _reason(result) if isinstance(result, BaseException) else None
            if reason is not None:
                failures += 1
                writer.fail(task.subject, name, reason)
            else:
                done.add(task.subject)
                if isinstance(result, ShardResult):
                    writer.add(
                        task.subject,
                        result.bytes,
                        result.sha256,
                        result.seconds,
                        result.licence,
                        result.versions,
                    )
            progress.step(task.subject, reason)
    finally:
        progress.close()
    return [task for task in tasks if task.subject in done], failures


def _reason(error: BaseException) -> str:
    """One line for the user; an error that is no message to users names its kind as well."""
    text = " ".join(str(error).split())
    expected = isinstance(error, (ValueError, OSError, RuntimeError))
    return text if expected and text else f"{type(error).__name__}: {text}"
