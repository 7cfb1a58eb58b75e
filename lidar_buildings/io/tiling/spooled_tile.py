"""Tiles whose points wait on disk, and how they are put together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.io.clouds.point_columns import last_returns, without_empty_columns
from lidar_buildings.io.tiling.cell_table import Cell
from lidar_buildings.io.tiling.spool import RECORD, order_key
from lidar_buildings.io.tiling.tile_grid import Block, Buffer, Rectangle
from lidar_buildings.io.tiling.tile_store import TileStore


@dataclass
class SpooledTile:
    """A tile that is ready to be read; it can be sent to another process that sees the store's folder."""

    store: TileStore
    stamp: int  #: the tile's key [ns]
    block: Block
    core: dict[Cell, tuple[int, int]]  #: spool cell → first and last (exclusive) record of its core points
    #: The strip of neighbours that comes with it, and how wide it may grow [m].
    buffer: Buffer
    max_buffer: float
    dark_limit: float | None = None  #: what was known of the survey's ground when the tile became ready

    def area(self, buffer: Buffer) -> Rectangle:
        """Return where the points of the tile lie in the map frame, with a buffer [m]."""
        return self.store.in_map(self._area(buffer))

    @property
    def largest(self) -> Buffer:
        """The widest buffer that it may have."""
        return Buffer.largest(self.max_buffer)

    def alone(self) -> SpooledTile:
        """Return the tile without what it can never need: little to send to another process."""
        return replace(self, store=self.store.part_of(self._cells(self.largest)))

    def read(self) -> PointTile:
        """Return the tile, rows in the order of (source, index)."""
        columns = self._gathered()
        order = np.argsort(order_key(columns), kind="stable")
        for name, column in columns.items():
            columns[name] = column.take(order, axis=0)
        del order, column
        points, is_buffer = columns.pop("points"), columns.pop("buffer")
        kept = without_empty_columns(columns)
        last = last_returns(points, kept["return_number"], kept["number_of_returns"])
        spacing = steady_spacing(last, self.store.spacing)
        del last
        brightness = self.store.brightness
        return PointTile(
            points,
            buffer=is_buffer,
            point_spacing=spacing,
            normalised_intensity=brightness.normalised(columns["intensity"], columns["point_source_id"]),
            dark_limit=self.dark_limit,
            stamp=self.stamp,
            bounds=tuple(self.area(self.buffer)),
            frame=self.store.frame,
            **kept,
        )

    def grow(self, sides: Sides = ALL) -> bool:
        """
        Double the buffer on some sides, up to the largest, until it brings more points; False if none does.
        """
        n_before, buffer = self._count(self.buffer), self.buffer
        while (wider := buffer.doubled(sides, self.store.grid.cell_size, self.max_buffer)) != buffer:
            if self._count(wider) > n_before:
                self.buffer = wider
                return True
            buffer = wider
        return False

    def _count(self, buffer: Buffer) -> int:
        return sum(len(block) for block, _ in self._blocks(buffer))

    def _area(self, buffer: Buffer) -> Rectangle:
        return self.store.grid.area_of(self.block).buffered(buffer)

    def _cells(self, buffer: Buffer) -> list[Cell]:
        """Return the cells of its core points, and those that its buffer reaches into, each once."""
        return list(dict.fromkeys([*self.core, *self.store.grid.cells_touching(self._area(buffer))]))

    def _gathered(self) -> dict[str, NDArray[Any]]:
        """Read points and columns with the buffer; `buffer` is 1 for points that belong to that."""
        # room for all of the cells' records: what stays empty is never touched, so it takes no memory
        n = self.store.count_in(self._cells(self.buffer))
        names = RECORD.names[3:]
        columns = {name: np.empty(n, RECORD[name]) for name in names}
        columns |= {"points": np.empty((n, 3), np.float32), "buffer": np.empty(n, np.uint8)}
        n = 0
        for block, kind in self._blocks(self.buffer):
            rows = slice(n, n := n + len(block))
            for name in names:
                columns[name][rows] = block[name]
            for axis, name in enumerate("xyz"):
                columns["points"][rows, axis] = block[name]
            columns["buffer"][rows] = kind
        return {name: column[:n] for name, column in columns.items()}

    def _blocks(self, buffer: Buffer) -> Iterator[tuple[NDArray[Any], int]]:
        """Read the records with a buffer: (records, 0 for core points or 1)."""
        near = self.area(buffer)
        for cell in self._cells(buffer):
            first, last = self.core.get(cell, (0, 0))
            for block in self.store.blocks(cell, first, last):
                yield block, 0
            for start, end in ((0, first), (last, None)):
                for block in self.store.blocks(cell, start, end):
                    yield block.compress(near.holds(block["x"], block["y"])), 1
