"""Figures 13 and 14: the trained method under twenty light powers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments import pictures
from experiments.figures import seen_truth
from experiments.study import OURS, Study
from shards.dataset import Dataset
from shards.sweep import read_index
from surface.mesh import mesh_name, read_mesh
from surface.normal_maps import castable

SHOWN = 5
"""Powers in Figure 13, from the strongest to the weakest."""

GEOMETRIC, SIDES = ("CD", "P2S", "L2"), ("L2 front", "L2 back", "L2 front, back")


def figure13(study: Study) -> str:
    """Figure 13: one subject's reconstructions under five light powers."""
    meshes = _under_powers(study)
    powers = list(meshes)
    shown = [powers[k] for k in np.linspace(0, len(powers) - 1, SHOWN).round().astype(int)]
    subject, view = study.subjects[0], study.config.sweep_views[0]
    truth = seen_truth(study, subject, view)
    placed, half = pictures.centered(truth, truth)
    rows: list[list[np.ndarray | None]] = [[], [], []]
    change = {}
    first = None
    for power in shown:
        data, folder = meshes[power]
        maps = Dataset(data).shard(subject).view(view, ["rgb_front", "mask"])
        pixels = round(half / study.dataset.shard(subject).meta["camera"]["pixel_size"])
        mesh, _ = pictures.centered(read_mesh(folder / f"{mesh_name(subject, view)}.ply"), truth)
        drawn = castable(mesh)
        rows[0].append(pictures.cut_out(maps["rgb_front"], maps["mask"], pixels))
        rows[1].append(pictures.shaded(drawn, 0, half))
        rows[2].append(pictures.shaded(drawn, 180, half))
        first = mesh.vertices if first is None else first
        # Made of the same silhouette the vertices correspond, unless a cut opened another gap.
        same = mesh.vertices.shape == first.shape
        change[f"{power:g}"] = (
            float(1000 * np.linalg.norm(mesh.vertices - first, axis=1).mean()) if same else None
        )
    rows = [[*row, None] for row in rows]
    clay = castable(placed)
    rows[1][-1], rows[2][-1] = (pictures.shaded(clay, angle, half) for angle in (0, 180))
    figure = pictures.page(
        rows,
        [*(f"{power:g} W" for power in shown), "truth"],
        ["colour", "front", "back"],
        f"{subject} under five light powers",
    )
    pictures.save(figure, study.results / "fig13.png")
    document = {
        **study.provenance(),
        "subject": subject,
        "view": view,
        "mean_vertex_change_mm": change,
    }
    study.write("fig13.json", document)
    told = ", ".join(
        f"{power} W {'another mesh' if off is None else f'{off:.2f} mm'}"
        for power, off in change.items()
    )
    return (
        f"vertices move from those of the strongest light: {told}\n{study.results / 'fig13.png'}\n"
    )


def figure14(study: Study) -> str:
    """Figure 14: all measurements under twenty light powers."""
    found: dict[float, dict[str, Any]] = {}
    for power, (data, folder) in _under_powers(study).items():
        name = f"{power:06.1f}W"
        scores = study.scores(folder, name, under=f"light_scores/{name}", data=data)
        found[power] = {key: scores["means"][key]["mean"] for key in (*GEOMETRIC, *SIDES)}
    powers = sorted(found)
    figure = Figure(figsize=(10, 4), dpi=110)
    for axis, names, title in zip(
        figure.subplots(1, 2),
        (GEOMETRIC, SIDES),
        ("(a) distances in hundredths of the box, and L2", "(b) L2 of front and back"),
        strict=True,
    ):
        for name in names:
            axis.plot(
                powers, [found[p][name] for p in powers], marker="o", markersize=3, label=name
            )
        axis.set(xlabel="power of the lamp, W", title=title, ylim=(0, None))
        axis.invert_xaxis()
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.tight_layout()
    pictures.save(figure, study.results / "fig14.png")
    study.write(
        "fig14.json",
        {
            **study.provenance(),
            "views": study.config.sweep_views,
            "powers": {f"{power:g}": found[power] for power in powers},
        },
    )
    weak, strong = found[powers[0]], found[powers[-1]]
    lines = [
        f"{key}: {strong[key]:.4f} at {powers[-1]:g} W, {weak[key]:.4f} at {powers[0]:g} W "
        f"({weak[key] / strong[key] - 1:+.1%})"
        for key in (*GEOMETRIC, *SIDES)
    ]
    return "\n".join([*lines, str(study.results / "fig14.png"), ""])


def _under_powers(study: Study) -> dict[float, tuple[Path, Path]]:
    """Power in watts -> its dataset, and the meshes made from it; strongest first."""
    seed = study.config.seeds[0]
    study.train(OURS.trainings, [seed])
    return {
        power: (
            data,
            study.meshes(
                OURS,
                seed,
                study.config.sweep_views,
                data=data,
                step=study.config.step,
                under=f"light/{data.name}",
            ),
        )
        for power, data in read_index(study.sweep()).items()
    }
