"""Reconstruction: trained branches, or what they are measured by, become meshes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from engine.frame import FrameFiles
from engine.progress import Progress
from shards.archive import Shard
from shards.checksum import file_sha256
from shards.claim import claim
from shards.dataset import Dataset
from shards.lock import hold_folder, lock_folder
from shards.splits import Split
from storage.atomic import remove_temporary_files
from surface.fusion import STEP, fuse
from surface.mesh import FORMATS, SurfaceError, TriangleMesh, mesh_name, write_mesh
from surface.pinhole import Frame, Pinhole, orthographic
from surface.poisson import LEAST_DEPTH, MOST_DEPTH, poisson_smoothed
from trainer.filling import filled
from trainer.normals import Side
from trainer.predictor import GivenView, Predictor

RECORD = "reconstruction.json"

FRONTS, BACKS = ("sensor", "true"), ("body", "true")
"""What may stand in a checkpoint's place: what the networks are given, and the truth."""

Format = Literal["ply", "glb", "obj"]

FRAME_SIZE = (424, 512)
"""Rows and columns of the grid to which a capture is brought."""
MIDDLE = 2.0
"""Metres from the camera's plane to a captured person, where no network has learned a distance."""

Depth = Callable[[GivenView, Mapping[str, np.ndarray]], np.ndarray]
"""From what is known of a view, and the truth of it where there is one, to (H, W) metres."""


@dataclass(frozen=True)
class ReconstructConfig:
    """How depth becomes a mesh."""

    front: str
    """Checkpoint of the front branch; or sensor, its depth as read; or true."""
    back: str
    """Checkpoint of the back branch; or body, the bare body's back; or true."""
    step: float | None = STEP
    """Metres of depth between neighbouring pixels that part them; null never does, the paper's way.
    """
    poisson: int | None = None
    """Smooth the surface by Poisson reconstruction with an octree of this depth, such as 9."""
    format: Format = "ply"
    """Of the meshes."""

    def __post_init__(self) -> None:
        if self.step is not None and not 0 < self.step < 10:
            raise ValueError(f"step: {self.step}; give metres, such as {STEP}, or null")
        if self.poisson is not None and not LEAST_DEPTH <= self.poisson <= MOST_DEPTH:
            raise ValueError(
                f"poisson: {self.poisson}; give the octree's depth, {LEAST_DEPTH} to {MOST_DEPTH}"
            )


class Reconstructor:
    """Makes meshes of views.

    Args:
        config: how.
        device: where the networks are.

    Raises:
        ValueError: a checkpoint cannot be used.
    """

    def __init__(self, config: ReconstructConfig, device: str = "cpu") -> None:
        self.config = config
        self._front, front = _source(config.front, "front", device)
        self._back, back = _source(config.back, "back", device)
        learned = [found for found in (front, back) if found is not None]
        self.needs_body = config.back == "body" or any(found.needs_body for found in learned)
        self.middle = learned[0].middle if learned else MIDDLE

    def of_view(self, shard: Shard, index: int) -> TriangleMesh:
        """One view of a shard; in its camera's frame, metres, coloured by both images.

        Raises:
            SurfaceError, ValueError: it shows nobody, or lacks what is needed.
        """
        names = ("rgb_front", "rgb_back", "depth_sensor", "body_depth_back", "mask")
        maps = shard.view(index, (*names, "depth_front", "depth_back"))
        view = GivenView(
            maps["rgb_front"],
            maps["depth_sensor"],
            maps["body_depth_back"],
            maps["mask"],
            shard.meta["camera"]["pixel_size"],
        )
        return self._fused(view, maps["rgb_back"], maps)

    def of_frame(self, frame: Frame, camera: Pinhole, pixel_size: float) -> TriangleMesh:
        """One capture of a depth camera; in its frame (x right, y up, z towards the viewer).

        Args:
            pixel_size: metres of the pixels that the branches learned from.

        Raises:
            SurfaceError, ValueError: it shows nobody, or lacks what is needed.
        """
        seen = orthographic(frame, camera, FRAME_SIZE, pixel_size, self.middle)
        view = GivenView(seen.rgb, seen.depth, seen.body_back, seen.mask, pixel_size)
        # Nothing is known of the back's colours; the front's stand in for them.
        mesh = self._fused(view, view.rgb, {})
        return replace(mesh, vertices=seen.place.from_orthographic(mesh.vertices))

    def _fused(
        self, view: GivenView, rgb_back: np.ndarray, truth: Mapping[str, np.ndarray]
    ) -> TriangleMesh:
        front, back = self._front(view, truth), self._back(view, truth)
        mesh = fuse(front, back, view.mask, view.pixel_size, view.rgb, rgb_back, self.config.step)
        if self.config.poisson is not None:
            mesh = poisson_smoothed(mesh, self.config.poisson)
        return mesh


def _source(named: str, side: Side, device: str) -> tuple[Depth, Predictor | None]:
    """Where a side's depth comes from, and the branch that predicts it, if one does."""
    if named == "true":
        return lambda view, truth: truth[f"depth_{side}"], None
    if named == "sensor" and side == "front":
        return lambda view, truth: _whole(view.sensor, view.mask, "reading of the sensor"), None
    if named == "body" and side == "back":
        return lambda view, truth: _whole(view.body_back, view.mask, "part of a body"), None
    predictor = Predictor(Path(named), side, device)
    return lambda view, truth: predictor.depth(view), predictor


