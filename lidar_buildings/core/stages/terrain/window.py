"""Windows of the endless grid of square cells that all rasters of one resolution share."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: A tile of more cells than this is taken for a mistake: some 30 GB; wide margin: 15 km at 0.5 m.
MOST_CELLS = 1_000_000_000


@dataclass(frozen=True)
class RasterWindow:
    """A rectangle of cells; their edges are multiples of the resolution in the source's coordinates."""

    resolution: float  #: side of a cell [m]
    #: Place in the grid of the north-western cell: columns count eastwards and rows southwards from zero, so
    #: that its north-western corner is at (`column`, −`row`) × `resolution`.
    column: int = 0
    row: int = 0
    #: Columns and rows of cells; 0 where there is no cell.
    width: int = 0
    height: int = 0

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of an array with a value per cell: the first row is the northernmost."""
        return self.height, self.width

    @property
    def corner(self) -> tuple[float, float]:
        """The north-western corner in source coordinates [m]."""
        return self.column * self.resolution, -self.row * self.resolution

    def grown(self, n_cells: int) -> RasterWindow:
        """Return the window with so many more cells on each side."""
        column, row = self.column - n_cells, self.row - n_cells
        return RasterWindow(self.resolution, column, row, self.width + 2 * n_cells, self.height + 2 * n_cells)

    def part(self, columns: slice, rows: slice) -> RasterWindow:
        """Return a part of the window, given by slices of its columns and rows with both ends named."""
        column, row = self.column + columns.start, self.row + rows.start
        size = columns.stop - columns.start, rows.stop - rows.start
        return RasterWindow(self.resolution, column, row, *size)

    def shared(self, other: RasterWindow) -> tuple[slice, slice]:
        """Return the rows and columns of this window that another one has as well; empty slices if none."""
        top, left = other.row - self.row, other.column - self.column
        rows = slice(max(top, 0), max(min(top + other.height, self.height), 0))
        columns = slice(max(left, 0), max(min(left + other.width, self.width), 0))
        return rows, columns

    def centres(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64], origin: tuple[float, float]
    ) -> NDArray[np.float64]:
        """Return the middles of cells in the map frame, shape (…, 2) [m]."""
        x = (columns + (self.column + 0.5)) * self.resolution - origin[0]
        y = -(rows + (self.row + 0.5)) * self.resolution - origin[1]
        return np.stack((x, y), axis=-1)


def window_of(extent: NDArray[np.float64], origin: tuple[float, float], resolution: float) -> RasterWindow:
    """
    Return the smallest window that holds all points of an extent, least and greatest x and y.

    `origin` is what to add to map coordinates [m]. ValueError if it has too many cells to be meant.
    """
    # A cell holds its western and its southern edge.
    (west, south), (east, north) = np.floor((extent + origin) / resolution).astype(np.int64).tolist()
    width, height = east - west + 1, north - south + 1
    if width * height > MOST_CELLS:
        raise ValueError(
            f"resolution = {resolution:g}: {width} × {height} cells between these points are more than "
            f"{MOST_CELLS:,}: a larger resolution or smaller tiles are needed"
        )
    return RasterWindow(resolution, west, -1 - north, width, height)


def enclosing(windows: Iterable[RasterWindow]) -> RasterWindow | None:
    """Return the smallest window that holds all those given; None if they have no cell."""
    filled = [window for window in windows if window.width and window.height]
    if not filled:
        return None
    column, row = min(w.column for w in filled), min(w.row for w in filled)
    width = max(w.column + w.width for w in filled) - column
    height = max(w.row + w.height for w in filled) - row
    return RasterWindow(filled[0].resolution, column, row, width, height)


def reach_in_cells(distance: float, resolution: float) -> int:
    """Return how many whole cells a distance spans; rounding must not cost one."""
    return math.floor(distance / resolution + 1e-9)
