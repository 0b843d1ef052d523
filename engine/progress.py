"""What a person sees while a build runs."""

from __future__ import annotations

import sys
import time
from typing import TextIO

from tqdm import tqdm

_BAR = "{desc} {bar} {n_fmt}/{total_fmt} {unit}, {remaining} left{postfix}"


class Progress:
    """Subjects done, views per second, time left: a bar on a terminal, lines elsewhere."""

    def __init__(
        self, what: str, total: int, views_per_subject: int = 0, stream: TextIO | None = None
    ) -> None:
        """Args:
        what: the stage, such as "rendering".
        total: subjects to do.
        views_per_subject: 0 where the stage has no views.
        """
        self._what, self._total, self._views = what, total, views_per_subject
        self._stream = stream or sys.stderr
        self._done = 0
        self._start = time.monotonic()
        self._bar = (
            tqdm(
                total=total,
                desc=what,
                unit="subject" if total == 1 else "subjects",
                file=self._stream,
                leave=False,
                bar_format=_BAR,
                mininterval=0,
            )
            if self._stream.isatty()
            else None
        )

    def step(self, subject: str, failure: str | None = None) -> None:
        """Another subject is done, or set aside for the reason `failure`."""
        self._done += 1
        elapsed = time.monotonic() - self._start
        left = elapsed / self._done * (self._total - self._done)
        rate = f"{self._done * self._views / elapsed:.1f} views/s" if self._views else ""
        if failure is not None:
            tqdm.write(f"  set aside {subject}: {failure}", file=self._stream)
        if self._bar is not None:
            self._bar.set_postfix_str(rate, refresh=False)
            self._bar.update()
        elif failure is None:
            parts = [
                f"{self._what} {self._done}/{self._total}",
                subject,
                rate,
                f"{left:.0f} s left",
            ]
            print("  " + ", ".join(part for part in parts if part), file=self._stream, flush=True)

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.close()
