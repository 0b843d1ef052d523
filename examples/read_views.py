"""Single views of a dataset, as a training loop takes them: sensor's depth in, truth out.

python examples/read_views.py out/demo
"""

import sys

import numpy as np

from shards.dataset import Dataset

dataset = Dataset(sys.argv[1])
shards = [dataset.shard(subject) for subject in dataset.subjects("train")]
rng = np.random.default_rng(0)
for _ in range(4):
    shard = shards[rng.integers(len(shards))]
    i = int(rng.integers(len(shard)))
    view = shard.view(i, ["mask", "depth_sensor", "depth_front", "rgb_front"])
    seen = view["depth_sensor"] > 0
    error = 1000 * np.abs(view["depth_sensor"] - view["depth_front"])[seen].mean()
    lost = 1 - seen.sum() / view["mask"].sum()
    print(f"{shard.meta['subject']} view {i}: sensor off by {error:.2f} mm, {lost:.1%} lost")
