"""A dataset from a configuration: subjects, then shards, resumed where it stopped."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from typing import Any

from engine.config import BuildConfig
from engine.engines import Engine, Means
from engine.stage import run_stage
from engine.tasks import (
    ShardResult,
    Task,
    make_both,
    make_shard,
    make_subject,
    stage_of,
    versions,
)
from shards.dataset import SHARDS, SUBJECTS, DatasetWriter
from storage.mirror import Mirror, builds
from storage.store import StoreError, is_url, local_path


def open_build(config: BuildConfig, record: dict[str, Any], output: str) -> DatasetWriter:
    """The dataset that a build fills, or goes on to fill.

    Args:
        record: the configuration as plain JSON values, for the dataset to keep.
        output: its folder, or its URL in a store.

    Raises:
        ValueError: the source has no subjects, or `output` cannot be written, or
            holds or disturbs something else.
        StoreError: the store cannot be had.
    """
    mirror = Mirror(output, builds()) if is_url(output) else None
    folder = local_path(output) if mirror is None else mirror.folder
    config.subjects.refuse_output(folder)
    planned = config.subjects.ids()
    made = versions(config)
    try:
        return DatasetWriter(folder, record, planned, config.seed, made, mirror=mirror)
    except StoreError:
        raise
    except OSError as error:
        raise ValueError(
            f"output '{output}' cannot be written ({error.strerror}); choose another folder"
        ) from error


def build(config: BuildConfig, writer: DatasetWriter, means: Means) -> bool:
    """Make the shards that a dataset lacks; returns whether it has them all then.

    Args:
        means: to do it with.

    Raises:
        OSError: there is no room to write, or no store.
        EngineError: `means` cannot be had.
    """
    start = time.monotonic()
    missing = [subject for subject in writer.planned if subject not in writer.finished]
    if len(missing) < len(writer.planned):
        stand = len(writer.planned) - len(missing)
        print(f"{stand} of {len(writer.planned)} shards stand already", file=sys.stderr)
    if writer.unplanned:
        print(
            f"no longer part of the dataset: {', '.join(writer.unplanned)} "
            f"(their files in {writer.place}/{SHARDS} may go)",
            file=sys.stderr,
        )
    views = config.views.total
    refused = config.subjects.refused()
    for subject, why in refused.items():
        writer.fail(subject, "subjects", why)
    if refused:
        print(
            f"{len(refused)} set aside beforehand: {next(iter(refused.values()))}"
            + (" (and others like it)" if len(refused) > 1 else ""),
            file=sys.stderr,
        )
    for name, text in config.subjects.papers().items():
        writer.lay(f"{SUBJECTS}/{name}", text.encode())
    rendered = 0
    if missing:
        shared = writer.mirror is None
        with means.open(len(missing), writer.folder, shared) as engine:
            people = "subject" if len(missing) == 1 else "subjects"
            print(
                f"{len(missing)} {people} of {views} views, {engine.workers} workers",
                file=sys.stderr,
            )
            wait = config.subjects.preparation()
            if wait is not None:
                print(wait, file=sys.stderr)
            rendered = _made(config, writer, missing, engine)
    writer.finish()

    elapsed = time.monotonic() - start
    unmade = len(missing) - rendered
    failures = unmade + len(refused)
    per_view = f", {elapsed / (rendered * views):.2f} s per view" if rendered else ""
    print(
        f"{len(writer.planned) - unmade} shards of {views} views in {writer.place}\n"
        f"{rendered} made now in {elapsed:.0f} s{per_view}; {failures} set aside"
        + (f", see {writer.place}/failures.jsonl" if failures else "")
    )
    return failures == 0


def _made(config: BuildConfig, writer: DatasetWriter, subjects: list[str], engine: Engine) -> int:
    """Make the shards of these subjects; returns how many there are then."""
    dataset = writer.folder.resolve()
    store = None if writer.mirror is None else writer.mirror.store.url
    tasks = [
        Task(subject, dataset, writer.shard_path(subject).resolve(), config, engine.threads, store)
        for subject in subjects
    ]

    def fail(task: Task, why: str) -> None:
        writer.fail(task.subject, stage_of(task), why)

    def add(task: Task, shard: ShardResult) -> None:
        writer.add(task.subject, **asdict(shard))

    make = make_both
    if config.subjects.loads_torch:
        tasks = run_stage("subjects", make_subject, tasks, engine, fail)
        make = make_shard
    views = config.views.total
    return len(run_stage("render", make, tasks, engine, fail, add, views))
