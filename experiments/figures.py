"""Figures 2, 9 and 15: fronts against backs, where surfaces are off, what a cut saves."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments import paper, pictures
from experiments.study import NORMALGAN, OURS, Method, Study
from experiments.tables import NORMALGAN_ROW, OURS_ROW
from report import differences
from surface.distances import nearest, sample
from surface.mesh import TriangleMesh, mesh_name, read_mesh
from surface.normal_maps import castable
from surface.score import unit_box
from surface.truth import true_surface

SHOWN = 3
"""Test subjects in the figure of error maps."""

MOST = 0.03
"""Metres of error at which its colours end."""


def figure2(study: Study) -> str:
    """Figure 2: how much front and back differ in depth, each subject in its view turned least."""
    found = differences.compare(study.dataset, view=None)
    easiest = max(found, key=lambda c: (c.whole.up_to_40, -c.whole.largest))
    hardest = max(found, key=lambda c: (c.whole.above_100, c.whole.largest))
    whole = differences.pooled([c.whole for c in found])
    shown = [differences.example(study.dataset, c, differences.CHEST) for c in (easiest, hardest)]
    picture = study.results / "fig2.png"
    differences.figure(shown[0], shown[1], whole, len(found)).save(picture)
    hard = [c.whole for c in found if c.hard]
    much = sum(s.above_100 >= differences.MUCH for s in hard)
    document = {
        "data_config_sha256": study.dataset.description["config_sha256"],
        "views": {c.subject: c.view for c in found},
        "bins_mm": list(differences.BINS),
        "all": _shares(whole),
        "easiest": {"subject": easiest.subject, "pose": easiest.pose, **_shares(easiest.whole)},
        "hardest": {"subject": hardest.subject, "pose": hardest.pose, **_shares(hardest.whole)},
        "rows": {e.comparison.subject: {"row": e.row, **_shares(e.local)} for e in shown},
        "subjects": {
            c.subject: {"pose": c.pose, "hard": c.hard, **_shares(c.whole)} for c in found
        },
        "published": {"where": paper.WHERE, **paper.FIGURE2},
    }
    study.write("fig2.json", document)
    return (
        f"easiest, {easiest.subject} ({easiest.pose}): {easiest.whole.up_to_40:.1%} of the pixels "
        f"up to 40 mm\nhardest, {hardest.subject} ({hardest.pose}): "
        f"{hardest.whole.above_100:.1%} above 100 mm\n"
        f"{much} of {len(hard)} subjects in hard poses have a quarter or more above 100 mm\n"
        f"{paper.WHERE}: {paper.FIGURE2['easy_up_to_40_mm']:.1%} up to 40 mm of one easy image, "
        f"{paper.FIGURE2['hard_above_100_mm']:.1%} above 100 mm of one hard one\n{picture}\n"
    )


def figure9(study: Study) -> str:
    """Figure 9: where the surfaces of each method are off, from the front and from behind."""
    seed = study.config.seeds[0]
    study.train([*NORMALGAN.trainings, *OURS.trainings], [seed])
    methods = {NORMALGAN_ROW: NORMALGAN, OURS_ROW: OURS}
    folders = {
        name: study.meshes(method, seed, study.config.views, step=study.config.step)
        for name, method in methods.items()
    }
    view = 0 if study.config.views is None else study.config.views[0]
    rows: list[list[np.ndarray | None]] = []
    others = study.others()
    means: dict[str, dict[str, Any]] = {name: {} for name in (*methods, *others)}
    subjects = study.subjects[:SHOWN]
    for subject in subjects:
        truth = seen_truth(study, subject, view)
        placed, half = pictures.centered(truth, truth)
        clay = castable(placed)
        row: list[np.ndarray | None] = [pictures.shaded(clay, angle, half) for angle in (0, 180)]
        for name, folder in folders.items():
            mesh, _ = pictures.centered(read_mesh(_mesh(folder, subject, view)), truth)
            row += _errors(mesh, placed, half, means[name].setdefault(subject, {}))
        for name, folder in others.items():
            path = _others_mesh(folder, subject, view)
            if path is None:
                row += [None, None]
                continue
            # Of another size and place: its box is laid onto the truth's.
            mesh = read_mesh(path)
            mesh = mesh.transformed(np.linalg.inv(unit_box(placed)) @ unit_box(mesh))
            row += _errors(mesh, placed, half, means[name].setdefault(subject, {}))
        rows.append(row)
    columns = ["truth, front", "back"]
    for name in (*methods, *others):
        columns += [f"{name},\nfront", "back"]
    figure = pictures.page(rows, columns, subjects, "Distance from the truth", ("metres", MOST))
    pictures.save(figure, study.results / "fig9.png")
    study.write("fig9.json", {**study.provenance(), "view": view, "mean_distance": means})
    lines = [
        f"{name}: front {_mean(of, 'front_mm'):.1f} mm, back {_mean(of, 'back_mm'):.1f} mm"
        for name, of in means.items()
        if of
    ]
    return "\n".join([*lines, str(study.results / "fig9.png"), ""])


def _errors(
    mesh: TriangleMesh, truth: TriangleMesh, half: float, means: dict[str, float]
) -> list[np.ndarray | None]:
    """The error maps of front and back, and their means into `means`."""
    images: list[np.ndarray | None] = []
    for side, angle in (("front", 0), ("back", 180)):
        image, off = pictures.error_map(mesh, truth, angle, half, MOST)
        images.append(image)
        means[f"{side}_mm"] = float(1000 * off.mean())
    return images


def _others_mesh(folder: Path, subject: str, view: int) -> Path | None:
    """Another method's mesh of a view, if its name tells."""
    stems = {mesh_name(subject, view), f"{subject}_{view}"}
    found = (path for path in sorted(folder.rglob("*")) if path.stem in stems)
    return next(found, None)


