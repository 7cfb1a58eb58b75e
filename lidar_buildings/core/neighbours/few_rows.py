"""Rows sorted inside compiled loops: numba's own sort compiles slowly."""

from __future__ import annotations

from lidar_buildings.core.kernels import inner_kernel


@inner_kernel
def sort_rows(values, rows, n):  # type: ignore[no-untyped-def]
    """Sort the first n values and, with them, rows, which decide where values are equal (Shell 1959)."""
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