def _whole(depth: np.ndarray, mask: np.ndarray, what: str) -> np.ndarray:
    """A depth map filled out to the silhouette, as the networks are given it."""
    inside = np.where(mask, depth, np.float32(0))
    if not (inside > 0).any():
        raise SurfaceError(f"no {what} lies in the silhouette")
    return filled(inside, mask)


@dataclass(frozen=True)
class Choice:
    """Which views of a dataset are reconstructed."""

    split: Split | Literal["all"] = "test"
    """Subjects of this split."""
    subjects: list[str] | None = None
    """These subjects only, whatever their split."""
    views: list[int] | None = None
    """These views of each; null takes all."""

    def of(self, dataset: Dataset) -> list[tuple[str, int]]:
        """Subject and view of each, in order.

        Raises:
            ValueError: there is no such subject or view, or none at all.
        """
        known = dataset.subjects(None if self.split == "all" or self.subjects else self.split)
        chosen = known if self.subjects is None else self.subjects
        for subject in chosen:
            if subject not in known:
                raise ValueError(f"subjects: {dataset.folder} has no finished {subject}")
        found = []
        for subject in chosen:
            count = len(dataset.shard(subject))
            for view in range(count) if self.views is None else self.views:
                if not 0 <= view < count:
                    raise ValueError(f"views: {subject} has views 0 to {count - 1}, not {view}")
                found.append((subject, view))
        if not found:
            raise ValueError(f"{dataset.folder} has no subject in its {self.split} split")
        return found


def reconstruct(
    data: Path, output: Path, config: ReconstructConfig, views: Choice, device: str = "cpu"
) -> bool:
    """A mesh for every view, those that stand left as they are; whether all could be made.

    Args:
        data: folder of the dataset, or of one power of a light sweep.
        output: folder of the meshes; it belongs to one configuration and dataset.

    Raises:
        ValueError: the dataset, a checkpoint or `output` cannot be used.
    """
    dataset = Dataset(data)
    wanted = views.of(dataset)
    made = Reconstructor(config, device)
    held = hold_folder(data)
    try:
        output.mkdir(parents=True, exist_ok=True)
        with lock_folder(output):
            if not (output / RECORD).exists() and any(
                f.suffix in FORMATS for f in output.iterdir()
            ):
                raise ValueError(f"{output} holds meshes and no {RECORD}; choose another folder")
            claim(output / RECORD, _record(config, dataset), "meshes")
            remove_temporary_files(output)
            return _make_all(made, dataset, wanted, output)
    finally:
        if held is not None:
            held.close()


def reconstruct_frame(
    files: FrameFiles, output: Path, config: ReconstructConfig, device: str = "cpu"
) -> Path:
    """The mesh of one capture of a depth camera, in that camera's frame; its file.

    Raises:
        ValueError: files are missing or disagree, show nobody, or a checkpoint cannot be used.
    """
    if output.suffix.lower() not in FORMATS:
        raise ValueError(f"output: {output}; give a mesh's name that ends in {', '.join(FORMATS)}")
    if "true" in (config.front, config.back):
        raise ValueError(
            "the truth of a capture is not known; give checkpoints, or sensor and body"
        )
    made = Reconstructor(config, device)
    frame = files.read()
    if made.needs_body and frame.body is None:
        raise ValueError("the back is made from the person's body; give frame.body")
    mesh = made.of_frame(frame, files.camera, files.pixel_size)
    output.parent.mkdir(parents=True, exist_ok=True)
    write_mesh(output, mesh)
    return output


def _make_all(
    made: Reconstructor, dataset: Dataset, wanted: list[tuple[str, int]], output: Path
) -> bool:
    paths = {
        (subject, view): output / f"{mesh_name(subject, view)}.{made.config.format}"
        for subject, view in wanted
    }
    missing = [key for key in wanted if not paths[key].exists()]
    if len(missing) < len(wanted):
        print(f"{len(wanted) - len(missing)} of {len(wanted)} meshes stand", file=sys.stderr)
    progress = Progress("reconstruct", len(missing))
    failures = 0
    try:
        for subject, view in missing:
            why = None
            try:
                mesh = made.of_view(dataset.shard(subject), view)
                write_mesh(paths[subject, view], mesh)
            except ValueError as error:
                why, failures = str(error), failures + 1
            progress.step(mesh_name(subject, view), why)
    finally:
        progress.close()
    print(f"{len(wanted) - failures} meshes in {output}; {failures} set aside")
    return failures == 0


def _record(config: ReconstructConfig, dataset: Dataset) -> dict[str, Any]:
    """What the meshes depend on, JSON-ready; checkpoints by their bytes."""
    known = {"front": FRONTS, "back": BACKS}
    sides = {
        side: named if named in known[side] else file_sha256(Path(named))
        for side, named in (("front", config.front), ("back", config.back))
    }
    return {
        **asdict(config),
        **sides,
        "dataset": {
            "config_sha256": dataset.description["config_sha256"],
            "shards_sha256": dataset.shards_sha256(dataset.manifest),
        },
    }
