"""Which cells of a raster are known: closing, and distances between cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.surfaces.morphology import square_distances

#: Cells that share a side or a corner belong together.
ADJACENT = np.ones((3, 3), dtype=bool)


def closed(occupied: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """
    Close the gaps between occupied cells into which no circle fits (morphological closing, Serra 1982).

    A cell stays unknown where a circle of this radius that holds no occupied cell covers it. Nothing is added
    beyond the outline of the data: a straight edge stays where it is. Cells are known to half their side
    only, so circles keep half a cell away from occupied ones, lest every gap in an edge stay open. At least
    `reach` + 1 cells on each side are empty.
    """
    near = squared_distance(occupied, reach) <= reach * (reach + 1)  # (reach + ½)² in whole cells
    return squared_distance(~near, reach) > reach * reach


def regions_touching(cells: NDArray[np.bool_], chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the connected regions, corners included, of some cells that have a chosen one."""
    number, n_regions = ndimage.label(cells, ADJACENT)
    is_touching = np.zeros(n_regions + 1, dtype=bool)
    is_touching[number[chosen]] = True
    is_touching[0] = False
    return is_touching[number]


def squared_distance(marked: NDArray[np.bool_], reach: int) -> NDArray[np.int32]:
    """
    Return each cell's squared distance to the nearest marked cell, both by their middles, in cells.

    Exact up to `reach` cells; beyond it, (`reach` + 1)² stands.
    """
    distances: NDArray[np.int32] = square_distances(marked.view(np.uint8), 1, reach)
    return distances
