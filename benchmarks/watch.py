"""Seconds of every render call in whatever process of a command: nothing of it is changed.

A command that is run in the environment of `watching` imports a `sitecustomize` that has Python
hand `render.scene` another `bpy`, whose `ops.render.render` is timed. Every call is a line of a
file of its process.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

FOLDER = "RECTOVERSO_WATCH"
"""The environment's variable that says where the lines go."""
WATCHED = "render.scene"


def watching(folder: Path) -> dict[str, str]:
    """The environment of a command whose render calls are written to `folder`, an empty one."""
    (folder / "sitecustomize.py").write_text("from benchmarks.watch import Watch\nWatch()\n")
    paths = [str(folder), str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, FOLDER: str(folder), "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def seconds_watched(folder: Path) -> list[float]:
    """Of every render call, all processes together."""
    lines = (path.read_text().split() for path in folder.glob("*.seconds"))
    return [float(line) for process in lines for line in process]


class Watch:
    """Times the render calls of this process, from the import of `render.scene` on."""

    def __init__(self) -> None:
        self._path = Path(os.environ[FOLDER]) / f"{os.getpid()}.seconds"
        sys.meta_path.insert(0, self)  # type: ignore[arg-type]

    def find_spec(self, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """As `importlib.abc.MetaPathFinder`: the module's own, with something done after it."""
        if name != WATCHED:
            return None
        sys.meta_path.remove(self)  # type: ignore[arg-type]
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert spec.loader is not None
        run = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            run(module)
            bpy = module.bpy
            timed = StandIn(bpy.ops.render, render=self._timed(bpy.ops.render.render))
            module.bpy = StandIn(bpy, ops=StandIn(bpy.ops, render=timed))

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec

    def _timed(self, call: Callable) -> Callable:
        def timed(*arguments: Any, **named: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                with self._path.open("a") as file:
                    file.write(f"{time.perf_counter() - start:.6f}\n")

        return timed


class StandIn:
    """Another object, but for some attributes."""

    def __init__(self, real: Any, **own: Any) -> None:
        self.__dict__.update(own)
        self._real = real

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)
