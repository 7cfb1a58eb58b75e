"""What a source of tiles is to the node that sends them. It needs no ROS."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile


class Progress(NamedTuple):
    """How far a source is."""

    n_done: int
    n_failed: int
    n_tiles: int


class TileQueue(Protocol):
    """
    Where tiles come from.

    Attributes
    ----------
    error : Exception or None
        Why no more come.
    is_exhausted : bool
        Whether all have been made, though perhaps not all taken.
    tile_count : int
        How many there are, as far as is known.
    """

    error: Exception | None
    is_exhausted: bool

    @property
    def tile_count(self) -> int:
        """Number of tiles."""

    def take(self) -> PointTile | None:
        """Return the next tile, None if none is ready."""

    def grown(self, tile: PointTile, sides: Sides) -> PointTile | None:
        """Return a tile with a larger buffer on some sides, None if there is none."""
