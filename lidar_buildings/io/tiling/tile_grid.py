"""The grid of tiles: squares that begin at multiples of their size, in metres of the source, or half-way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.io.clouds.cloud import CloudExtent
from lidar_buildings.io.tiling.tile_stamps import LATEST

#: A cell's column and row in the grid.
Cell = tuple[int, int]
#: Cells along a side of what is held as one.
_SIDE = 16


class CellTable:
    """A number for each cell in a few bytes, as a feed may go on for hours; `missing` where none is given."""

    def __init__(self, missing: float) -> None:
        self._missing = missing
        self._squares: dict[Cell, NDArray[np.int64 | np.float64]] = {}

    def __getitem__(self, cell: Cell) -> float:
        """Return a cell's number."""
        square = self._squares.get((cell[0] // _SIDE, cell[1] // _SIDE))
        return self._missing if square is None else square[cell[0] % _SIDE, cell[1] % _SIDE].item()

    def __setitem__(self, cell: Cell, number: float) -> None:
        """Give a cell a number."""
        place = cell[0] // _SIDE, cell[1] // _SIDE
        if place not in self._squares:
            self._squares[place] = np.full((_SIDE, _SIDE), self._missing)
        self._squares[place][cell[0] % _SIDE, cell[1] % _SIDE] = number

    def __iter__(self) -> Iterator[Cell]:
        """Iterate over the cells that have numbers."""
        for (column, row), square in self._squares.items():
            for x, y in np.argwhere(square != self._missing).tolist():
                yield column * _SIDE + x, row * _SIDE + y

    def part(self, cells: Iterable[Cell]) -> CellTable:
        """Return a table of some cells alone."""
        found = CellTable(self._missing)
        for cell in cells:
            if (number := self[cell]) != self._missing:
                found[cell] = number
        return found


#: Smallest side of a spool cell [m].
_SMALLEST_CELL = 5.0
#: More spool cells per side of a tile than this make too many small files.
_MOST_CELLS = 8
#: Bounds that span more tiles than this are wrong, or of a few points far apart.
MOST_TILES = 100_000
#: How much of a buffer's width lies west, south, east and north of a tile. A block belongs to the tile that
#: holds its westernmost point: it reaches farthest beyond it eastwards, and not at all westwards, where it is
#: only seen that nothing touches it, and what the ground around is.
BUFFER_SHARES = (1.0 / 3.0, 2.0 / 3.0, 1.0, 2.0 / 3.0)


class Buffer(NamedTuple):
    """How far a tile's buffer reaches on each side [m]."""

    west: float
    south: float
    east: float
    north: float

    @classmethod
    def of(cls, width: float) -> Buffer:
        """Return a buffer of a width, see `BUFFER_SHARES` [m]."""
        return cls(*(share * width for share in BUFFER_SHARES))

    @classmethod
    def largest(cls, width: float) -> Buffer:
        """Return the largest buffer of a tile that grows [m]: what it grows for may lie on any side."""
        return cls(width, width, width, width)

    def doubled(self, sides: Sides, least: float, most: float) -> Buffer:
        """Return it twice as wide on some sides: `least` [m] where there was none, and at most `most` [m]."""
        limits = zip(self, Buffer.of(least), Buffer.largest(most), sides, strict=True)
        return Buffer(*(min(2.0 * own or low, high) if wider else own for own, low, high, wider in limits))


class Rectangle(NamedTuple):
    """An axis-parallel rectangle, edges included [m]."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @classmethod
    def around(cls, rectangles: Sequence[Rectangle]) -> Rectangle:
        """Return the smallest rectangle that holds others, of which there is at least one."""
        west, south, east, north = zip(*rectangles, strict=True)
        return cls(min(west), min(south), max(east), max(north))

    @classmethod
    def of_cloud(cls, cloud: CloudExtent) -> Rectangle | None:
        """Return a cloud's bounds, None if it holds no point."""
        if not cloud.point_count:
            return None
        unit = cloud.crs.horizontal_unit
        return cls(*(float(c) for c in (*(cloud.mins[:2] * unit), *(cloud.maxs[:2] * unit))))

    def grown(self, distance: float) -> Rectangle:
        """Return the rectangle with every side moved outwards."""
        return self.buffered(Buffer.largest(distance))

    def buffered(self, buffer: Buffer) -> Rectangle:
        """Return the rectangle of a tile with its buffer."""
        west, south, east, north = buffer
        return Rectangle(self.x_min - west, self.y_min - south, self.x_max + east, self.y_max + north)

    def moved(self, x: float, y: float) -> Rectangle:
        """Return the rectangle moved by (x, y)."""
        return Rectangle(self.x_min + x, self.y_min + y, self.x_max + x, self.y_max + y)

    def touches(self, other: Rectangle) -> bool:
        """Whether both share a point."""
        return (
            self.x_min <= other.x_max
            and other.x_min <= self.x_max
            and self.y_min <= other.y_max
            and other.y_min <= self.y_max
        )

    def holds(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which points lie within."""
        return (x >= self.x_min) & (x <= self.x_max) & (y >= self.y_min) & (y <= self.y_max)


class Block(NamedTuple):
    """Some columns and rows of spool cells: a tile, or a part of one."""

    column: int
    row: int
    width: int
    height: int

    @classmethod
    def around(cls, blocks: Sequence[Block]) -> Block:
        """Return the smallest block that holds others, of which there is at least one."""
        column, row = min(one.column for one in blocks), min(one.row for one in blocks)
        width = max(one.column + one.width for one in blocks) - column
        return cls(column, row, width, max(one.row + one.height for one in blocks) - row)

    @property
    def cells(self) -> list[Cell]:
        """Its cells."""
        columns = range(self.column, self.column + self.width)
        return [(x, y) for x in columns for y in range(self.row, self.row + self.height)]

    @property
    def quarters(self) -> list[Block]:
        """Its parts, about as wide as high; the block itself if it is a single cell."""
        columns = [(self.column, self.width - self.width // 2)]
        columns += [(self.column + columns[0][1], self.width // 2)] * (self.width > 1)
        rows = [(self.row, self.height - self.height // 2)]
        rows += [(self.row + rows[0][1], self.height // 2)] * (self.height > 1)
        return [Block(x, y, width, height) for x, width in columns for y, height in rows]


@dataclass(frozen=True)
class TileGrid:
    """Tiles of `tile_size`, each split into spool cells so that a buffer reads little more than itself."""

    tile_size: float  #: side of a tile [m]
    cells_per_side: int  #: spool cells along a tile's side
    start: float = 0.0  #: where a tile begins, in x and in y; 0 or half a side, so that it is exact [m]

    @classmethod
    def fitting(cls, tile_size: float, buffer: float, start: float = 0.0) -> TileGrid:
        """Return the grid whose spool cells are about as wide as the buffer."""
        wanted = tile_size / max(buffer, _SMALLEST_CELL)
        return cls(tile_size, max(1, min(_MOST_CELLS, math.floor(wanted))), start)

    @property
    def cell_size(self) -> float:
        """Side of a spool cell [m]."""
        return self.tile_size / self.cells_per_side

    def cells_at(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the spool cell of each point, shape (n, 2)."""
        return np.floor((xy - self.start) / self.cell_size).astype(np.int64)

    def tile_of(self, cell: Cell) -> Cell:
        """Return the tile that a spool cell belongs to."""
        return cell[0] // self.cells_per_side, cell[1] // self.cells_per_side

    def block_of(self, tile: Cell) -> Block:
        """Return the spool cells of a tile."""
        k = self.cells_per_side
        return Block(tile[0] * k, tile[1] * k, k, k)

    def cells_touching(self, area: Rectangle) -> Iterator[Cell]:
        """Name the spool cells that reach into an area."""
        # points on a border may have been rounded across it: one cell more on each side costs nothing
        x0, y0 = (math.floor(c - 1e-6) for c in self._in_cells(area.x_min, area.y_min))
        x1, y1 = (math.floor(c + 1e-6) for c in self._in_cells(area.x_max, area.y_max))
        for x in range(x0, x1 + 1):
            for y in range(y0, y1 + 1):
                yield x, y

    def block_in(self, area: Rectangle) -> Block:
        """Return the spool cells that have a part within an area, not those that only share its border."""
        x0, y0 = (math.floor(c + 1e-6) for c in self._in_cells(area.x_min, area.y_min))
        x1, y1 = (math.ceil(c - 1e-6) for c in self._in_cells(area.x_max, area.y_max))
        return Block(x0, y0, x1 - x0, y1 - y0)

    def area_of(self, block: Block) -> Rectangle:
        """Return where a block's cells lie in source coordinates [m]."""
        k, size = self.cells_per_side, self.tile_size
        # in tiles first: a whole tile's edges are multiples of its size to the last bit
        west, south = block.column / k * size, block.row / k * size
        east, north = (block.column + block.width) / k * size, (block.row + block.height) / k * size
        return Rectangle(west, south, east, north).moved(self.start, self.start)

    def tile_span(self, area: Rectangle) -> tuple[Cell, Cell]:
        """Return the first and the last tile, column and row, that reach into an area."""
        within, size = area.moved(-self.start, -self.start), self.tile_size
        first = math.floor(within.x_min / size), math.floor(within.y_min / size)
        return first, (math.floor(within.x_max / size), math.floor(within.y_max / size))

    def tiles_touching(self, areas: Iterable[Rectangle]) -> set[Cell]:
        """Name the tiles that reach into areas, those left out that say nothing as they span too many."""
        found: set[Cell] = set()
        for area in areas:
            (x0, y0), (x1, y1) = self.tile_span(area)
            if (x1 - x0 + 1) * (y1 - y0 + 1) <= MOST_TILES:
                found.update((x, y) for x in range(x0, x1 + 1) for y in range(y0, y1 + 1))
        return found

    def number_of(self, tile: Cell, area: Rectangle) -> int:
        """Number a tile from 1 by its place within an area; 1 for a place outside it."""
        (x0, y0), (x1, y1) = self.tile_span(area)
        number = (tile[0] - x0) * (y1 - y0 + 1) + tile[1] - y0 + 1
        is_counted = x0 <= tile[0] <= x1 and y0 <= tile[1] <= y1 and number < LATEST
        return number if is_counted else 1

    def _in_cells(self, *coordinates: float) -> Iterator[float]:
        return ((one - self.start) / self.cell_size for one in coordinates)
