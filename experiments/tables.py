"""Tables 1 to 4: methods and ablations, measured on the test subjects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments import paper
from experiments.study import GIVEN, NORMALGAN, ORACLE, OURS, Method, Study
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
    wanted = study.wanted()
    measured = {name: one for name, row in rows.items() if (one := _measured(row, wanted, columns))}
    cells = {row: [cell(of, column) for column in columns] for row, of in measured.items()}
    apart = frozenset(row for row, of in measured.items() if of.apart)
    found = Table(columns, cells, apart=apart)
    theirs = Table(columns, {row: list(map(Cell, v)) for row, v in published.items()})
    document = {
        **study.provenance(),
        "columns": list(columns),
        "rows": {
            row: {
                "seeds": of.seeds,
                "meshes": of.meshes,
                "missing": [len(wanted) - count for count in of.meshes],
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
    lacking = [
        f"{row} lacks {len(wanted) - min(of.meshes)} of them.\n"
        for row, of in measured.items()
        if min(of.meshes) < len(wanted)
    ]
    text = (
        f"{found.markdown()}\n{len(wanted)} views of {len(study.subjects)} test subjects; mean "
        f"over {len(study.config.seeds)} seeds ± half of their range. CD and P2S in hundredths of "
        "the box's side. Less is better; rows in which nothing was learned do not compete.\n"
        f"{''.join(lacking)}\n"
        f"{paper.WHERE[0].upper()}{paper.WHERE[1:]}:\n\n{theirs.markdown()}"
    )
    study.write(f"{name}.md", text)
    study.write(f"{name}.tex", f"{found.latex()}\n% {paper.WHERE}\n{theirs.latex()}")
    return text


@dataclass(frozen=True)
class Measured:
    """A row's figures on the study's views.

    Attributes:
        seeds: for each seed column -> mean.
        meshes: for each seed how many of the views have one.
    """

    seeds: list[dict[str, float]]
    meshes: list[int]
    apart: bool


def _measured(
    row: Row, wanted: Sequence[tuple[str, int]], columns: Sequence[str]
) -> Measured | None:
    """None where no mesh of the study's views was measured."""
    seeds, meshes = [], []
    for found in row.scores:
        scores = [s for s in found["scores"] if (s["subject"], s["view"]) in set(wanted)]
        if scores:
            seeds.append({c: float(np.mean([s[c] for s in scores])) for c in columns})
            meshes.append(len(scores))
    return Measured(seeds, meshes, row.apart) if seeds else None


def cell(row: Measured, column: str) -> Cell:
    """The mean over the seeds and half of their range."""
    values = [seed[column] for seed in row.seeds]
    spread = float(np.ptp(values)) / 2 if len(values) > 1 else None
    return Cell(float(np.mean(values)), spread)


TABLES: dict[str, Callable[[Study], str]] = {
    "table1": table1,
    "table2": table2,
    "table3": table3,
    "table4": table4,
}
