"""Erosion and opening of a raster by discs, at a cost that grows with the radius, not with the area."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel


def eroded(surface: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """
    Return the lowest value within a disc round each cell; what lies outside the raster does not count.

    Row by row (Urbach and Wilkinson 2008): the minimum over any length of a row is that over two overlapping
    lengths of a power of two, and those are made once a row for all chords of the disc. `surface` may hold
    +inf where nothing is known: such cells do not count. A cell belongs to the disc if its middle is within
    `radius` cells of the disc's.
    """
    # The half lengths of the disc's chords, from the diameter outwards.
    half = np.array([math.isqrt(radius * radius - d * d) for d in range(radius + 1)])
    level = np.array([int(2 * h + 1).bit_length() - 1 for h in half])
    return _eroded(np.ascontiguousarray(surface, dtype=np.float64), half, level)


def opened(surface: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """
    Return the surface with all narrower than a disc cut off: the highest disc that fits under it, everywhere.

    Discs, centred on cells, rest on known cells only; one without any within reach stays +inf.
    """
    return -eroded(-eroded(surface, radius), radius)


@kernel
def _eroded(surface, half, level):  # type: ignore[no-untyped-def]
    """Fold each row's minima over the disc's chords into the rows that the disc reaches from there."""
    n_rows, n_columns = surface.shape
    radius = len(half) - 1
    lowest = np.full(surface.shape, np.inf)
    over = np.full((level[0] + 1, n_columns + 2 * radius), np.inf)
    for row in range(n_rows):
        for column in range(n_columns):
            over[0, radius + column] = surface[row, column]
        for k in range(1, len(over)):
            _double(over[k - 1], over[k], 1 << (k - 1))
        for d in range(max(-radius, -row), min(radius, n_rows - 1 - row) + 1):
            h, k = half[abs(d)], level[abs(d)]
            left, right = radius - h, radius + h + 1 - (1 << k)
            _fold(over[k, left : left + n_columns], over[k, right : right + n_columns], lowest[row + d])
    return lowest


@kernel
def _double(single, double, length):  # type: ignore[no-untyped-def]
    """Set minima over twice a length, each from its cell to the right; beyond the row's end they stay."""
    for x in range(len(single) - 2 * length + 1):
        a, b = single[x], single[x + length]
        double[x] = a if a < b else b


@kernel
def _fold(one, other, lowest):  # type: ignore[no-untyped-def]
    """Lower values to those of two rows."""
    for x in range(len(lowest)):
        a, b = one[x], other[x]
        a = a if a < b else b
        b = lowest[x]
        lowest[x] = a if a < b else b


@kernel
def square_distances(plan, value, reach):  # type: ignore[no-untyped-def]
    """
    Return each cell's squared distance from the nearest one of a value, int32, capped at that of `reach` + 1.

    By columns and then by rows (Meijster and others, 2000), O(cells × reach), in cells of `plan`, uint8
    (height, width). SciPy's `distance_transform_edt` takes 70 ms instead of 1 for a million cells and few
    steps.
    """
    n, m = plan.shape
    found = np.empty((n, m), dtype=np.int32)
    far = np.full(m, reach + 1, dtype=np.int32)
    for i in range(n):
        _step_away(plan[i], np.uint8(value), found[i - 1] if i > 0 else far, far, found[i])
    for i in range(n - 2, -1, -1):
        _lower(found[i], found[i + 1], np.int32(1))
    along_column = np.empty(m, dtype=np.int32)
    for i in range(n):
        for j in range(m):
            found[i, j] *= found[i, j]
            along_column[j] = found[i, j]
        for step in range(1, min(reach, m - 1) + 1):
            _lower(found[i, step:], along_column[: m - step], np.int32(step * step))
            _lower(found[i, : m - step], along_column[step:], np.int32(step * step))
    return found


@kernel
def _step_away(plan, value, before, far, steps):  # type: ignore[no-untyped-def]
    """Count the steps from a value: one more than in the row before, or what is far."""
    for j in range(len(plan)):
        more = np.int32(before[j] + 1)
        more = more if more < far[j] else far[j]
        steps[j] = np.int32(0) if plan[j] == value else more


@kernel
def _lower(found, others, more):  # type: ignore[no-untyped-def]
    """Lower values to those of others and more; of 32 bits, so that many are lowered at once."""
    for j in range(len(found)):
        other = np.int32(others[j] + more)
        found[j] = other if other < found[j] else found[j]
