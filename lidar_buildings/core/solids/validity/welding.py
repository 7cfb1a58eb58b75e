"""Vertices that count as one because they lie within a tolerance of each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray, IntArray


def weld(vertices: FloatArray, tolerance: float) -> IntArray:
    """
    Return for each vertex, in space or in plan, the row of the one that it counts as.

    A vertex joins the earliest kept one within the tolerance, as val3dity does it.
    """
    leader = np.arange(len(vertices))
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    for first, second in sorted(map(tuple, np.sort(pairs, axis=1).tolist())):
        # Earlier pairs have decided whether the first one is kept.
        if leader[first] == first and leader[second] == second:
            leader[second] = first
    return leader
