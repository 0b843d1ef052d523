"""Tables 1 to 4: methods and ablations, measured on the test subjects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import paper
from experiments.study import GIVEN, NORMALGAN, ORACLE, OURS, Method, Study
from shards.atomic import atomic_write
from surface.table import Cell, Table

ORACLE_ROW, GIVEN_ROW = "oracle: true depths fused", "given: sensor and bare body fused"
NORMALGAN_ROW, OURS_ROW = "NormalGAN's way, trained here", "the paper's way, trained here"


@dataclass(frozen=True)
class Row:
    """A row of a table: one score for each seed.

    Attributes:
        scores: what `evaluate` wrote of each.
        apart: whether it does not compete: a bound, or what the others start from.
    """

    scores: Sequence[Mapping[str, Any]]
    apart: bool = False


def table1(study: Study) -> str:
    """Table 1: CD, P2S and L2 of all methods."""
    return _report(study, "table1", _all_methods(study), ("CD", "P2S", "L2"), paper.TABLE1)


def table2(study: Study) -> str:
    """Table 2: L2 of fronts and backs of all methods."""
    columns = ("L2 front", "L2 back", "L2 front, back")
    return _report(study, "table2", _all_methods(study), columns, paper.TABLE2)


def table3(study: Study) -> str:
    """Table 3: three ways to denoise the front, each with the same back."""
    fronts = {
        "U-Net": "front_unet",
        "U-Net+nGAN": "front_unet_ngan",
        "U-Net+CA": "front_unet_ca",
    }
    methods = {name: Method(front, OURS.back) for name, front in fronts.items()}
    columns = ("L2 front", "CD", "P2S", "L2")
    return _report(study, "table3", _rows(study, methods), columns, paper.TABLE3)


def table4(study: Study) -> str:
    """Table 4: three ways to the back, each with the same front."""
    backs = {
        "nGAN": "back_ngan",
        "SMPL+dGAN": "back_smpl_dgan",
        "SMPL+nGAN": "back_smpl_ngan",
    }
    methods = {name: Method(OURS.front, back) for name, back in backs.items()}
    columns = ("L2 back", "CD", "P2S", "L2")
    return _report(study, "table4", _rows(study, methods), columns, paper.TABLE4)


def _all_methods(study: Study) -> dict[str, Row]:
    """Those that are trained here, what bounds them, and others whose meshes are there."""
    rows = _rows(study, {NORMALGAN_ROW: NORMALGAN, OURS_ROW: OURS})
    for name, method in ((GIVEN_ROW, GIVEN), (ORACLE_ROW, ORACLE)):
        rows[name] = Row([scored(study, method, study.config.seeds[0])], apart=True)
    others = {name: Row([study.scores(folder, name)]) for name, folder in study.others().items()}
    return {**others, **rows}


def _rows(study: Study, methods: Mapping[str, Method]) -> dict[str, Row]:
    study.train(name for method in methods.values() for name in method.trainings)
    return {
        name: Row([scored(study, method, seed) for seed in study.config.seeds])
        for name, method in methods.items()
    }


def scored(study: Study, method: Method, seed: int) -> dict[str, Any]:
    """A method's score on the test subjects."""
    meshes = study.meshes(method, seed, study.config.views, step=study.config.step)
    return study.scores(meshes, study.label(method, seed))


def _report(
    study: Study,
    name: str,
    rows: Mapping[str, Row],
    columns: Sequence[str],
    published: Mapping[str, Sequence[float]],
) -> str:
    """Write a table as JSON, Markdown and LaTeX; the Markdown."""
    measured = {row: of for row, of in rows.items() if any(s["means"] for s in of.scores)}
    cells = {row: [cell(of, column) for column in columns] for row, of in measured.items()}
    apart = frozenset(row for row, of in measured.items() if of.apart)
    found = Table(columns, cells, apart=apart)
    theirs = Table(columns, {row: list(map(Cell, v)) for row, v in published.items()})
    document = {
        **study.provenance(),
        "columns": list(columns),
        "rows": {
            row: {
                "seeds": [
                    {c: s["means"][c]["mean"] for c in columns} for s in of.scores if s["means"]
                ],
                "meshes": [s["counts"]["measured"] for s in of.scores],
                "left_out": [s["counts"]["left_out"] for s in of.scores],
                "competes": not of.apart,
            }
            for row, of in measured.items()
        },
        "order": {
            c: sorted((r for r in measured if r not in apart), key=lambda r: cells[r][k].mean or 0)
            for k, c in enumerate(columns)
        },
        "published": {"where": paper.WHERE, "rows": {r: list(v) for r, v in published.items()}},
    }
    study.write(f"{name}.json", document)
    count = max((s["counts"]["measured"] for of in measured.values() for s in of.scores), default=0)
    text = (
        f"{found.markdown()}\n{count} views of {len(study.subjects)} test subjects; mean over "
        f"{len(study.config.seeds)} seeds ± half of their range. CD and P2S in hundredths of the "
        f"box's side. Less is better; rows in which nothing was learned do not compete.\n\n"
        f"{paper.WHERE[0].upper()}{paper.WHERE[1:]}:\n\n{theirs.markdown()}"
    )
    _write(study.results / f"{name}.md", text)
    latex = f"{found.latex()}\n% {paper.WHERE}\n{theirs.latex()}"
    _write(study.results / f"{name}.tex", latex)
    return text


def cell(row: Row, column: str) -> Cell:
    """The mean over the seeds and half of their range."""
    values = [s["means"][column]["mean"] for s in row.scores if s["means"]]
    spread = float(np.ptp(values)) / 2 if len(values) > 1 else None
    return Cell(float(np.mean(values)), spread)


def _write(path: Path, text: str) -> None:
    with atomic_write(path) as file:
        file.write(text.encode())


TABLES: dict[str, Callable[[Study], str]] = {
    "table1": table1,
    "table2": table2,
    "table3": table3,
    "table4": table4,
}
