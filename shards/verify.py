"""Proves a dataset again: checksums, contract, and every map against an independent ray cast."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from shards import schema
from shards.archive import Shard, ShardError
from shards.checksum import file_sha256
from shards.dataset import BASE, FAILURES, Dataset
from shards.manifest import DatasetError, Entry
from shards.raycast import Hits, Surface
from shards.sweep import base_folder, read_index, read_shared

DEPTH_MEDIAN_MM = 0.005
DEPTH_P999_MM = 0.1
NORMAL_MEDIAN_DEG = 0.1
"""Largest errors against the ray cast, over the silhouette of one view and side."""

UNIT_TOLERANCE = 1e-3
"""On a normal's length: three halves of a 16-bit float's last place just below 1 make 4e-4."""

LEANING_TOLERANCE = 1e-3
"""How far a normal's z may pass 0, away from its viewer; a 16-bit float's last place."""

RIGID_TOLERANCE = 1e-6
"""On camera_to_world, metres and cosines: yaw_deg is a 32-bit float."""

EDGE_RADIUS = 2e-6
"""Metres (a 2500th of a 5 mm pixel): a ray that passes an edge as near as this may fall on either
side of it, because renderers and Embree work in single precision."""

EDGE_PART = 1e-4
"""Largest part of a silhouette that lies on an edge and disagrees, one pixel besides. An outline
of a thousand 5 mm pixels has, by chance, about one whose centre is within EDGE_RADIUS of it, and
single precision decides few of these differently; more of them are a shift, not chance."""

STRAY_PART = 2e-4
"""Largest part of the silhouette that is off in depth and on no edge: rays that slip between
two triangles, in single precision too."""

_MM = 1e3
_MARGIN = 4  # pixels around the surface's extent that are cast as well
_RING = np.column_stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)])
_PROBES = np.concatenate([part * EDGE_RADIUS * _RING for part in (0.2, 0.4, 0.6, 0.8, 1.0)])

_COLUMNS = {
    "views": "views",
    "mask_off": "mask off",
    "edge": "edge px",
    "dropped": "dropped",
    "depth_median_mm": "depth med mm",
    "depth_p999_mm": "p99.9 mm",
    "depth_off": "depth off",
    "normal_median_deg": "normal deg",
    "body_mask_off": "body mask off",
    "body_median_mm": "body med mm",
    "body_p999_mm": "p99.9 mm",
    "body_off": "depth off",
}


BOUNDS: dict[str, tuple[str, float | None]] = {
    "mask_off": ("silhouette: pixels that differ from the ray cast, near no edge", 0),
    "edge": ("silhouette: pixels that an edge within 2 micrometres of the ray decides", None),
    "dropped": ("pixels that one side alone saw, and no map holds", None),
    "depth_median_mm": ("depth, median error, mm", DEPTH_MEDIAN_MM),
    "depth_p999_mm": ("depth, error of 99.9 % of pixels, mm", DEPTH_P999_MM),
    "depth_off": ("depth: pixels that are off and on no edge", None),
    "normal_median_deg": ("normals, median error, degrees", NORMAL_MEDIAN_DEG),
    "body_mask_off": ("body's silhouette: pixels that differ from the ray cast", None),
    "body_median_mm": ("body's depth, median error, mm", DEPTH_MEDIAN_MM),
    "body_p999_mm": ("body's depth, error of 99.9 % of pixels, mm", DEPTH_P999_MM),
}
"""Figures of a report in words, and the largest that is sound; None where a view has its own."""


@dataclass
class Report:
    """What `verify` found.

    Attributes:
        breaches: one line each; empty for a sound dataset.
        figures: subject -> figure -> its worst value over the subject's views. Millimetres,
            degrees or pixels; the names in "off" count pixels that disagree with the ray cast
            though no edge is near, "edge" those of the mask that disagree beside an edge.
    """

    breaches: list[str] = field(default_factory=list)
    figures: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether nothing broke the contract."""
        return not self.breaches

    def table(self) -> str:
        """The figures, a row for each subject and the worst of all, then the breaches."""
        rows = [["subject", *_COLUMNS.values()]]
        rows += [[subject, *_cells(figures)] for subject, figures in self.figures.items()]
        rows.append(["worst", *_cells(self.worst())])
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = [
            "  ".join(
                cell.ljust(width) if i == 0 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in rows
        ]
        return "\n".join([*lines, "", self.verdict()])

    def worst(self) -> dict[str, float]:
        """Every figure's worst value over all subjects."""
        found: dict[str, float] = {}
        for figures in self.figures.values():
            _keep_worst(found, figures)
        return found

    def verdict(self) -> str:
        """Whether it is sound, or the breaches."""
        count = len(self.breaches)
        found = f"{count} breach{'es' if count > 1 else ''}:" if count else "sound"
        return "\n".join([found, *self.breaches])


def verify(
    folder: Path | str,
    progress: Callable[[str], None] = lambda subject: None,
    lent: bool = True,
) -> Report:
    """Prove a dataset again, from its files alone.

    Checksums and the contract are checked for every view. Masks, depths and normals, the body's
    too, are compared with rays cast at the pixel centres through the mesh that `meta` names.

    Args:
        folder: the dataset's.
        progress: called with a subject's id when it is done.
        lent: whether what a shard's base holds is compared with rays too, or was proven with the
            base; its checksum is checked in any case.

    Raises:
        DatasetError: if the folder holds no dataset, or its dataset.json or manifest cannot be
            read. Whatever else is wrong inside is a breach.
    """
    dataset = Dataset(folder)
    report = Report()
    _check_folder(dataset, report.breaches)
    for subject, entry in dataset.manifest.items():
        check = _SubjectCheck(dataset, entry, lent)
        try:
            check.run()
        except (ShardError, schema.SchemaError) as error:
            check.breach(str(error))
        report.breaches += check.breaches
        report.figures[subject] = check.figures
        progress(subject)
    return report


def verify_sweep(
    folder: Path, progress: Callable[[str], None] = lambda subject: None
) -> dict[str, Report]:
    """Prove a light sweep: the dataset that was photographed, and every power's colours.

    Args:
        folder: the sweep's.
        progress: called with a subject's id when it is done, in each of the datasets.

    Returns:
        folder of a dataset -> what was found there, the photographed one's first.

    Raises:
        DatasetError: if the folder holds no sweep, or what was photographed is gone.
    """
    base, powers = base_folder(folder), read_index(folder)
    shared = read_shared(folder)[0]
    reports = {os.path.normpath(base): verify(base, progress)}
    for power, of_power in powers.items():
        try:
            report = verify(of_power, progress, lent=False)
            if Dataset(of_power).config != {"light": {"power": power}, **shared}:
                report.breaches.append(f"{of_power} is of another light; run the sweep again")
            if not (of_power / BASE).is_dir() or not (of_power / BASE).samefile(base):
                report.breaches.append(f"{of_power / BASE} is not {base}; run the sweep again")
        except DatasetError as error:
            report = Report([str(error)])
        reports[str(of_power)] = report
    return reports


def _check_folder(dataset: Dataset, breaches: list[str]) -> None:
    block = dataset.description
    splits = {name: split for split, names in block["splits"].items() for name in names}
    listed = {name: entry.split for name, entry in dataset.manifest.items()}
    try:
        failed = {failure["subject"] for failure in dataset.failures}
    except DatasetError as error:
        breaches.append(str(error))
        failed = set()
    missing = block["counts"]["planned"] - len(listed)
    if not listed:
        breaches.append(f"{dataset.folder}: no shard is finished; run the build")
    elif splits != listed:
        breaches.append(
            f"{dataset.folder}: dataset.json and the manifest list other subjects or splits; "
            "run the build again to its end"
        )
    elif any(entry.versions != block.get("versions") for entry in dataset.manifest.values()):
        breaches.append(
            f"{dataset.folder}: dataset.json and the manifest tell of different versions; "
            "run the build again to its end"
        )
    if missing > len(failed):
        breaches.append(
            f"{dataset.folder}: {missing} planned subjects are not finished and {len(failed)} are "
            f"in {FAILURES}; run the build again"
        )


class _SubjectCheck:
    """The checks of one subject, from cheap to dear; `breaches` and `figures` fill up."""

    def __init__(self, dataset: Dataset, entry: Entry, lent: bool) -> None:
        self.dataset = dataset
        self.entry = entry
        self.lent = lent
        self.breaches: list[str] = []
        self.figures: dict[str, float] = {}

    def breach(self, text: str, view: int | None = None) -> None:
        place = self.entry.subject if view is None else f"{self.entry.subject} view {view}"
        self.breaches.append(f"{place}: {text}")

    def run(self) -> None:
        self._check_file()
        shard = self.dataset.shard(self.entry.subject)
        count, height, width = schema.check_arrays(shard.members)
        schema.check_meta(shard.meta, count, height, width)
        self._check_base(shard)
        for key, due in (("subject", self.entry.subject), ("licence", self.entry.licence)):
            if shard.meta[key] != due:
                self.breach(f"meta.{key} is {shard.meta[key]!r}, the manifest says {due!r}")
        arrays = {name: shard[name] for name in shard.names}
        surface = body = None
        if self.lent or shard.base is None:
            surface = self._surface(shard, "mesh")
            body = self._surface(shard, "body") if shard.meta["body"] is not None else None
        for view in range(count):
            maps = {name: array[view] for name, array in arrays.items()}
            self._check_maps(view, maps)
            if self._has_camera(view, maps, shard.meta):
                if surface is not None:
                    self._compare_subject(view, maps, surface, shard.meta)
                if body is not None:
                    self._compare_body(view, maps, body, shard.meta)
            if shard.meta["body"] is None and maps["body_depth_front"].any():
                self.breach("body_depth_front is not 0, but meta.body is null", view)
        self.figures["views"] = count
        shard.close()

    def _check_file(self) -> None:
        path = self.dataset.shard_path(self.entry.subject)
        try:
            size = path.stat().st_size
            digest = file_sha256(path)
        except FileNotFoundError:
            raise ShardError(f"{path} is missing; run the build again") from None
        except OSError as error:
            raise ShardError(
                f"{path} cannot be opened ({error.strerror}); check its rights"
            ) from None
        if size != self.entry.bytes:
            self.breach(
                f"{path} is {size} bytes, the manifest says {self.entry.bytes}; run the build again"
            )
        elif digest != self.entry.sha256:
            self.breach(f"{path} has another sha256 than the manifest; delete it and build again")

    def _check_base(self, shard: Shard) -> None:
        """Whether the base is the file that its own dataset lists, and the light the dataset's."""
        if shard.base is None:
            return
        named, config = shard.meta["base"], self.dataset.config
        if file_sha256(shard.base.path) != named["sha256"]:
            self.breach(
                f"{shard.base.path} has another sha256 than {shard.path} was made for; "
                "run the sweep again"
            )
        listed = self.dataset.base.manifest.get(self.entry.subject)
        if listed is None or listed.sha256 != named["sha256"]:
            self.breach(f"{self.dataset.base.folder} lists no such shard; run the sweep again")
        elif listed.split != self.entry.split:
            self.breach(f"it is in the {listed.split} split of its base; run the sweep again")
        light = config.get("light", {})
        if shard.meta.get("sweep") != config or shard.meta["light"]["power"] != light.get("power"):
            self.breach(f"{shard.path} is of another light than its dataset; run the sweep again")

    def _surface(self, shard: Shard, key: str) -> Surface | None:
        """The mesh that meta names under `key`, or None and a breach."""
        path = self.dataset.path(shard.meta[key])
        try:
            meta = shard.meta
            files = {**meta.get("files", {}), meta["mesh"]: meta["mesh_sha256"]}
            if meta[key] in files and file_sha256(path) != files[meta[key]]:
                self.breach(f"{path} has another sha256 than meta says; run the build again")
            return Surface.read(path, np.array(shard.meta["mesh_to_world"], dtype=np.float64))
        except FileNotFoundError:
            self.breach(f"meta.{key}: {path} is missing; run the build again")
        except OSError as error:
            self.breach(f"meta.{key}: {path} cannot be opened ({error.strerror}); check its rights")
        except ValueError as error:
            self.breach(f"meta.{key}: {error}; delete the file and run the build again")
        return None

    def _has_camera(
        self, view: int, maps: Mapping[str, np.ndarray], meta: Mapping[str, Any]
    ) -> bool:
        """Whether the view's camera is the one that meta and yaw tell; else no ray is cast."""
        matrix, camera = maps["camera_to_world"], meta["camera"]
        rotation = matrix[:3, :3]
        if not np.isfinite(matrix).all() or not np.isfinite(maps["yaw_deg"]):
            self.breach("camera_to_world or yaw_deg is not finite", view)
            return False
        if (
            not np.abs(rotation @ rotation.T - np.eye(3)).max() <= RIGID_TOLERANCE
            or not np.linalg.det(rotation) > 0
            or (matrix[3] != (0, 0, 0, 1)).any()
        ):
            self.breach("camera_to_world is no rigid transform", view)
            return False
        due = camera_to_world(float(maps["yaw_deg"]), camera["distance"], camera["center_height"])
        if not np.abs(matrix - due).max() <= RIGID_TOLERANCE:
            self.breach("camera_to_world disagrees with yaw_deg and meta.camera", view)
            return False
        return True

    def _check_maps(self, view: int, maps: Mapping[str, np.ndarray]) -> None:
        mask = maps["mask"]
        for name, array in maps.items():
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                self.breach(f"{name} is not finite everywhere", view)
            if name not in ("mask", "yaw_deg", "camera_to_world") and not name.startswith("body"):
                # Several readings of one view lie before the image's axes.
                values = array[:, ~mask].T if name == "depth_sensor_more" else array[~mask]
                outside = int((values != 0).reshape(len(values), -1).any(axis=1).sum())
                if outside:
                    self.breach(f"{name} is not 0 in {outside} pixels outside the mask", view)
        if not mask.any():
            self.breach("mask is empty", view)
        for name in ("depth_front", "depth_back"):
            wrong = int((mask != (maps[name] > 0)).sum())
            if wrong:
                self.breach(f"mask differs from {name} > 0 in {wrong} pixels", view)
        for name in ("depth_sensor", "depth_sensor_more"):
            if name in maps and not (maps[name] >= 0).all():
                self.breach(f"{name} is negative somewhere", view)
        self._check_thickness(view, maps, mask, "depth")
        body = maps["body_depth_front"] > 0
        wrong = int((body != (maps["body_depth_back"] > 0)).sum())
        if wrong:
            self.breach(f"the body's front and back silhouettes differ in {wrong} pixels", view)
        self._check_thickness(view, maps, body, "body_depth")
        for name, sign in (("normal_front", 1), ("normal_back", -1)):
            self._check_normals(view, name, maps[name][mask].astype(np.float32), sign)

    def _check_thickness(
        self, view: int, maps: Mapping[str, np.ndarray], inside: np.ndarray, name: str
    ) -> None:
        thickness = maps[f"{name}_back"][inside] - maps[f"{name}_front"][inside]
        negative = int((~(thickness >= 0)).sum())
        if negative:
            least = thickness.min() * _MM
            self.breach(
                f"{name}_back is nearer than {name}_front in {negative} pixels "
                f"(thickness down to {least:.3f} mm)",
                view,
            )

    def _check_normals(self, view: int, name: str, normals: np.ndarray, sign: int) -> None:
        if len(normals) == 0:
            return
        length = np.sqrt(np.einsum("ni,ni->n", normals, normals))
        wrong = int((~(np.abs(length - 1) <= UNIT_TOLERANCE)).sum())
        if wrong:
            self.breach(f"{name} is not of unit length in {wrong} pixels", view)
        leaning = int((~(sign * normals[:, 2] >= -LEANING_TOLERANCE)).sum())
        if leaning:
            self.breach(f"{name} faces away from its viewer in {leaning} pixels", view)

    def _compare_subject(
        self, view: int, maps: Mapping[str, np.ndarray], surface: Surface, meta: Mapping[str, Any]
    ) -> None:
        mask, silhouette = maps["mask"], max(int(maps["mask"].sum()), 1)
        cast = _Cast(surface, maps["camera_to_world"], mask, meta["camera"]["pixel_size"])
        if not cast.fits:
            self.breach("the subject leaves the frame", view)
        gained, lost, edge = cast.compare_mask(mask)
        dropped = meta["dropped_pixels"][view]
        if gained or lost > dropped:
            self.breach(
                f"mask differs from the ray cast: {gained} pixels too many, {lost} too few, "
                f"{dropped} declared as dropped",
                view,
            )
        self._check_edge(view, "mask", edge, silhouette)
        if dropped > max(1, schema.DROPPED_LIMIT * silhouette):
            self.breach(f"{dropped} pixels dropped of a silhouette of {silhouette}", view)
        figures: dict[str, float] = {"mask_off": gained + lost, "edge": edge, "dropped": dropped}
        _keep_worst(self.figures, figures)
        for side in ("front", "back"):
            self._compare_depth(view, f"depth_{side}", maps[f"depth_{side}"], cast, side, "depth")
            normals = maps[f"normal_{side}"]
            angle = cast.normal_errors_deg(normals, side)
            if len(angle):
                median = float(np.median(angle))
                _keep_worst(self.figures, {"normal_median_deg": median})
                if not median <= NORMAL_MEDIAN_DEG:
                    self.breach(f"normal_{side} is off by {median:.3f} degrees (median)", view)

    def _compare_body(
        self, view: int, maps: Mapping[str, np.ndarray], body: Surface, meta: Mapping[str, Any]
    ) -> None:
        inside = maps["body_depth_front"] > 0
        cast = _Cast(body, maps["camera_to_world"], inside, meta["camera"]["pixel_size"])
        gained, lost, edge = cast.compare_mask(inside)
        self._check_edge(view, "the body's silhouette", edge, int(inside.sum()))
        _keep_worst(self.figures, {"body_mask_off": gained + lost})
        if gained or lost:
            self.breach(
                f"the body's silhouette differs from the ray cast: {gained} pixels too many, "
                f"{lost} too few",
                view,
            )
        for side in ("front", "back"):
            name = f"body_depth_{side}"
            self._compare_depth(view, name, maps[name], cast, side, "body")

    def _check_edge(self, view: int, name: str, edge: int, silhouette: int) -> None:
        if edge > 1 + EDGE_PART * silhouette:
            self.breach(
                f"{name} differs from the ray cast in {edge} pixels on an edge, of {silhouette}: "
                "more than chance",
                view,
            )

    def _compare_depth(
        self, view: int, name: str, depth: np.ndarray, cast: _Cast, side: str, figure: str
    ) -> None:
        error, off = cast.depth_errors_mm(depth, side)
        if len(error) == 0:
            return
        median, p999 = (float(q) for q in np.quantile(error, (0.5, 0.999)))
        figures = {f"{figure}_median_mm": median, f"{figure}_p999_mm": p999, f"{figure}_off": off}
        _keep_worst(self.figures, figures)
        if not (median <= DEPTH_MEDIAN_MM and p999 <= DEPTH_P999_MM):
            self.breach(f"{name} is off by {median:.4f} mm (median), {p999:.3f} mm (99.9 %)", view)
        elif off > max(1, STRAY_PART * len(error)):
            self.breach(f"{name} is off in {off} pixels that lie on no edge", view)


class _Cast:
    """One view's rays through one surface, from the front and from behind.

    Args:
        surface: the mesh.
        camera_to_world: (4, 4).
        inside: (H, W) bool, what the shard says is covered; it is cast in any case.
        pixel_size: metres.
    """

    def __init__(
        self, surface: Surface, camera_to_world: np.ndarray, inside: np.ndarray, pixel_size: float
    ) -> None:
        self._surface, self._camera = surface, camera_to_world
        self._pixel_size, self._shape = float(pixel_size), inside.shape
        height, width = inside.shape
        low, high = surface.bounds(camera_to_world)
        columns = np.array([low[0], high[0]]) / self._pixel_size + width / 2
        rows = height / 2 - np.array([high[1], low[1]]) / self._pixel_size
        self.fits = bool(columns.min() >= 0 and columns.max() <= width)
        self.fits = self.fits and bool(rows.min() >= 0 and rows.max() <= height)
        # Outside the surface's own extent no ray can hit it: there the shard must be empty too.
        self._rows = _span(rows, inside.any(axis=1))
        self._columns = _span(columns, inside.any(axis=0))
        i, j = np.mgrid[self._rows, self._columns]
        self._xy = self._centres(i.ravel(), j.ravel())
        self._hits = {"front": self._ask(self._xy, "front"), "back": self._ask(self._xy, "back")}
        self._covered = self._hits["front"].hit & self._hits["back"].hit
        self._agreed = np.zeros_like(self._covered)

    def compare_mask(self, mask: np.ndarray) -> tuple[int, int, int]:
        """How many pixels the mask has too many, too few, and how many lie on an edge.

        A pixel that disagrees lies on an edge if a ray EDGE_RADIUS beside it agrees.
        """
        told = mask[self._rows, self._columns].ravel()
        self._agreed = told & self._covered
        wrong = np.flatnonzero(told != self._covered)
        covered = self._probe(wrong, "front").hit & self._probe(wrong, "back").hit
        edge = (covered.reshape(-1, len(_PROBES)) == told[wrong, None]).any(axis=1)
        wrong = wrong[~edge]
        gained = int(told[wrong].sum())
        return gained, len(wrong) - gained, int(edge.sum())

    def depth_errors_mm(self, depth: np.ndarray, side: str) -> tuple[np.ndarray, int]:
        """|error| over the pixels that both cover, and how many are off and on no edge."""
        told = depth[self._rows, self._columns].ravel().astype(np.float64)
        error = np.abs(told + self._hits[side].z) * _MM
        far = np.flatnonzero(self._agreed & ~(error <= DEPTH_P999_MM))
        probes = self._probe(far, side).z.reshape(-1, len(_PROBES))
        beside = np.abs(told[far, None] + probes) * _MM
        off = int((~(beside <= DEPTH_P999_MM).any(axis=1)).sum())
        return error[self._agreed], off

    def normal_errors_deg(self, normals: np.ndarray, side: str) -> np.ndarray:
        """Angle to the interpolated normals over the pixels that both cover."""
        told = normals[self._rows, self._columns].reshape(-1, 3)[self._agreed].astype(np.float64)
        due = self._hits[side].normal[self._agreed]
        # The arc tangent is exact at small angles, where the arc cosine is not.
        sine = np.linalg.norm(np.cross(told, due), axis=1)
        angle: np.ndarray = np.degrees(np.arctan2(sine, np.einsum("ni,ni->n", told, due)))
        return angle

    def _centres(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        height, width = self._shape
        return np.column_stack([j + 0.5 - width / 2, height / 2 - i - 0.5]) * self._pixel_size

    def _probe(self, pixels: np.ndarray, side: str) -> Hits:
        return self._ask((self._xy[pixels, None] + _PROBES).reshape(-1, 2), side)

    def _ask(self, xy: np.ndarray, side: str) -> Hits:
        return self._surface.cast(xy, self._camera, towards=-1 if side == "front" else 1)


def camera_to_world(yaw_deg: float, distance: float, center_height: float) -> np.ndarray:
    """(4, 4): R_y(-yaw) T(0, center_height, distance), the camera of a subject turned by +yaw."""
    cosine, sine = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    rotation = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = rotation @ (0, center_height, distance)
    return matrix


def _span(extent: np.ndarray, used: np.ndarray) -> slice:
    """The indices to cast along one axis: the surface's extent, the mask's, and a margin."""
    marked = np.flatnonzero(used)
    extent = np.clip(extent, 0, len(used))
    first = min(extent.min(), marked.min(initial=len(used))) - _MARGIN
    last = max(extent.max(), marked.max(initial=0) + 1) + _MARGIN
    return slice(max(int(np.floor(first)), 0), min(max(int(np.ceil(last)), 0), len(used)))


def _keep_worst(worst: dict[str, float], figures: Mapping[str, float]) -> None:
    for name, value in figures.items():
        # NaN is the worst of all; `max` alone would keep whichever comes first.
        worst[name] = max(worst.get(name, value), value, key=lambda v: (math.isnan(v), v))


def _cells(figures: Mapping[str, float]) -> list[str]:
    return [_cell(figures.get(name)) for name in _COLUMNS]


def _cell(value: float | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.4f}"
