"""How shards are written."""

from __future__ import annotations

from dataclasses import dataclass

from shards.archive import Compression


@dataclass(frozen=True)
class ShardsConfig:
    """What a shard holds beyond the contract, and how it lies on disk."""

    compression: Compression = "stored"
    """`stored` lets one view be read without the rest; `deflate` is about nine times smaller, for
    passing a dataset on."""
    draws: int = 1
    """Readings of the depth sensor for each view; those after the first are another member."""
    radiance: bool = False
    """Keep the linear light as well, for light sweeps (a third more bytes)."""

    def __post_init__(self) -> None:
        if not 1 <= self.draws <= 100:
            raise ValueError(f"shards.draws: {self.draws}; give 1 to 100 readings for each view")
