"""Squares of a quadtree over the map, each of which holds few places."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Squares are not divided further below this side, that of a square of the terrain in models [m].
_SMALLEST = 256.0


class Square(NamedTuple):
    """A square of the map: its south-western corner and its side [m]."""

    west: float
    south: float
    side: float

    def quarters(self) -> Iterator[Square]:
        """Yield its four parts."""
        half = self.side / 2.0
        for west in (self.west, self.west + half):
            for south in (self.south, self.south + half):
                yield Square(west, south, half)

    def holds(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether places lie within, the northern and eastern edge excluded."""
        away = places - [self.west, self.south]
        return ((away >= 0.0) & (away < self.side)).all(axis=1)

    def distance(self, place: NDArray[np.float64]) -> float:
        """Return how far a place is outside [m]."""
        away = np.abs(place - [self.west, self.south] - self.side / 2.0) - self.side / 2.0
        return float(np.hypot(*np.maximum(away, 0.0)))


def squares_of(places: NDArray[np.float64], largest: int) -> list[tuple[Square, NDArray[np.intp]]]:
    """
    Divide places into squares of at most so many, by a quadtree on multiples of 256 m.

    Parameters
    ----------
    places : ndarray of shape (n, 2)
        In the map frame [m]; at least one.
    largest : int
        How many places a square may hold, unless it is of the smallest side.

    Returns
    -------
    list of (Square, ndarray)
        Squares that hold places, and the rows of these; from west to east, then from south to north.
    """
    cells = np.floor(places / _SMALLEST)
    west, south = (cells.min(axis=0) * _SMALLEST).tolist()
    n_cells = int((cells.max(axis=0) - cells.min(axis=0)).max()) + 1
    waiting = [(Square(west, south, _SMALLEST * 2 ** (n_cells - 1).bit_length()), np.arange(len(places)))]
    found = []
    while waiting:
        square, rows = waiting.pop()
        if len(rows) <= largest or square.side <= _SMALLEST:
            found.append((square, rows))
            continue
        for quarter in square.quarters():
            own = rows[quarter.holds(places[rows])]
            if len(own):
                waiting.append((quarter, own))
    return sorted(found, key=lambda one: one[0])
