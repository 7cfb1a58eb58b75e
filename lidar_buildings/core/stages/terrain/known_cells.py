"""Which cells of a raster are known: closing, and distances between cells."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def closed(occupied: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """
    Close the gaps between occupied cells into which no circle fits (morphological closing, Serra 1982).

    A cell stays unknown where a circle of this radius that holds no occupied cell covers it. Nothing is added
    beyond the outline of the data: a straight edge stays where it is. Cells are known to half their side
    only, so circles keep half a cell away from occupied ones, lest every gap in an edge stay open.

    Parameters
    ----------
    occupied : ndarray of bool, shape (height, width)
        With at least `reach` + 1 empty cells on each side.
    reach : int
        Radius in cells.
    """
    near = squared_distance(occupied, reach) <= reach * (reach + 1)  # (reach + ½)² in whole cells
    return squared_distance(~near, reach) > reach * reach


@njit(cache=True, nogil=True)
def squared_distance(marked, reach):  # type: ignore[no-untyped-def]
    """
    Return each cell's squared distance to the nearest marked cell, both by their middles, in cells.

    Exact up to `reach`; beyond it, (`reach` + 1)² stands. First along columns, then along rows (Saito &
    Toriwaki 1994); O(cells × reach) at worst. SciPy's `distance_transform_edt` takes 2 to 4 times as long
    (1.2 M cells, reach 40: 0.08 to 0.11 s instead of 0.03 s).

    Parameters
    ----------
    marked : ndarray of bool, shape (height, width)
        The cells to measure from.
    reach : int
        Largest distance that matters, in cells.

    Returns
    -------
    ndarray of int32, shape (height, width)
    """
    height, width = marked.shape
    far = reach + 1
    along = np.empty((height, width), dtype=np.int32)
    for column in range(width):
        steps = far
        for row in range(height):
            steps = 0 if marked[row, column] else min(steps + 1, far)
            along[row, column] = steps
        steps = far
        for row in range(height - 1, -1, -1):
            steps = 0 if marked[row, column] else min(steps + 1, far)
            along[row, column] = min(along[row, column], steps)
    squared = np.empty((height, width), dtype=np.int32)
    for row in range(height):
        for column in range(width):
            squared[row, column] = _nearest_in_row(along[row], column, far)
    return squared


@njit(cache=True, nogil=True)
def _nearest_in_row(along, column, far):  # type: ignore[no-untyped-def]
    """Return the least squared distance over the columns of a row, going outwards until none can be less."""
    best = min(along[column] ** 2, far * far)
    for step in range(1, far):
        if step * step >= best:
            break
        if column >= step:
            best = min(best, step * step + along[column - step] ** 2)
        if column + step < len(along):
            best = min(best, step * step + along[column + step] ** 2)
    return best
