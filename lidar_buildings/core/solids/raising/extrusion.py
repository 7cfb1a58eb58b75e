"""The solid of a building with one height."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Solid, ring_edges


def extrude(outline: Outline, z_bottom: float, z_top: float) -> Solid:
    """
    Raise an outline from one elevation to another.

    Parameters
    ----------
    outline : Outline
        Outer ring and courtyards in the map frame [m].
    z_bottom, z_top : float
        Elevations of the ground and the roof face [m].

    Returns
    -------
    Solid
        One ground face, one roof face and a wall per edge of the outline, whether valid or not: see
        `lidar_buildings.core.solids.validity`.
    """
    rings = outline.oriented().rings
    plan = np.concatenate(rings)
    n = len(plan)
    vertices = np.column_stack([np.vstack([plan, plan]), np.repeat([z_bottom, z_top], n)])
    starts = np.cumsum([0, *(len(ring) for ring in rings)])
    bottoms = [tuple(range(a, b)) for a, b in pairwise(starts)]
    ground = tuple(ring[::-1] for ring in bottoms)
    roof = tuple(tuple(i + n for i in ring) for ring in bottoms)
    walls = tuple(((i, j, j + n, i + n),) for ring in bottoms for i, j in ring_edges(ring))
    semantics = (GROUND_SURFACE, ROOF_SURFACE, *(WALL_SURFACE for _ in walls))
    return Solid(vertices, (ground, roof, *walls), semantics)
