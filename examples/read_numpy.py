"""A shard with NumPy and nothing else: what is in it, and how thick the person is.

python examples/read_numpy.py out/demo/shards/open_0000.npz
"""

import json
import sys

import numpy as np

with np.load(sys.argv[1]) as shard:
    meta = json.loads(str(shard["meta"]))
    for name in shard.files:
        print(f"{name:18} {shard[name].dtype!s:8} {shard[name].shape}")
    mask = shard["mask"][0]  # (424, 512) bool, one silhouette for both sides
    thickness = shard["depth_back"][0] - shard["depth_front"][0]  # metres
print(f"{meta['subject']}, {meta['licence']}: {thickness[mask].mean():.3f} m thick on average")
