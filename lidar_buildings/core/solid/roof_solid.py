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
from lidar_buildings.core.solid.clearance import cleared_pieces
from lidar_buildings.core.solid.coverage import matched_coverage, noded_coverage
from lidar_buildings.core.solid.crossings import split_crossings
from lidar_buildings.core.solid.manifold import open_pinched_posts
from lidar_buildings.core.solid.plan_graph import PlanGraph
from lidar_buildings.core.solid.posts import MERGED_WITHIN, Posts
from lidar_buildings.core.solid.roof_piece import RoofPiece, check_pieces
from lidar_buildings.core.solid.unfolding import without_folds
from lidar_buildings.core.validity import check_solid

#: Repairs may make others necessary; no more rounds than this.
_MAX_ROUNDS = 10
#: Elevations at one vertex that lie within this become one where merging more folds a small face [m].
_MERGED_LITTLE = 0.002
#: Codes of faces that are not flat.
_FOLDED = {203, 204}
#: What is tried if a solid fails its checks: details narrower than the first vanish, on a grid of the second
#: [steps of the output grid].
_SIMPLER = ((5.0, 1.0), (10.0, 5.0), (20.0, 10.0), (50.0, 25.0), (150.0, 50.0))


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
    ground = round(ground_elevation / GRID)
    pieces = cleared_pieces(pieces, ground * GRID)
    first = None
    for within, grid in ((0.0, 0.0), *_SIMPLER):
        for merged_within in (MERGED_WITHIN, _MERGED_LITTLE):
            graph = noded_coverage(pieces, within, grid) if grid else matched_coverage(pieces)
            solid = _raised(graph, pieces, ground, merged_within)
            codes = check_solid(solid)
            if codes and _FOLDED.issuperset(codes):
                unfolded = without_folds(solid)
                solid, codes = (solid, codes) if check_solid(unfolded) else (unfolded, ())
            if not codes:
                return solid
            first = first or solid
    return first or Solid(np.empty((0, 3)), (), ())


def _raised(graph: PlanGraph, pieces: Sequence[RoofPiece], ground: int, merged_within: float) -> Solid:
    """
    Return the solid above a plan, repaired where roofs cross or posts are pinched.

    """
    posts = Posts(graph, pieces, ground, merged_within)
    for _ in range(_MAX_ROUNDS):
        crossed = split_crossings(posts)
        if not open_pinched_posts(posts) and not crossed:
            break
    return assemble(posts)
