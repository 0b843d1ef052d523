"""How fast one random view leaves a shard: `Shard.view`, which reads just that view, and `np.load`.

All copy the same five members of a random view out of the same warm file. `Shard.view` is timed
on a shard that stays open, as a loader that keeps its shards has it, and with the shard opened
for each view, which parses the file's directory and meta data every time. The rounds are
interleaved, so that whatever else the machine does meets all alike.

    python benchmarks/loader.py
    python benchmarks/loader.py --shard out/demo/shards/SUBJECT.npz --rounds 50
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from shards.archive import Shard, write_shard
from shards.schema import MEMBERS, SCHEMA_VERSION

NAMES = ("rgb_front", "depth_sensor", "depth_front", "normal_front", "mask")
TARGET = 15
VIEWS, HEIGHT, WIDTH, PIXEL = 14, 424, 512, 0.005


def make_arrays(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """An ellipsoid of a person's size, with noise in depth and colour as renders have it."""
    i, j = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = (j + 0.5 - WIDTH / 2) * PIXEL, (HEIGHT / 2 - i - 0.5) * PIXEL
    rest = 1 - (x / 0.35) ** 2 - (y / 0.9) ** 2
    mask = rest > 0
    half = 0.2 * np.sqrt(np.where(mask, rest, 0))
    normal = np.stack([x / 0.35**2, y / 0.9**2, half / 0.2**2], axis=-1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    inside = mask[..., None]
    images = {
        "mask": mask,
        "depth_front": np.where(mask, 2 - half, 0),
        "depth_back": np.where(mask, 2 + half, 0),
        "normal_front": np.where(inside, normal, 0),
        "normal_back": np.where(inside, normal * (1, 1, -1), 0),
        "body_depth_front": np.where(mask, 2 - half, 0),
        "body_depth_back": np.where(mask, 2 + half, 0),
    }
    shape = (VIEWS, HEIGHT, WIDTH)
    noise = rng.normal(0, 0.002, shape)
    arrays = {name: np.broadcast_to(image, (VIEWS, *image.shape)) for name, image in images.items()}
    arrays["depth_sensor"] = np.where(mask, arrays["depth_front"] + noise, 0)
    for name in ("rgb_front", "rgb_back"):
        arrays[name] = np.where(inside, rng.normal(140, 25, (*shape, 3)).clip(0, 255), 0)
    arrays["yaw_deg"] = np.zeros(VIEWS)
    arrays["camera_to_world"] = np.broadcast_to(np.eye(4), (VIEWS, 4, 4))
    return {
        name: arrays[name].astype(member.dtype)
        for name, member in MEMBERS.items()
        if not member.optional
    }


def make_meta() -> dict:
    """Meta data of the schema's form."""
    return {
        "schema_version": SCHEMA_VERSION,
        "subject": "ellipsoid",
        "source": "benchmark",
        "licence": "CC0-1.0",
        "mesh": "subjects/ellipsoid.obj",
        "mesh_to_world": np.eye(4).tolist(),
        "mesh_sha256": "0" * 64,
        "body": None,
        "body_parameters": {},
        "camera": {
            "size": [HEIGHT, WIDTH],
            "pixel_size": PIXEL,
            "distance": 2.0,
            "center_height": 0.9,
        },
        "light": {"power": 100.0, "position": [0.0, 0.0, 0.0], "exposure": 1.0},
        "cycles": {"samples": 16},
        "sensor": {"model": "none"},
        "seed": 0,
        "dropped_pixels": [0] * VIEWS,
        "versions": {"numpy": np.__version__},
    }


def numpy_view(path: Path, index: int) -> dict[str, np.ndarray]:
    """One view with numpy alone: the members are read whole, then indexed and copied."""
    with np.load(path, allow_pickle=False) as loaded:
        return {name: loaded[name][index].copy() for name in NAMES}


def measure(
    readers: dict[str, Callable[[int], dict[str, np.ndarray]]],
    views: int,
    rounds: int,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Median milliseconds of each reader; in each round every one reads the same random view."""
    times: dict[str, list[float]] = {name: [] for name in readers}
    for index in rng.integers(views, size=rounds):
        for name, read in readers.items():
            start = time.perf_counter()
            read(int(index))
            times[name].append((time.perf_counter() - start) * 1e3)
    return {name: median(values) for name, values in times.items()}


def main() -> int:
    """Measure and print; 1 if reading just one view misses its target, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shard", type=Path, help="a stored shard; one is made if not given")
    parser.add_argument("--rounds", type=int, default=30, help="reads of each kind (30)")
    parser.add_argument("--seed", type=int, default=0, help="of the views drawn (0)")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        stored, deflated = options.shard, Path(folder) / "deflated.npz"
        if stored is None:
            stored = Path(folder) / "stored.npz"
            write_shard(stored, make_arrays(rng), make_meta())
        shard = Shard(stored)
        if any(shard.members[name].offset is None for name in NAMES):
            parser.error(f"{stored} is deflated; give a stored shard")
        write_shard(deflated, {name: shard[name] for name in shard.names}, shard.meta, "deflate")
        packed = Shard(deflated)
        readers = {
            "Shard.view, stored": lambda index: shard.view(index, NAMES),
            "  and opened each time": lambda index: Shard(stored).view(index, NAMES),
            "np.load + index, stored": lambda index: numpy_view(stored, index),
            "Shard.view, deflate": lambda index: packed.view(index, NAMES),
            "np.load + index, deflate": lambda index: numpy_view(deflated, index),
        }
        results = [read(0) for read in readers.values()]  # warms the files, too
        for name in NAMES:
            assert all((found[name] == results[0][name]).all() for found in results)
        files = (stored, stored, stored, deflated, deflated)
        times = measure(readers, len(shard), options.rounds, rng)
        sizes = [path.stat().st_size / 1e6 for path in files]
    base = times["np.load + index, stored"]
    print(f"one random view of {len(shard)}: {', '.join(NAMES)}; median of {options.rounds}, warm")
    print(f"{'':26}{'file MB':>9}{'ms':>9}{'times np.load':>15}")
    for (name, value), size in zip(times.items(), sizes, strict=True):
        print(f"{name:26}{size:9.1f}{value:9.2f}{base / value:14.1f}x")
    ratio = base / times["Shard.view, stored"]
    print(f"ratio {ratio:.1f} (target {TARGET} or more)")
    return 0 if ratio >= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
