"""What a source of tiles is to the node that sends them. It needs no ROS."""

from __future__ import annotations

from typing import Protocol

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile


class TileQueue(Protocol):
    """Where tiles come from."""

    error: Exception | None  #: why no more come
    is_exhausted: bool  #: whether all have been made, though perhaps not all taken

    @property
    def tile_count(self) -> int:
        """Number of tiles, as far as is known."""

    def take(self) -> PointTile | None:
        """Return the next tile, None if none is ready."""

    def grown(self, tile: PointTile, sides: Sides) -> PointTile | None:
        """Return a tile with a larger buffer on some sides, None if there is none."""
