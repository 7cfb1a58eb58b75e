"""The surface that a scanner sees from above, cell by cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.stages.terrain.cells import CellContents, CellPoints, Cells
from lidar_buildings.core.stages.terrain.known_cells import ADJACENT, closed, regions_touching
from lidar_buildings.core.stages.terrain.window import reach_in_cells

# Chosen by hand on Delft, fusa and Toronto (doc/algorithms/terrain.md).
#: Empty circles up to this radius are chance, not water: so many spacings, and at least so many metres.
_GAP_SPACINGS, _MIN_GAP = 3.0, 1.5
#: A hole lies on the ground if so great a share of the cells round it have points less high than this [m].
_LOW_SHARE, _LOW = 0.05, 1.0


def widest_gap(point_spacing: float, resolution: float) -> int:
    """Return the radius of the largest circle, in cells, that is empty by chance: a gap, and no hole."""
    return reach_in_cells(max(_GAP_SPACINGS * point_spacing, _MIN_GAP), resolution)


def surface_elevations(
    cells: Cells,
    contents: CellContents,
    ground: NDArray[np.float32],
    known: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    gap: int,
) -> NDArray[np.float32]:
    """
    Return the elevation of the surface at the cells that are wanted [m], others' or NaN elsewhere.

    A cell with first returns has the highest of them; where there is none near, later returns stand in. Gaps,
    see `widest_gap`, between such cells are closed by the TIN of the highest points round them. Wider holes
    returned nothing: water and shadow mostly, which take the ground's elevation even where trees line them. A
    hole that only high cells surround is a wet or dark roof, and is closed like a gap. On each side are at
    least as many empty cells as a gap is wide.
    """
    highest = _with_later_returns(cells, contents.first, contents.later, gap)
    measured = highest.mask(cells.window.shape)
    on_ground = _holes_on_ground(contents.lowest, ground, known & ~closed(measured, gap))
    elevation = np.where(on_ground, ground, np.float32(np.nan))
    gaps = regions_touching(known & ~measured & ~on_ground, wanted)
    elevation[gaps] = np.fmax(cells.elevations_at(highest.near(gaps), gaps), ground[gaps])
    elevation[highest.rows, highest.columns] = highest.points[:, 2]
    elevation[~known] = np.nan
    return elevation


def _holes_on_ground(
    lowest: CellPoints, ground: NDArray[np.float32], holes: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return the cells of those holes round which the ground was seen."""
    number, n_holes = ndimage.label(holes, ADJACENT)
    beside = ndimage.maximum_filter(number, footprint=ADJACENT)[lowest.rows, lowest.columns]
    height = lowest.points[:, 2] - ground[lowest.rows, lowest.columns]
    n_beside = np.bincount(beside, minlength=n_holes + 1)
    n_low = np.bincount(beside[height < _LOW], minlength=n_holes + 1)
    is_on_ground = n_low > _LOW_SHARE * n_beside
    is_on_ground[0] = False
    return is_on_ground[number]


def _with_later_returns(cells: Cells, first: CellPoints, later: CellPoints, gap: int) -> CellPoints:
    """Add the later returns of cells that have no first return near."""
    lacking = ~closed(first.mask(cells.window.shape), gap)[later.rows, later.columns]
    return first.joined(later.select(lacking))
