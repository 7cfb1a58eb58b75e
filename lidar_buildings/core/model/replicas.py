"""Nodes of one kind that share their tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.ids import STEP, tile_of
from lidar_buildings.core.model.parameters import StageConfig, fixed

#: More are not foreseen.
MAX_REPLICAS = 64
#: Fibonacci hashing (Knuth, The Art of Computer Programming, vol. 3, 6.4): 2^64 over the golden ratio.
_MULTIPLIER = 0x9E3779B97F4A7C15


@dataclass(frozen=True)
class ReplicaConfig(StageConfig):
    """Which tiles a node takes of those that it shares with others of its kind."""

    stage: ClassVar[str] = "replicas"
    is_of_node: ClassVar[bool] = True

    replica: int = fixed(
        0,
        "Number of this node among those of its kind that share the tiles, from 0; each has a name of its "
        "own, such as roof_selector_1.",
        within=(0, MAX_REPLICAS - 1),
        advanced=True,
    )
    replicas: int = fixed(
        1,
        "How many nodes of this kind share the tiles, in one host or several; all must be there.",
        within=(1, MAX_REPLICAS),
        advanced=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.replica >= self.replicas:
            raise ParameterError(
                f"replica = {self.replica}: must be below replicas = {self.replicas}: they count from 0"
            )

    def takes(self, stamp: int) -> bool:
        """Whether this node works on a tile, in all its revisions [ns]."""
        return replica_of(stamp, self.replicas) == self.replica


def replica_of(stamp: int, n_replicas: int) -> int:
    """Return which of several nodes works on a tile; stamps that are evenly spaced are mixed [ns]."""
    mixed = tile_of(stamp) // STEP * _MULTIPLIER % 2**64
    return (mixed >> 32) * n_replicas >> 32
