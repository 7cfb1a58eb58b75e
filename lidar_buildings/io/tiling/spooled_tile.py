"""Tiles whose points wait on disk."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.tile_grid import Buffer, Rectangle
from lidar_buildings.io.tiling.tile_store import TilePlan, TileStore


@dataclass
class SpooledTile:
    """A tile that is ready to be read; it can be sent to another process that sees the store's folder."""

    plan: TilePlan
    store: TileStore
    #: The strip of neighbours that comes with it, and how wide it may grow [m].
    buffer: Buffer
    max_buffer: float

    @property
    def stamp(self) -> int:
        """The tile's key [ns]."""
        return self.plan.stamp

    @property
    def reach(self) -> Rectangle:
        """Where the tile's points may lie in the map frame, however wide its buffer becomes [m]."""
        return self.store.local_area(self.plan, Buffer.largest(self.max_buffer))

    @property
    def core(self) -> Rectangle:
        """Where the tile's core points lie in the map frame [m]."""
        return self.store.local_area(self.plan, Buffer.of(0.0))

    def alone(self) -> SpooledTile:
        """Return the tile without what lies beyond its reach: little to send to another process."""
        return replace(self, store=self.store.near(self.plan, Buffer.largest(self.max_buffer)))

    def read(self) -> PointTile:
        """Return the tile."""
        return self.store.tile(self.plan, self.buffer)

    def grow(self, sides: Sides = ALL) -> bool:
        """
        Double the buffer on some sides, up to the largest, until it brings more points; False if none does.
        """
        wider = self.store.wider(self.plan, self.buffer, sides, self.max_buffer)
        self.buffer = wider or self.buffer
        return wider is not None
