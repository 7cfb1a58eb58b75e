"""Wide roofs among what was taken for ground: plates that end in a step nearly all round."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.neighbours.union_find import numbered, sets_of_pairs
from lidar_buildings.core.surfaces.elevation_raster import nearest_filled

#: Neighbouring cells whose elevations differ by more are of two plates [m]: a storey, more than a bank has.
STEP = 3.0
#: Share of a plate's sides that have to fall by a step; and what those at the edge of the data, which show
#: no step nor its absence, weigh in it.
MIN_FALLS, UNSEEN_WEIGHT = 0.8, 0.5
#: Side of a cell: so many spacings, and at least so many metres.
CELL_SPACINGS, MIN_CELL = 2.0, 2.0
#: Longer gaps without any point are shortened to so many cells, and cells are doubled beyond so many.
LONGEST_GAP, MAX_CELLS = 8, 4_000_000


def on_raised_plates(
    points: NDArray[np.float64], ground: NDArray[np.bool_], spacing: float
) -> NDArray[np.bool_]:
    """
    Tell which points, taken for ground, lie on roofs: on plates whose sides fall by a step nearly all round.

    A wall is abrupt and a hillside is not (after Chen et al. 2007), whatever its height and the width of
    what it bears. Plates are what smaller steps than `STEP` connect. Cells without ground count to the
    nearest with, so that trees and buildings along a wall do not hide it. Beside a roof that was found lower
    parts of the same building are looked at without that side.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Gross errors removed [m].
    ground : ndarray of shape (n_points,), bool
        What is ground so far; at least one.
    spacing : float
        Of the points [m].
    """
    place, shape = _places(points, max(CELL_SPACINGS * spacing, MIN_CELL))
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest.ravel(), place[ground], points[ground, 2])
    surface = nearest_filled(lowest, np.isfinite(lowest))
    is_raised = _is_raised(surface)
    if not is_raised.any():
        return np.zeros(len(points), dtype=bool)
    # A roof's rim shares cells with the ground below it.
    roofs = ndimage.minimum_filter(np.where(is_raised, surface, np.inf), 3, mode="nearest").ravel()[place]
    above = points[:, 2] - surface.ravel()[place]
    is_rim = (above > STEP) & (points[:, 2] >= roofs - STEP)
    return np.asarray(ground & (is_raised.ravel()[place] | is_rim))


def _places(points: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """Return the cell of each point in a raster, row by row, and its shape; far points take no room."""
    while True:
        (rows, n_rows), (columns, n_columns) = (_squeezed(points[:, axis], cell) for axis in (1, 0))
        if n_rows * n_columns <= MAX_CELLS:
            return rows * n_columns + columns, (n_rows, n_columns)
        cell *= 2.0


def _squeezed(coordinate: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int64], int]:
    """Return in which row each coordinate lies, and how many rows there are, long gaps shortened."""
    taken, at = np.unique(np.floor(coordinate / cell), return_inverse=True)
    row = np.cumsum(np.minimum(np.diff(taken, prepend=taken[0]), LONGEST_GAP)).astype(np.int64)
    return row[at], int(row[-1]) + 1


def _is_raised(surface: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which cells of a raster are of plates that stand out."""
    number = np.arange(surface.size).reshape(surface.shape)
    one = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
    other = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
    rise = surface.ravel()[one] - surface.ravel()[other]
    is_step = np.abs(rise) > STEP
    plate = numbered(sets_of_pairs(surface.size, one[~is_step], other[~is_step]))
    high = plate[np.where(rise > 0.0, one, other)[is_step]]
    low = plate[np.where(rise > 0.0, other, one)[is_step]]
    parted = high != low
    high, low, n = high[parted], low[parted], int(plate.max()) + 1
    edge = np.concatenate([number[0], number[-1], number[:, 0], number[:, -1]])
    unseen = UNSEEN_WEIGHT * np.bincount(plate[edge], minlength=n)
    raised = np.zeros(n, dtype=bool)
    while True:
        falls = np.bincount(high[~raised[low]], minlength=n)
        rises = np.bincount(low[~raised[high]], minlength=n)
        found = ~raised & (falls > 0) & (falls >= MIN_FALLS * (falls + rises + unseen))
        if not found.any():
            return np.asarray(raised[plate].reshape(surface.shape))
        raised |= found
