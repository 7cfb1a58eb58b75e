"""Squared distances between the cells of a raster, as far as they matter."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel


@kernel
def square_distances(plan, value, reach):  # type: ignore[no-untyped-def]
    """
    Return each cell's squared distance from the nearest one of a value, capped at that of `reach` + 1.

    By columns and then by rows (Meijster and others, 2000), O(cells × reach). SciPy's
    `distance_transform_edt` takes 70 ms instead of 4 for a million cells and few steps.

    Parameters
    ----------
    plan : ndarray of uint8, shape (height, width)
        The cells.
    value : int
        Those to measure from.
    reach : int
        Largest distance that matters, in cells.

    Returns
    -------
    ndarray of int32, shape (height, width)
    """
    n, m = plan.shape
    far = np.int32(reach + 1)
    gap = np.empty((n, m), dtype=np.int32)
    for i in range(n):
        for j in range(m):
            above = gap[i - 1, j] + 1 if i > 0 else far
            gap[i, j] = 0 if plan[i, j] == value else min(above, far)
    for i in range(n - 2, -1, -1):
        for j in range(m):
            gap[i, j] = min(gap[i, j], gap[i + 1, j] + 1)
    for i in range(n):
        for j in range(m):
            gap[i, j] *= gap[i, j]
    found = gap.copy()
    for i in range(n):
        for step in range(1, reach + 1):
            square = np.int32(step * step)
            for j in range(step, m):
                found[i, j] = min(found[i, j], gap[i, j - step] + square)
            for j in range(m - step):
                found[i, j] = min(found[i, j], gap[i, j + step] + square)
    return found