def figure15(study: Study) -> str:
    """Figure 15: an arm far before the trunk, with the depth-step cut and without."""
    seed = study.config.seeds[0]
    study.train(OURS.trainings, [seed])
    subject, view = _most_stepped(study)
    ways: dict[str, tuple[Method, float | None]] = {
        "without the cut": (OURS, None),
        "with the cut": (OURS, study.config.step),
        "true depth, without": (Method("true", "true"), None),
        "true depth, with": (Method("true", "true"), study.config.step),
    }
    truth = seen_truth(study, subject, view)
    placed, half = pictures.centered(truth, truth)
    shard = study.dataset.shard(subject)
    maps = shard.view(view, ["rgb_front", "mask"])
    pixels = round(half / shard.meta["camera"]["pixel_size"])
    angles = (0, 45, 90, 270, 315)
    clay = castable(placed)
    rows: list[list[np.ndarray | None]] = [
        [
            pictures.cut_out(maps["rgb_front"], maps["mask"], pixels),
            *(pictures.shaded(clay, angle, half) for angle in angles),
        ]
    ]
    off: dict[str, dict[str, float]] = {}
    for name, (method, step) in ways.items():
        under = f"occlusion/step_{step}"
        folder = study.meshes(method, seed, [view], step=step, under=under, subjects=[subject])
        mesh, _ = pictures.centered(read_mesh(_mesh(folder, subject, view)), truth)
        drawn = castable(mesh)
        rows.append([None, *(pictures.shaded(drawn, angle, half) for angle in angles)])
        points = sample(mesh, study.config.samples, np.random.default_rng(0))
        off[name] = {"mesh_to_truth_mm": float(1000 * nearest(points, placed)[0].mean())}
    figure = pictures.page(
        rows,
        ["colour", *(f"{angle}°" for angle in angles)],
        ["truth", *ways],
        f"{subject}, view {view}: a part far before the rest",
    )
    pictures.save(figure, study.results / "fig15.png")
    document = {**study.provenance(), "subject": subject, "view": view, "ways": off}
    study.write("fig15.json", document)
    lines = [
        f"{name}: the surface is {of['mesh_to_truth_mm']:.1f} mm off" for name, of in off.items()
    ]
    return "\n".join([*lines, str(study.results / "fig15.png"), ""])


def seen_truth(study: Study, subject: str, view: int) -> TriangleMesh:
    """A subject's own surface in a view's camera frame."""
    to_camera = np.linalg.inv(study.dataset.shard(subject)["camera_to_world"][view])
    return true_surface(study.dataset, subject).transformed(to_camera)


def _most_stepped(study: Study) -> tuple[str, int]:
    """The test subject and view whose front steps most, by length and height."""
    step = study.config.step or 0.1
    best, chosen = -1.0, (study.subjects[0], 0)
    for subject in study.subjects:
        shard = study.dataset.shard(subject)
        for view in range(len(shard)) if study.config.views is None else study.config.views:
            maps = shard.view(view, ["depth_front", "mask"])
            height = 0.0
            for axis in (0, 1):
                both = np.logical_and(*_neighbors(maps["mask"], axis))
                jump = np.abs(np.subtract(*_neighbors(maps["depth_front"], axis)))
                height += float(jump[both & (jump > step)].sum())
            if height > best:
                best, chosen = height, (subject, view)
    return chosen


def _neighbors(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    return (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])


def _mesh(folder: Path, subject: str, view: int) -> Path:
    return folder / f"{mesh_name(subject, view)}.ply"


def _mean(of: dict[str, Any], key: str) -> float:
    return float(np.mean([figures[key] for figures in of.values()]))


def _shares(found: differences.Statistics) -> dict[str, Any]:
    return {
        **asdict(found),
        "counts": list(found.counts),
        "up_to_40_mm": found.up_to_40,
        "above_100_mm": found.above_100,
    }
