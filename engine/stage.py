"""One stage of the work over all its subjects: worker processes, progress, and what went wrong."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from engine.engines import Engine
from engine.progress import Progress
from engine.workers import WorkerDiedError
from render.camera import FrameError
from render.capture import CaptureError
from shards.archive import ShardError
from storage.atomic import NO_ROOM
from storage.store import StoreError
from subjects.mesh import MeshError
from surface.mesh import SurfaceError


class SubjectTask(Protocol):
    """What a stage does for one subject."""

    @property
    def subject(self) -> str:
        """Its id."""
        ...


TaskType = TypeVar("TaskType", bound=SubjectTask)


def run_stage(
    name: str,
    function: Callable[[TaskType], Any],
    tasks: list[TaskType],
    engine: Engine,
    failed: Callable[[TaskType, str], None],
    done: Callable[[TaskType, Any], None] | None = None,
    views: int = 0,
) -> list[TaskType]:
    """Run a stage over its tasks; returns those that worked, in order.

    Every stage has worker processes of its own, so torch and Blender never share one.

    Args:
        name: the stage's, for the progress.
        engine: where it runs.
        failed: called with a task and one line of why it has no result.
        done: called with a task and its result as soon as it is there, if given.
        views: that a task of this stage makes, for the progress.

    Raises:
        OSError: there is no room to write, or no store, which is no subject's fault.
    """
    if not tasks:
        return []
    progress = Progress(name, len(tasks), views)
    worked = set()
    try:
        for task, result in engine.run(function, tasks):
            why = None
            no_room = isinstance(result, OSError) and result.errno in NO_ROOM
            if no_room or isinstance(result, StoreError):
                raise result
            if isinstance(result, BaseException):
                why = reason(result)
                failed(task, why)
            else:
                if done is not None:
                    done(task, result)
                worked.add(task.subject)
            progress.step(task.subject, why)
    finally:
        progress.close()
    return [task for task in tasks if task.subject in worked]


def reason(error: BaseException) -> str:
    """One line for the user; an error that is none of theirs brings its traceback along."""
    text = " ".join(str(error).split())
    if isinstance(
        error,
        (MeshError, FrameError, CaptureError, ShardError, SurfaceError, WorkerDiedError, OSError),
    ):
        return text
    print("".join(traceback.format_exception(error)), file=sys.stderr)
    return f"a fault of the program, please report it: {type(error).__name__}: {text}"
