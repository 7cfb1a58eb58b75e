"""Straight lines in place of the jagged seams between two roof planes."""

from __future__ import annotations

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.arrangement import Cells


def straight_seams(cells: Cells, labels: IntArray, tolerance: float) -> FloatArray:
    """
    Return lines that may take the place of seams with teeth.

    The border between the cells of two planes, simplified (Douglas & Peucker 1973); whether it is better
    is for the labelling to say.

    Parameters
    ----------
    cells : Cells
    labels : ndarray of shape (n_cells,), int64
        Row of each cell's plane.
    tolerance : float
        How far a line may lie from the seam [m].

    Returns
    -------
    ndarray of shape (n_lines, 2, 2)
        Ends in plan [m].
    """
    pairs = np.sort(labels[cells.edges], axis=1)
    rows = np.flatnonzero(pairs[:, 0] != pairs[:, 1])
    numbers = pairs[rows] @ np.array([labels.max(initial=0) + 1, 1])
    _, pair, n_edges = np.unique(numbers, return_inverse=True, return_counts=True)
    # An edge alone is as straight as can be.
    several = n_edges[pair] > 1
    rows, pair = rows[several], pair[several]
    if not len(rows):
        return np.zeros((0, 2, 2))
    order = np.argsort(pair, kind="stable")
    lines = shapely.linestrings(cells.ends[rows[order]].reshape(-1, 2, 2))
    pair = np.cumsum(np.append(0, np.diff(pair[order]) > 0))
    seams = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(lines, indices=pair)))
    straight = shapely.simplify(seams, tolerance, preserve_topology=False)
    straight = straight[shapely.get_num_points(straight) < shapely.get_num_points(seams)]
    corners, seam = shapely.get_coordinates(straight, return_index=True)
    runs_on = seam[1:] == seam[:-1]
    return np.stack([corners[:-1][runs_on], corners[1:][runs_on]], axis=1)
