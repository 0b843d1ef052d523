"""The HTML file: everything that it needs is in it, and it may fetch nothing."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from plotly.offline import get_plotlyjs

from storage.files import open_file

# A page fetches nothing, whatever a subject's name or a reason may hold.
_POLICY = (
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
)


def document(
    title: str,
    body: str,
    records: Mapping[str, Any] | None = None,
    script: str | None = None,
) -> str:
    """A whole page.

    Args:
        title: of the page, as text.
        body: HTML.
        records: id -> JSON-ready value, which the script reads when it needs it.
        script: a file beside this one, that makes the page answer; plotly comes with it.
    """
    parts = [
        "<!doctype html>",
        '<html lang="en">',
        "<head>",
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        f"<title>{escape(title)}</title>",
        f"<style>{_asset('page.css')}</style>",
        "</head>",
        f"<body>{body}",
    ]
    parts += [
        f'<script type="application/json" id="{escape(name)}">{_inert(value)}</script>'
        for name, value in (records or {}).items()
    ]
    if script is not None:
        # As text: a browser takes a third of a second to read it, and only what is drawn needs it.
        parts.append(f'<script type="text/plain" id="plotly">{_closed(get_plotlyjs())}</script>')
        parts.append(f"<script>{_asset('plot.js')}\n{_asset(script)}</script>")
    return "\n".join([*parts, "</body></html>", ""])


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = "") -> str:
    """An HTML table of text; numbers stand to the right."""
    lines = ['<div class="wide"><table>']
    if caption:
        lines.append(f"<caption>{escape(caption)}</caption>")
    if head:
        cells = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in head)
        lines.append(f"<thead><tr>{cells}</tr></thead>")
    lines.append("<tbody>")
    for first, *rest in rows:
        cells = "".join(f'<td class="{_kind(cell)}">{_cell(cell)}</td>' for cell in rest)
        lines.append(f'<tr><th scope="row">{escape(str(first))}</th>{cells}</tr>')
    return "\n".join([*lines, "</tbody></table></div>"])


def embedded(picture: Path, words: str) -> str:
    """A PNG file as an element that holds it; `words` say what it shows."""
    with open_file(picture) as file:
        data = base64.b64encode(file.read()).decode()
    return f'<img class="picture" src="data:image/png;base64,{data}" alt="{escape(words)}">'


def section(title: str, name: str, body: str) -> str:
    """A part of the page under a heading that can be linked to."""
    name = escape(name)
    return (
        f'<section id="{name}" aria-labelledby="{name}-title">'
        f'<h2 id="{name}-title">{escape(title)}</h2>{body}</section>'
    )


def _kind(value: Any) -> str:
    return "number" if isinstance(value, int | float) else "text"


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else escape(str(value))


def _inert(value: Any) -> str:
    """JSON that cannot end the element it stands in."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def _closed(script: str) -> str:
    """A script that cannot end its element either."""
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def _asset(name: str) -> str:
    return files("report.page").joinpath(name).read_text(encoding="utf-8")
