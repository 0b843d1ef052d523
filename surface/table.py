"""A table of figures, for a page and for a paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_ESCAPED = {c: f"\\{c}" for c in "&%$#_{}"} | {"±": "$\\pm$", "~": "\\textasciitilde{}"}


@dataclass(frozen=True)
class Cell:
    """A figure.

    Attributes:
        mean: of it; None where there is nothing.
        spread: what stands behind ±, or None.
    """

    mean: float | None
    spread: float | None = None

    def text(self, digits: int) -> str:
        if self.mean is None:
            return "-"
        spread = "" if self.spread is None else f" ± {self.spread:.{digits}f}"
        return f"{self.mean:.{digits}f}{spread}"


@dataclass(frozen=True)
class Table:
    """Rows of figures of which less is better; the least of each column stands out.

    Attributes:
        columns: their names.
        rows: name -> a cell for each column.
        digits: behind the point.
        apart: names of rows that do not compete, such as a bound.
    """

    columns: Sequence[str]
    rows: Mapping[str, Sequence[Cell]]
    digits: int = 4
    apart: frozenset[str] = frozenset()

    def markdown(self) -> str:
        """GitHub's flavour."""
        lines = [
            "| | " + " | ".join(self.columns) + " |",
            "|---" + "|---:" * len(self.columns) + "|",
        ]
        for name, cells in self.rows.items():
            texts = [
                f"**{cell.text(self.digits)}**" if self._best(k, name) else cell.text(self.digits)
                for k, cell in enumerate(cells)
            ]
            lines.append(f"| {name} | " + " | ".join(texts) + " |")
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """A tabular, with booktabs."""
        lines = [
            "\\begin{tabular}{l" + "r" * len(self.columns) + "}",
            "\\toprule",
            " & ".join(["", *map(_tex, self.columns)]) + " \\\\",
            "\\midrule",
        ]
        for name, cells in self.rows.items():
            texts = [
                f"\\textbf{{{_tex(cell.text(self.digits))}}}"
                if self._best(k, name)
                else _tex(cell.text(self.digits))
                for k, cell in enumerate(cells)
            ]
            lines.append(" & ".join([_tex(name), *texts]) + " \\\\")
        return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"

    def _best(self, column: int, name: str) -> bool:
        """Whether a row has the least of a column, of two rows that compete or more."""
        means = {
            row: mean
            for row, cells in self.rows.items()
            if row not in self.apart and (mean := cells[column].mean) is not None
        }
        return len(means) > 1 and name in means and means[name] == min(means.values())


def _tex(text: str) -> str:
    return "".join(_ESCAPED.get(letter, letter) for letter in text)
