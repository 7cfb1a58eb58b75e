"""Sorting of few rows."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel


@kernel
def rows_by_group(group, n_groups):  # type: ignore[no-untyped-def]
    """Return the rows group by group: those of k are ``rows[first[k]:first[k + 1]]``, rising; and `first`."""
    first = np.zeros(n_groups + 1, dtype=np.int64)
    for number in group:
        first[number + 1] += 1
    for k in range(n_groups):
        first[k + 1] += first[k]
    place = first.copy()
    rows = np.empty(len(group), dtype=np.int64)
    for i in range(len(group)):
        rows[place[group[i]]] = i
        place[group[i]] += 1
    return rows, first


@kernel
def sort_rows(values, rows, n):  # type: ignore[no-untyped-def]
    """
    Sort the first n values and, with them, rows, which decide where values are equal (Shell 1959).

    Numba's own sort compiles slowly.
    """
    gap = 1
    while gap < n:
        gap = 3 * gap + 1
    while gap > 1:
        gap //= 3
        for k in range(gap, n):
            value, row, m = values[k], rows[k], k
            while m >= gap and (
                values[m - gap] > value or (values[m - gap] == value and rows[m - gap] > row)
            ):
                values[m], rows[m] = values[m - gap], rows[m - gap]
                m -= gap
            values[m], rows[m] = value, row
