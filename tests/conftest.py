"""What the tests share: real worker processes, so that Blender never enters this one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

from engine.workers import run


def call(function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """`function`'s result from a fresh worker process; its exception is raised here."""
    ((_, result),) = run(partial(_call, function, named), [arguments], jobs=1)
    if isinstance(result, BaseException):
        raise result
    return result


def _call(function: Callable[..., Any], named: dict[str, Any], arguments: tuple) -> Any:
    return function(*arguments, **named)


@pytest.fixture(scope="session")
def in_worker() -> Iterator[Callable[..., Any]]:
    """Calls a function of the project in a process that may import Blender."""
    return call
