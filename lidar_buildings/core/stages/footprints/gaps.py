"""Where a footprint has no roof points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

#: Smallest side of a cell [m], and its side for sparse points [spacings]: a roof leaves no such cell empty.
_CELL, _CELL_SPACINGS = 1.0, 2.0
_EIGHT = np.ones((3, 3), dtype=bool)


def in_gaps(
    xy: NDArray[np.float64], is_roof: NDArray[np.bool_], spacing: float | None, min_area: float
) -> NDArray[np.bool_]:
    """
    Tell which points lie where roof points are missing, in places of some extent.

    Cells that hold points, but neither roof points nor a neighbour with such, are gathered; where enough
    hang together, they and the cells without roof points around them are a gap. Cells are aligned to the
    map's origin.

    Parameters
    ----------
    xy : ndarray of shape (n_points, 2)
        Points of one footprint [m].
    is_roof : ndarray of shape (n_points,)
    spacing : float or None
        Of the points [m].
    min_area : float
        Smallest extent of a gap without its rim [m²].
    """
    side = max(_CELL, _CELL_SPACINGS * (spacing or 0.0))
    cells = np.floor(xy / side).astype(np.int64)
    cells -= cells.min(axis=0) - 1
    shape = tuple(cells.max(axis=0) + 2)
    column, row = cells.T
    roof, held = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    roof[column[is_roof], row[is_roof]] = True
    held[column, row] = True
    number, n_gaps = ndimage.label(held & ~ndimage.binary_dilation(roof, _EIGHT), _EIGHT)
    n_cells = np.bincount(number.ravel(), minlength=n_gaps + 1)
    is_large = n_cells * side**2 >= min_area
    is_large[0] = False
    gaps = ndimage.binary_dilation(is_large[number], _EIGHT) & ~roof
    inside: NDArray[np.bool_] = gaps[column, row]
    return inside
