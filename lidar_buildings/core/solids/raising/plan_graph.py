"""
The plan of a roof as a planar graph: which piece lies on either side of each edge.

Vertices are whole grid steps (millimetres), so that equal places are equal numbers and nothing is rounded
twice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.solids.raising.grid_rings import GridRings

#: Stands for what lies beside all pieces.
OUTSIDE = -1


class PlanGraph(NamedTuple):
    """
    The edges of a coverage.

    Attributes
    ----------
    places : ndarray of shape (n_vertices, 2)
        By x, then y [steps of the grid].
    ends : ndarray of shape (n_edges, 2)
        Rows of the places, the lower first; edges rise.
    sides : ndarray of shape (n_edges, 2)
        Number of the piece to the left of each edge and to its right, OUTSIDE for none.
    """

    places: IntArray
    ends: IntArray
    sides: IntArray

    @property
    def area(self) -> int:
        """Twice the area of all pieces together [square steps of the grid]."""
        if not len(self.ends):
            return 0
        (ax, ay), (bx, by) = (self.places - self.places[0])[self.ends].transpose(1, 2, 0)
        is_piece = (self.sides != OUTSIDE).astype(np.int64)
        return int(((ax * by - bx * ay) * (is_piece[:, 0] - is_piece[:, 1])).sum())


def labelled_graph(rings: GridRings) -> PlanGraph | None:
    """
    Return the graph of rings, None if two of them claim the same side of an edge.

    Edges between rings of the same piece are left out.
    """
    corners = rings.corners
    if not len(corners):
        return PlanGraph(corners, corners, corners)
    low, span = corners.min(axis=0), int(np.ptp(corners[:, 1])) + 1
    keys, start = np.unique((corners - low) @ [span, 1], return_inverse=True)
    places = np.stack(np.divmod(keys, span), axis=1) + low
    end = start[rings.following]
    n = len(places)
    edges, number = np.unique(np.minimum(start, end) * n + np.maximum(start, end), return_inverse=True)
    side = 2 * number + (start > end)
    sides = np.full(2 * len(edges), OUTSIDE)
    sides[side] = np.repeat(rings.owner, np.diff(rings.starts))
    if np.bincount(side).max() > 1:
        return None
    kept = sides[::2] != sides[1::2]
    return PlanGraph(places, np.stack(np.divmod(edges[kept], n), axis=1), sides.reshape(-1, 2)[kept])
