"""The dataset card: what a person should know before using a dataset."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from typing import Any

from shards import schema
from shards.licences import is_redistributable

_CARD = """# {name}

{description}

| | |
|---|---|
| subjects | {subjects} ({train} train, {test} test) |
| views | {views} |
| image | {height} x {width} pixels |
| size of the shards | {megabytes:.1f} MB |
| subjects that failed | {failures} |

## Licence

{licences}

## Load it

```python
import json
import numpy as np

shard = np.load("shards/{example}.npz")
meta = json.loads(str(shard["meta"]))
color = shard["rgb_front"]  # (V, H, W, 3) sRGB bytes
{base}depth = {depths}["depth_front"]  # (V, H, W) metres, 0 where there is no surface
thickness = {depths}["depth_back"] - depth  # front and back share one grid of pixels
```
{lent}
`manifest.jsonl` lists every finished shard with its SHA-256 and its split; what it does not list
is no part of the dataset. `{surfaces}/` holds the surfaces, `failures.jsonl` the subjects that
could not be made, and `dataset.json` describes it all after Croissant 1.1.

## Members of a shard

Metres. The front camera's frame: x right, y up, z towards the viewer. V views of H x W pixels.

| member | shape | type | meaning |
|---|---|---|---|
{members}
| `meta` | () | JSON text | subject, licence, mesh, body, camera, light, sensor, seed, versions |

## How it was made

Built by Rectoverso, schema {schema_version}, from the configuration with the SHA-256
`{config_sha256}`:

```json
{config}
```
"""


_LENT = """
These shards share {members} with the dataset that `base` links to, and do not hold them again.
`shards.archive.Shard` reads both as one. To pass this dataset on, pass on both, lying to each other
as they do here: the link is relative.
"""


def render_card(
    name: str,
    description: str,
    facts: Mapping[str, Any],
    licences: Mapping[str, int],
    members: Mapping[str, schema.ArrayLike],
    lent: Collection[str] = (),
) -> str:
    """The card's text, Markdown.

    Args:
        name: the dataset's.
        description: a sentence or two.
        facts: the `rectoverso` block of dataset.json.
        licences: licence -> number of subjects under it.
        members: name -> shape and type in one of the shards; empty if there is none.
        lent: names of the members that lie in the shards of the dataset linked at `base`.
    """
    counts = facts["counts"]
    height, width = members["mask"].shape[1:] if members else ("-", "-")
    example = next(iter(facts["splits"]["train"] or facts["splits"]["test"]), "SUBJECT")
    return _CARD.format(
        name=name,
        description=description,
        **counts,
        height=height,
        width=width,
        megabytes=facts["totals"]["bytes"] / 1e6,
        licences=_licences_text(licences),
        example=example,
        base=f'base = np.load("base/shards/{example}.npz")\n' if lent else "",
        surfaces="base/subjects" if lent else "subjects",
        depths="base" if lent else "shard",
        lent=_LENT.format(members=", ".join(f"`{name}`" for name in lent)) if lent else "",
        members="\n".join(
            f"| `{member.name}` | {member.shape_text} | {member.dtype.name} | {member.meaning} |"
            for member in schema.MEMBERS.values()
            if member.name in members or not member.optional
        ),
        schema_version=facts["schema_version"],
        config_sha256=facts["config_sha256"],
        config=json.dumps(facts["config"], indent=2, sort_keys=True, ensure_ascii=False),
    )


def _licences_text(licences: Mapping[str, int]) -> str:
    lines = [
        f"- {licence} (subjects: {count}): "
        + (
            "may be passed on under its terms"
            if is_redistributable(licence)
            else "not known to allow sharing: do not pass on"
        )
        for licence, count in sorted(licences.items())
    ]
    free = bool(licences) and all(is_redistributable(licence) for licence in licences)
    verdict = (
        "Redistributable: yes. Every subject's licence lets renders of it be shared."
        if free
        else "Redistributable: no. Keep the dataset, or any part derived from those subjects, "
        "to yourself unless the owners of the scans allow more."
    )
    return "\n".join([verdict, "", *lines])
