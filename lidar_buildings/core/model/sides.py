"""The four sides of a tile."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray

#: West, south, east and north limit [m].
Bounds = tuple[float, float, float, float]
_OUTMOST: Bounds = (-np.inf, -np.inf, np.inf, np.inf)


class Sides(NamedTuple):
    """On which sides of a tile something holds; true if on any."""

    west: bool = False
    south: bool = False
    east: bool = False
    north: bool = False

    @classmethod
    def passed(cls, low: FloatArray, high: FloatArray, bounds: Bounds | None, margin: float) -> Sides:
        """
        Return on which sides something comes nearer to a tile's outer limits than a margin, or passes them.

        `low` and `high` are its least and greatest x and y; `bounds` the tile's west, south, east and north
        [m], infinite where nothing lies beyond, None if so all round.
        """
        if bounds is None:
            return NONE
        west_south, east_north = np.array(bounds).reshape(2, 2)
        return cls(*(low - west_south < margin).tolist(), *(east_north - high < margin).tolist())

    def opened(self, bounds: Bounds | None) -> Bounds | None:
        """Return a tile's outer limits without those of these sides; None if there is no limit left."""
        if bounds is None:
            return None
        west, south, east, north = np.where(self, _OUTMOST, bounds).tolist()
        left = west, south, east, north
        return None if left == _OUTMOST else left

    def __bool__(self) -> bool:
        return any(tuple(self))

    def __or__(self, other: Sides) -> Sides:
        return Sides(*(one or another for one, another in zip(self, other, strict=True)))


NONE, ALL = Sides(), Sides(True, True, True, True)
