"""The solid of a building with one height."""

from __future__ import annotations

from itertools import accumulate, pairwise

import numpy as np

from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.clearance import n_joints
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.raising.assembly import CLEARANCE
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Solid, ring_edges
from lidar_buildings.core.solids.validity import check_solid

#: As `assembly.CLEARANCE` [m].
_CLEARANCE = CLEARANCE * GRID


def extrude(outline: Outline, z_bottom: float, z_top: float) -> Solid:
    """
    Raise an outline from one elevation to another: ground, roof, and a wall an edge, whether valid or not.
    """
    rings = outline.oriented().rings
    plan = np.concatenate(rings)
    n = len(plan)
    vertices = np.empty((2 * n, 3))
    vertices[:n, :2] = vertices[n:, :2] = plan
    vertices[:n, 2], vertices[n:, 2] = z_bottom, z_top
    bottoms = [tuple(range(a, b)) for a, b in pairwise(accumulate(map(len, rings), initial=0))]
    ground = tuple(ring[::-1] for ring in bottoms)
    roof = tuple(tuple(i + n for i in ring) for ring in bottoms)
    walls = tuple(((i, j, j + n, i + n),) for ring in bottoms for i, j in ring_edges(ring))
    semantics = (GROUND_SURFACE, ROOF_SURFACE, *(WALL_SURFACE for _ in walls))
    return Solid(vertices, (ground, roof, *walls), semantics)


def extrusion_codes(outline: Outline, solid: Solid, height: float) -> tuple[int, ...]:
    """
    Return what `check_solid` does of an outline raised by a height [m].

    If the rings keep clear of each other and holes lie inside, nothing can be wrong above them.
    """
    rings = outline.rings
    if height > _CLEARANCE and min(map(len, rings)) >= 3:
        edges = ring_walls(rings).reshape(-1, 4)
        if n_joints(edges, _CLEARANCE) == len(edges) and (len(rings) == 1 or outline.polygon.is_valid):
            return ()
    return check_solid(solid)
