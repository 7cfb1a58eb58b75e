"""
The plan of a roof as a planar graph: which piece lies on either side of each edge.

Vertices are whole grid steps (millimetres), so that equal places are equal numbers and nothing is rounded
twice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.neighbours.few_rows import sort_rows
from lidar_buildings.core.solids.raising.grid_rings import GridRings

#: Stands for what lies beside all pieces.
OUTSIDE = -1


class PlanGraph(NamedTuple):
    """The edges of a coverage."""

    places: IntArray  #: by x, then y [steps of the grid], shape (n_vertices, 2)
    ends: IntArray  #: rows of the places, the lower first; edges rise, shape (n_edges, 2)
    #: Number of the piece to the left of each edge and to its right, OUTSIDE for none, shape (n_edges, 2).
    sides: IntArray

    def joined(self, numbers: IntArray) -> PlanGraph:
        """Return the graph of pieces of which those of one number are one, without edges between them."""
        sides = np.append(numbers, OUTSIDE)[self.sides]
        parted = sides[:, 0] != sides[:, 1]
        return PlanGraph(self.places, self.ends[parted], sides[parted])


def labelled_graph(rings: GridRings) -> PlanGraph | None:
    """
    Return the graph of rings, None if two of them claim the same side of an edge.

    Edges between rings of the same piece are left out.
    """
    corners = rings.corners
    if not len(corners):
        return PlanGraph(corners, corners, corners)
    places, ends, sides = np.empty_like(corners), np.empty_like(corners), np.empty_like(corners)
    n, n_edges = _label(corners, rings.starts, rings.owner, places, ends, sides)
    return None if n_edges < 0 else PlanGraph(places[:n], ends[:n_edges], sides[:n_edges])


@kernel
def _label(corners, starts, owner, places, ends, sides):  # type: ignore[no-untyped-def]
    """Write places and edges; return how many there are, -1 edges if two rings claim the same side of one."""
    west, south, north = corners[0, 0], corners[0, 1], corners[0, 1]
    for k in range(len(corners)):
        west, south, north = min(west, corners[k, 0]), min(south, corners[k, 1]), max(north, corners[k, 1])
    size = len(corners)
    keys, rows, place = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for k in range(len(corners)):
        keys[k], rows[k] = (corners[k, 0] - west) * (north - south + 1) + corners[k, 1] - south, k
    sort_rows(keys, rows, len(keys))
    n = 0
    for k in range(len(keys)):
        if k == 0 or keys[k] != keys[k - 1]:
            places[n, 0], places[n, 1] = corners[rows[k], 0], corners[rows[k], 1]
            n += 1
        place[rows[k]] = n - 1
    # Twice the pair of places, and 1 more where the corner's edge runs from the higher to the lower one.
    ring_of = np.empty(len(corners), np.int64)
    for ring in range(len(owner)):
        for k in range(starts[ring], starts[ring + 1]):
            a, b = place[k], place[k + 1 if k + 1 < starts[ring + 1] else starts[ring]]
            keys[k], rows[k], ring_of[k] = 2 * (min(a, b) * n + max(a, b)) + (a > b), k, ring
    sort_rows(keys, rows, len(keys))
    n_edges, k = 0, 0
    while k < len(keys):
        left, right = OUTSIDE, OUTSIDE
        edge = keys[k] >> 1
        while k < len(keys) and keys[k] >> 1 == edge:
            if k > 0 and keys[k] == keys[k - 1]:
                return n, -1
            if keys[k] & 1:
                right = owner[ring_of[rows[k]]]
            else:
                left = owner[ring_of[rows[k]]]
            k += 1
        if left != right:
            ends[n_edges, 0], ends[n_edges, 1] = edge // n, edge % n
            sides[n_edges, 0], sides[n_edges, 1] = left, right
            n_edges += 1
    return n, n_edges
