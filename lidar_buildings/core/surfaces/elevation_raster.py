"""Rasters of elevations: cells without one are filled from those around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.kernels import kernel

#: Rounds of relaxation on each level of filling; more change nothing that a filter would notice.
RELAXATIONS = 2


def nearest_filled(elevation: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the raster with unknown cells filled from the nearest known one; at least one has to be."""
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return elevation[tuple(nearest)]


def filled(
    elevation: NDArray[np.float64], known: NDArray[np.bool_], first: tuple[int, int] = (0, 0)
) -> NDArray[np.float64]:
    """
    Return the raster with unknown cells filled smoothly from the known ones around.

    A pyramid of means fills cell by cell from the coarsest level down, and a few rounds of relaxation on each
    level bring it near to the membrane spanned between the known cells. A slope is bridged as a slope. Cells
    are paired from the grid's origin, in which `first` is the first row and column, so that a window of a
    raster is filled like the whole. ValueError if no cell is known.
    """
    if not known.any():
        raise ValueError("known has no True cell: there is nothing to fill the others from")
    known = np.ascontiguousarray(known)
    out = np.where(known, elevation, 0.0)
    if max(out.shape) <= 2:
        # Cells on either side of the grid's origin are never paired.
        return np.where(known, out, out[known].mean())
    if known.all():
        return out
    coarse, coarse_known = _halved(out, known, first[0] & 1, first[1] & 1)
    if not coarse_known.all():
        coarse = filled(coarse, coarse_known, (first[0] >> 1, first[1] >> 1))
    _refine(coarse, out, known, first[0] & 1, first[1] & 1)
    for _ in range(RELAXATIONS):
        _relax(out, known)
    return out


@kernel
def _halved(elevation, known, odd_row, odd_column):  # type: ignore[no-untyped-def]
    """Return the means of the known cells among each two by two, and where there are any."""
    n_rows, n_columns = elevation.shape
    mean = np.zeros(((n_rows + odd_row + 1) // 2, (n_columns + odd_column + 1) // 2))
    count = np.zeros(mean.shape)
    for y in range(n_rows):
        for x in range(n_columns):
            if known[y, x]:
                mean[(y + odd_row) // 2, (x + odd_column) // 2] += elevation[y, x]
                count[(y + odd_row) // 2, (x + odd_column) // 2] += 1.0
    return mean / np.maximum(count, 1.0), count > 0.0


@kernel
def _refine(coarse, fine, known, odd_row, odd_column):  # type: ignore[no-untyped-def]
    """Set unknown cells by linear interpolation between the middles of the coarse ones."""
    last_row, last_column = coarse.shape[0] - 1, coarse.shape[1] - 1
    for y in range(fine.shape[0]):
        row = (y + odd_row) // 2
        beside = min(max(row + (1 if (y + odd_row) % 2 else -1), 0), last_row)
        for x in range(fine.shape[1]):
            if known[y, x]:
                continue
            column = (x + odd_column) // 2
            next_to = min(max(column + (1 if (x + odd_column) % 2 else -1), 0), last_column)
            near = 0.75 * coarse[row, column] + 0.25 * coarse[row, next_to]
            far = 0.75 * coarse[beside, column] + 0.25 * coarse[beside, next_to]
            fine[y, x] = 0.75 * near + 0.25 * far


@kernel
def _relax(elevation, known):  # type: ignore[no-untyped-def]
    """Set each unknown cell to the mean of the four beside it, those before it already set."""
    n_rows, n_columns = elevation.shape
    for y in range(n_rows):
        above, below = max(y - 1, 0), min(y + 1, n_rows - 1)
        for x in range(n_columns):
            if not known[y, x]:
                left, right = max(x - 1, 0), min(x + 1, n_columns - 1)
                elevation[y, x] = 0.25 * (
                    elevation[above, x] + elevation[below, x] + elevation[y, left] + elevation[y, right]
                )
