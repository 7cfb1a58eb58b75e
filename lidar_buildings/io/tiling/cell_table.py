"""A number for each cell of a grid without bounds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

#: A cell's column and row in the grid.
Cell = tuple[int, int]
#: Cells along a side of what is held as one.
_SIDE = 16


class CellTable:
    """
    A number for each cell, in some bytes, so that a feed may go on for hours; `missing` where none was given.
    """

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
