"""The tiles of a feed: which have points that were not sent, and how long none has fallen into them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import STEP, tile_of
from lidar_buildings.io.tiling.cell_table import Cell, CellTable
from lidar_buildings.io.tiling.tile_grid import Block, Buffer, Rectangle, TileGrid
from lidar_buildings.io.tiling.tile_stamps import stamp_of_number, stamp_of_time
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig

#: A tile comes again at most so often: its stamps leave room for no more revisions (`ros.stamps`), some of
#: which it needs to grow.
MOST_REVISIONS = 900
#: A tile of which fewer points are new waits longer before it comes again: a scanner on the street sees
#: single far points for long.
_FEW = 0.01


@dataclass(eq=False)
class LiveTile:
    """What is known of a tile."""

    place: Cell  #: its column and row in the grid
    stamp: int  #: its key: the stamp of its first revision [ns]
    block: Block
    buffer: Buffer  #: with which it was sent last
    near: Block  #: its spool cells and those of its buffer, as wide as it has ever been
    n_sent: int = -1  #: points near it when it was sent last; −1 = never
    n_points: int = -1  #: points that it was sent with last, its buffer's too; −1 = none of use
    revision: int = -1  #: number of the last one that was sent; −1 = none was


class LiveTiles:
    """
    All tiles of a feed; `changed` are the places of those that have seen points since they were looked at.

    `count_in` counts the points of cells.
    """

    def __init__(
        self, grid: TileGrid, config: LiveTilingConfig, count_in: Callable[[Iterable[Cell]], int]
    ) -> None:
        self._grid, self._config, self._count_in = grid, config, count_in
        self._by_place: dict[Cell, LiveTile] = {}
        self._by_stamp: dict[int, LiveTile] = {}
        self._touched = CellTable(-math.inf)
        self._widest = max(Buffer.of(config.buffer))
        self.changed: set[Cell] = set()

    def __len__(self) -> int:
        """Return the number of tiles."""
        return len(self._by_place)

    def __getitem__(self, place: Cell) -> LiveTile:
        """Return the tile of a place."""
        return self._by_place[place]

    def of_stamp(self, stamp: int) -> LiveTile | None:
        """Return the tile of a stamp, whatever the revision."""
        return self._by_stamp.get(tile_of(stamp))

    def missing(self, cells: Iterable[Cell]) -> set[Cell]:
        """Return the places of the tiles of some cells that there are not yet."""
        return {self._grid.tile_of(cell) for cell in cells} - self._by_place.keys()

    def make(self, place: Cell, gps_time: float) -> None:
        """Make a tile of which the first point has come; neighbours' points may have come before."""
        block = self._grid.block_of(place)
        buffer = Buffer.of(self._config.buffer)
        near = self._near(block, buffer)
        stamp = stamp_of_time(gps_time, is_standard=True) or stamp_of_number(len(self) + 1)
        tile = LiveTile(place, self._free(stamp), block, buffer, near)
        self._by_place[place] = self._by_stamp[tile.stamp] = tile

    def n_near(self, tile: LiveTile) -> int:
        """Count the points of a tile and its buffer."""
        return self._count_in(tile.near.cells)

    def widen(self, tile: LiveTile, buffer: Buffer) -> None:
        """Have points count for a tile that fall into a wider buffer, as it was made with that."""
        n_before = self.n_near(tile)
        tile.buffer = buffer
        tile.near = Block.around([tile.near, self._near(tile.block, buffer)])
        tile.n_sent += self.n_near(tile) - n_before
        self._widest = max(self._widest, *buffer)

    def touch(self, cells: Iterable[Cell], now: float) -> None:
        """Note that points fell into cells."""
        k = self._grid.cells_per_side
        reach = math.ceil(self._widest / self._grid.cell_size) + 1
        for cell in cells:
            self._touched[cell] = now
            columns, rows = (range((one - reach) // k, (one + reach) // k + 1) for one in cell)
            seen = {(column, row) for column in columns for row in rows}
            self.changed |= seen & self._by_place.keys()

    def last_touched(self, tile: LiveTile) -> float:
        """Return when a point has fallen into a tile or its buffer last."""
        return max(self._touched[cell] for cell in tile.near.cells)

    def has_gaps(self, tile: LiveTile) -> tuple[bool, bool]:
        """Whether cells have had no point in a tile, and in it or its buffer: later passes may fill them."""
        own, near = (
            any(self._touched[cell] == -math.inf for cell in one.cells) for one in (tile.block, tile.near)
        )
        return own, near

    def next_of(self, ready: Iterable[Cell]) -> LiveTile:
        """Return the tile that goes first: without gaps, then with gaps in its buffer, then longest left."""
        tiles = (self._by_place[place] for place in ready)
        return min(tiles, key=lambda tile: (self.has_gaps(tile), self.last_touched(tile)))

    def is_due(self, place: Cell, now: float, sensor: NDArray[np.float64] | None) -> bool:
        """
        Whether no point has fallen into a tile or its buffer for long enough, or the sensor is far away.

        With half of `_FEW` new points it waits twice as long, and so on. The sensor, at a source's position
        [m] if it is known, ends the waiting once.
        """
        config, tile = self._config, self._by_place[place]
        share_new = 1.0 - max(tile.n_sent, 0) / max(self.n_near(tile), 1)
        weight = min(share_new / _FEW, 1.0)
        if (now - self.last_touched(tile)) * weight >= config.leave_after:
            return True
        if tile.revision >= 0 or sensor is None or not config.leave_distance:
            return False
        area = self._grid.area_of(tile.block).buffered(Buffer.of(config.buffer)).grown(config.leave_distance)
        return not area.touches(Rectangle(*sensor[:2], *sensor[:2]))

    def take_up(self, last: dict[Cell, dict[str, Any]]) -> None:
        """Give tiles the stamps and revisions that they had in an earlier life."""
        for place in last.keys() & self._by_place.keys():
            tile, event = self._by_place[place], last[place]
            tile.stamp, tile.revision, tile.n_sent = event["stamp"], event["revision"], event["n_done"]
        self._by_stamp.clear()
        for tile in sorted(self._by_place.values(), key=lambda one: (one.revision < 0, one.place)):
            tile.stamp = self._free(tile.stamp)
            self._by_stamp[tile.stamp] = tile

    def _near(self, block: Block, buffer: Buffer) -> Block:
        return self._grid.block_in(self._grid.area_of(block).buffered(buffer))

    def _free(self, stamp: int) -> int:
        """Return the next stamp that no tile has."""
        while stamp in self._by_stamp:
            stamp += STEP
        return stamp
