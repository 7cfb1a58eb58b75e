"""Buildings that share a wall, merged into blocks: lidar cannot tell them apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.evaluation.scores.polygons import valid_polygons

#: Walls so near to each other are one: maps are drawn to centimetres [m].
TOUCHING = 0.05
#: A shorter stretch of contact is a corner, not a wall: square corners that meet share some 0.1 m [m].
MIN_WALL = 0.5


@dataclass(frozen=True, eq=False)
class Blocks:
    """Buildings merged where they share a wall."""

    #: In the order of each block's first building; a building that touches none is unchanged;
    #: shapely geometries, shape (n_blocks,).
    polygons: NDArray[Any]
    block: NDArray[np.int64]  #: row of the block that each building belongs to, shape (n_buildings,)


def merge_touching(buildings: ArrayLike) -> Blocks:
    """
    Merge buildings that touch along a line, or overlap, into blocks.

    Two buildings, invalid ones repaired, belong together if the outline of one runs within `TOUCHING` of the
    other for at least half a metre. Those that meet at a corner only stay apart. Gaps in a block are closed.
    """
    given = valid_polygons(buildings)
    # A set is named by its first row: blocks come in the order of these.
    block = np.unique(sets_of_pairs(len(given), *_touching_pairs(given)), return_inverse=True)[1]
    members = [given[rows] for rows in np.split(np.argsort(block, kind="stable"), _ends(block))]
    merged = [one[0] if len(one) == 1 else _closed(one) for one in members if len(one)]
    return Blocks(np.array(merged, dtype=object), block)


def _touching_pairs(polygons: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of polygons that share a wall, pair by pair."""
    one, other = shapely.STRtree(polygons).query(polygons, predicate="dwithin", distance=TOUCHING)
    one, other = one[one != other], other[one != other]
    near = shapely.intersection(shapely.boundary(polygons[one]), shapely.buffer(polygons[other], TOUCHING))
    shares_wall = shapely.length(near) >= MIN_WALL
    return one[shares_wall], other[shares_wall]


def _ends(block: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return where each block but the last one ends among its sorted members."""
    return np.asarray(np.cumsum(np.bincount(block))[:-1], dtype=np.int64)


def _closed(members: NDArray[Any]) -> Any:
    grown = shapely.union_all(shapely.buffer(members, TOUCHING / 2, join_style="mitre"))
    shrunk = shapely.buffer(grown, -TOUCHING / 2, join_style="mitre")
    return shapely.union_all([*members, shrunk])
