"""
The solid of a building whose roof is given in pieces.

"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lidar_buildings.core.output_grid import GRID
from lidar_buildings.core.shell import Solid
from lidar_buildings.core.solid.assembly import assemble
from lidar_buildings.core.solid.coverage import matched_coverage
from lidar_buildings.core.solid.crossings import split_crossings
from lidar_buildings.core.solid.manifold import open_pinched_posts
from lidar_buildings.core.solid.posts import Posts
from lidar_buildings.core.solid.roof_piece import RoofPiece, check_pieces

#: Repairs may make others necessary; no more rounds than this.
_MAX_ROUNDS = 10


def roof_solid(pieces: Sequence[RoofPiece], ground_elevation: float) -> Solid:
    """
    Raise the pieces of a roof from the ground to their planes.

    Parameters
    ----------
    pieces : sequence of RoofPiece
        A coverage of the building's plan: pieces that lie beside each other share their edges. Gaps and
        overlaps of some millimetres and vertices in the middle of a neighbour's edge are put right.
    ground_elevation : float
        Elevation of the ground face [m].

    Returns
    -------
    Solid
        Ground faces, roof faces and walls, outer ones and those at height steps, with all coordinates on the
        output grid.

    Raises
    ------
    ValueError
        If the elevation, a plane or a ring is not finite or has another shape.

    """
    if not math.isfinite(ground_elevation):
        raise ValueError(f"ground_elevation = {ground_elevation}: must be finite")
    check_pieces(pieces)
    graph = matched_coverage(pieces)
    if not graph.left:
        return Solid(np.empty((0, 3)), (), ())
    posts = Posts(graph, pieces, round(ground_elevation / GRID))
    for _ in range(_MAX_ROUNDS):
        crossed = split_crossings(posts)
        if not open_pinched_posts(posts) and not crossed:
            break
    return assemble(posts)
