"""
What the points of each cell come to: the middle of the ground's points, and the highest of the surface's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Coordinates are summed as whole multiples of 1/65536 m, so that sums do not depend on the points' order.
_STEPS_PER_METRE = 65536.0


@dataclass(frozen=True, eq=False)
class CellPoints:
    """
    One point for each cell of some.

    Attributes
    ----------
    rows, columns : ndarray of shape (n_cells,), int64
        The cells, row by row.
    points : ndarray of shape (n_cells, 3)
        Each within its cell [m].
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    points: NDArray[np.float64]

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return an array in which these cells are True."""
        mask = np.zeros(shape, dtype=bool)
        mask[self.rows, self.columns] = True
        return mask

    def select(self, chosen: NDArray[np.bool_]) -> CellPoints:
        """Return those chosen by a mask."""
        return CellPoints(self.rows[chosen], self.columns[chosen], self.points[chosen])

    def joined(self, others: CellPoints) -> CellPoints:
        """Return these and those of other cells."""
        rows, columns = np.append(self.rows, others.rows), np.append(self.columns, others.columns)
        return CellPoints(rows, columns, np.vstack((self.points, others.points)))


def mean_points(
    points: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]
) -> CellPoints:
    """
    Return the mean of the points of every cell that has any.

    The mean of points on a plane lies on it, with the noise of one point over the root of their number.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    rows, columns : ndarray of shape (n_points,)
        Each point's cell.
    shape : tuple of two int
        Rows and columns of all cells.
    """
    counts, sums = _summed(np.ascontiguousarray(points), rows, columns, shape)
    at_rows, at_columns = np.nonzero(counts)
    n = counts[at_rows, at_columns]
    means = sums[at_rows, at_columns] / (n[:, None] * _STEPS_PER_METRE)
    return CellPoints(at_rows, at_columns, means)


def highest_points(
    points: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]
) -> CellPoints:
    """
    Return the highest point of every cell that has any; of several the westernmost, then southernmost.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    rows, columns : ndarray of shape (n_points,)
        Each point's cell.
    shape : tuple of two int
        Rows and columns of all cells.
    """
    highest = _highest(np.ascontiguousarray(points), rows, columns, shape)
    at_rows, at_columns = np.nonzero(highest >= 0)
    return CellPoints(at_rows, at_columns, points[highest[at_rows, at_columns]])


@njit(cache=True, nogil=True)
def _summed(points, rows, columns, shape):  # type: ignore[no-untyped-def]
    """Count each cell's points and sum their coordinates up."""
    counts = np.zeros(shape, dtype=np.int32)
    sums = np.zeros((shape[0], shape[1], 3), dtype=np.int64)
    for i in range(len(points)):
        row, column = rows[i], columns[i]
        counts[row, column] += 1
        for axis in range(3):
            sums[row, column, axis] += np.int64(np.rint(points[i, axis] * _STEPS_PER_METRE))
    return counts, sums


@njit(cache=True, nogil=True)
def _highest(points, rows, columns, shape):  # type: ignore[no-untyped-def]
    """Return the row of each cell's highest point, −1 where it has none."""
    highest = np.full(shape, -1, dtype=np.int32)
    for i in range(len(points)):
        best = highest[rows[i], columns[i]]
        if best < 0 or _higher(points, i, best):
            highest[rows[i], columns[i]] = i
    return highest


@njit(cache=True, nogil=True)
def _higher(points, i, j):  # type: ignore[no-untyped-def]
    """Whether point i lies higher than point j, ties broken by x, then y."""
    if points[i, 2] != points[j, 2]:
        return points[i, 2] > points[j, 2]
    if points[i, 0] != points[j, 0]:
        return points[i, 0] < points[j, 0]
    return points[i, 1] < points[j, 1]
