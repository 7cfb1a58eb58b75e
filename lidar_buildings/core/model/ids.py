"""Ids of buildings that stay the same however the data are cut into tiles; a tile's key and its revisions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Side of the cell that an id names [m]: finer than the distance of two buildings' anchors.
CELL = 0.5
#: Stamps of tiles are multiples of this, so that there is room for a tile's revisions between them [ns].
STEP = 1_000


def anchor_row(points: NDArray[np.float64]) -> int:
    """Return the row of a building's anchor: its westernmost point, ties broken by y, then z."""
    x = points[:, 0]
    west = np.flatnonzero(x == x.min())
    return int(west[np.lexsort((points[west, 2], points[west, 1]))[0]])


def building_id(anchor: NDArray[np.float64]) -> int:
    """
    Return the id (1 to 2³² − 1) of the building with this anchor, map frame [m].

    The low halves of the anchor's cell numbers stand in the id's two 16-bit halves, so that ids differ
    within 32 km of each other.
    """
    column, row = (int(np.floor(c / CELL)) & 0xFFFF for c in anchor[:2])
    return (column << 16 | row) or 0xFFFFFFFF


def rows_by_building(building_id: NDArray[np.uint32]) -> list[tuple[int, NDArray[np.intp]]]:
    """Return (id, rows) of every building by rising id, rows rising; id 0 is left out."""
    order = np.argsort(building_id, kind="stable")
    numbers, first = np.unique(building_id[order], return_index=True)
    groups = np.split(order, first[1:]) if len(numbers) else []
    return [(int(number), rows) for number, rows in zip(numbers, groups, strict=True) if number]


def anchor_near(number: int, place: NDArray[np.float64]) -> tuple[float, float]:
    """
    Return the position that a building's id was made from, as far as the id tells, in the map frame [m].

    That is `place`, x and y less than 16 km away, such as the westernmost point, if it lies in the id's cell;
    else the middle of that cell.
    """
    x, y = float(place[0]), float(place[1])
    if building_id(np.array([x, y])) == number:
        return x, y
    return _middle(number >> 16, x), _middle(number & 0xFFFF, y)


def _middle(low_half: int, near: float) -> float:
    """Return the middle of the cell nearest to a coordinate whose number ends with these 16 bits [m]."""
    cell = int(np.floor(near / CELL))
    away = ((low_half - cell + 0x8000) & 0xFFFF) - 0x8000
    return (cell + away + 0.5) * CELL


def readable_id(anchor_x: float, anchor_y: float) -> str:
    """Return the id that files carry, made from the anchor's coordinates in the source's reference system."""
    return f"building-{anchor_x:.1f}-{anchor_y:.1f}"


def tile_of(stamp: int) -> int:
    """Return the stamp of the first revision of a tile, by which it is known as a whole [ns]."""
    return stamp - stamp % STEP
