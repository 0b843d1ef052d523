"""The part of a page that says what was set aside, and why."""

from __future__ import annotations

from collections.abc import Sequence

from report.page.document import table


def failure_section(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """HTML of a table of what failed; a long one scrolls in a box of its own."""
    if not rows:
        return "<p>None.</p>"
    return (
        '<div class="long" tabindex="0" role="region" aria-label="Failures">'
        f"{table(head, rows)}</div>"
    )
