"""A plan for robots: where walls stand, where there is open ground, and of what nothing is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.facades.finding import MIN_HEIGHT

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Side of a cell [m]: twice that of the voxels in which walls are looked for, a tenth of a vehicle's width.
RESOLUTION = 0.2
#: What is said of a cell, as in nav_msgs/OccupancyGrid.
WALL, OPEN, UNKNOWN = 100, 0, -1
#: What is higher above ground stands in nobody's way: crowns, eaves, the vaults of arcades [m].
CLEARANCE = 2.5
#: Cells of a map at most; with more their side is doubled.
_MOST_CELLS = 2**24
#: Places on a foot line that are asked for their cells, per side of a cell.
_STEPS = 8


class WallMap(NamedTuple):
    """A rectangle of cells whose edges are multiples of `resolution` in the map frame."""

    resolution: float  #: side of a cell [m]
    west: float  #: south-western corner [m]
    south: float
    elevation: float  #: of the ground, in the middle [m]
    cells: NDArray[np.int8]  #: `WALL`, `OPEN` or `UNKNOWN`, the southernmost row first


def wall_map(
    points: Floats, height_above_ground: Floats, is_ground: Bools, is_core: Bools, facades: Sequence[Facade]
) -> WallMap | None:
    """
    Map the foot lines of façades, and the ground that was seen between them; None if the core has neither.

    - `points`, shape (n_points, 3): What was seen from the street [m].
    - `height_above_ground`, shape (n_points,): [m].
    - `is_ground`, shape (n_points,): True for points on the terrain.
    - `is_core`, shape (n_points,): The map reaches as far as these, and façades of the core; what else
      stands there is in it, too.
    - `facades`: As found in these points.

    What stands on the ground and is no wall (a car, a hedge) makes its cells unknown: it may be gone the next
    time.
    """
    ground = points[is_ground & is_core]
    reached = np.concatenate([ground[:, :2], *(one.foot for one in facades if one.is_core)])
    if not len(reached):
        return None
    side, low, high = RESOLUTION, reached.min(axis=0), reached.max(axis=0)
    while np.prod((high - low) / side + 2.0) > _MOST_CELLS:
        side *= 2.0
    first, last = (np.floor(end / side).astype(np.int64) for end in (low, high))
    cells = np.full((last - first + 1)[::-1], UNKNOWN, dtype=np.int8)
    stands = ~is_ground & (height_above_ground >= MIN_HEIGHT) & (height_above_ground < CLEARANCE)
    feet = shapely.segmentize([shapely.LineString(one.foot) for one in facades], side / _STEPS)
    for value, xy in ((OPEN, ground), (UNKNOWN, points[stands]), (WALL, shapely.get_coordinates(feet))):
        at = np.floor(xy[:, :2] / side).astype(np.int64) - first
        column, row = at[((at >= 0) & (at <= last - first)).all(axis=1)].T
        cells[row, column] = value
    west, south = (first * side).tolist()
    elevation = float(np.median(ground[:, 2])) if len(ground) else min(one.bottom for one in facades)
    return WallMap(side, west, south, elevation, cells)
