"""How much memory a piece of work holds at most, the processes that it starts included."""

from __future__ import annotations

import threading
from types import TracebackType

import psutil

INTERVAL = 0.2
"""Seconds between two looks."""


class PeakMemory:
    """Watches this process and its children while the block runs.

    The kernel's own high-water marks do not serve: a child's begins at its parent's, and two
    processes' need not be of one moment.

    Attributes:
        megabytes: resident memory of all together, the highest that was seen.
    """

    def __init__(self) -> None:
        self.megabytes = 0
        self._process = psutil.Process()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> PeakMemory:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        while True:
            held = self._process.memory_info().rss
            for child in self._process.children(recursive=True):
                try:
                    # Until it starts its own program a child shows the memory of its parent. The
                    # program is asked for first, or it might start between the two answers.
                    if child.cmdline() != child.parent().cmdline():
                        held += child.memory_info().rss
                except (psutil.Error, AttributeError):  # it or its parent ended meanwhile
                    continue
            self.megabytes = max(self.megabytes, round(held / 1e6))
            if self._ended.wait(INTERVAL):
                return
