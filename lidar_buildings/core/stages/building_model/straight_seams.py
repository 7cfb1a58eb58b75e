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
    lines = shapely.linestrings(cells.ends[rows].reshape(-1, 2, 2))
    found = [np.zeros((0, 2, 2))]
    for pair in np.unique(pairs[rows], axis=0):
        together = shapely.multilinestrings(lines[(pairs[rows] == pair).all(axis=1)])
        for seam in shapely.get_parts(shapely.line_merge(together)):
            corners = shapely.get_coordinates(seam)
            straight = shapely.get_coordinates(shapely.simplify(seam, tolerance, preserve_topology=False))
            if 2 <= len(straight) < len(corners):
                found.append(np.stack([straight[:-1], straight[1:]], axis=1))
    return np.concatenate(found)
