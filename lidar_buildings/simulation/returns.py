"""From a beam to its returns: several in a tree's crown, two at an eave, one elsewhere."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import inner_kernel
from lidar_buildings.simulation.casting import first_hit, next_crown, terrain_hit
from lidar_buildings.simulation.chance import exponential, uniform
from lidar_buildings.simulation.surfaces import CELL_START, CROWNS, FACES, TERRAIN

#: Kinds of return beside the kinds of surface in `casting`.
IN_CROWN, TOO_LOW, TOO_HIGH = 3, 4, 5
#: Returns that the scanner tells apart in one pulse, and how many of them may come from crowns.
MAX_RETURNS, MAX_CROWN_RETURNS = 5, 3
#: Nearer echoes melt into one [m].
MIN_SEPARATION = 1.2
#: Mean path of a beam between two leaves that return an echo, and from the crown's rim to the first [m].
LEAF_DISTANCE, FIRST_LEAF_DISTANCE = 1.5, 0.5
#: Share of the energy that passes one return in a crown.
TRANSMISSION = 0.6
#: Gross errors lie 2–10 m under the ground or 40–100 m above it [m].
LOW_FROM, LOW_TO, HIGH_FROM, HIGH_TO = 2.0, 10.0, 40.0, 100.0
#: First draw of a pulse's random sequence for each use; crowns take one more per echo.
DRAW_ERROR, DRAW_FOOTPRINT, DRAW_SOLID, DRAW_CROWN, DRAW_NOISE = 0, 4, 6, 8, 64


@inner_kernel
def gross_error(key, share, terrain_z, hits):
    """Write a gross error with this probability; the number of returns, 0 or 1."""
    if uniform(key, DRAW_ERROR) >= share:
        return 0
    far = uniform(key, DRAW_ERROR + 1)
    if uniform(key, DRAW_ERROR + 2) < 0.5:
        return _write(hits, 0, terrain_z - LOW_FROM - far * (LOW_TO - LOW_FROM), TOO_LOW, -1)
    return _write(hits, 0, terrain_z + HIGH_FROM + far * (HIGH_TO - HIGH_FROM), TOO_HIGH, -1)


@inner_kernel
def returns_of(key, beam, divergence, cell, terrain_z, surfaces, hits):
    """Write elevation, kind and row of each return, highest first; the number of returns."""
    z, kind, row = first_hit(beam, cell, terrain_z, surfaces)
    start = surfaces[CELL_START]
    n_returns = 0
    if start[CROWNS, cell + 1] > start[CROWNS, cell]:
        n_returns = _crown_returns(key, beam, cell, z, surfaces, hits)
        if n_returns > 0 and uniform(key, DRAW_SOLID) > TRANSMISSION**n_returns:
            return n_returns
    last = hits[n_returns - 1, 0] if n_returns > 0 else np.inf
    if divergence > 0.0 and start[FACES, cell + 1] > start[FACES, cell]:
        other_z, other_kind, other_row = _rim_hit(key, beam, divergence, cell, terrain_z, surfaces)
        if abs(other_z - z) > MIN_SEPARATION and last - other_z > MIN_SEPARATION:
            if other_z > z:
                z, kind, row, other_z, other_kind, other_row = other_z, other_kind, other_row, z, kind, row
            n_returns = _write(hits, n_returns, z, kind, row)
            z, kind, row = other_z, other_kind, other_row
    return _write(hits, n_returns, z, kind, row)


@inner_kernel
def _write(hits, n_returns, z, kind, row):
    """Append a return; their new number."""
    hits[n_returns, 0], hits[n_returns, 1], hits[n_returns, 2] = z, kind, row
    return n_returns + 1


@inner_kernel
def _rim_hit(key, beam, divergence, cell, terrain_z, surfaces):
    """What the rim of the beam hits, in a random direction from its axis."""
    foot_x, foot_y, top, lean_x, lean_y = beam
    radius = 0.5 * divergence * (top - terrain_z)
    angle = 2.0 * np.pi * uniform(key, DRAW_FOOTPRINT)
    rim = foot_x + radius * np.cos(angle), foot_y + radius * np.sin(angle), top, lean_x, lean_y
    return first_hit(rim, cell, terrain_hit(rim, terrain_z, surfaces[TERRAIN]), surfaces)


@inner_kernel
def _crown_returns(key, beam, cell, solid_z, surfaces, hits):
    """Write the returns from leaves above the solid hit; their number."""
    n_returns, draw = 0, DRAW_CROWN
    below, last = np.inf, np.inf
    while n_returns < MAX_CROWN_RETURNS:
        entry, leaving = next_crown(beam, cell, below, surfaces)
        if entry <= solid_z:
            break
        floor = max(leaving, solid_z + MIN_SEPARATION)
        z = min(entry - FIRST_LEAF_DISTANCE * exponential(key, draw), last - MIN_SEPARATION)
        draw += 1
        while z > floor and n_returns < MAX_CROWN_RETURNS:
            n_returns = _write(hits, n_returns, z, IN_CROWN, -1)
            last = z
            z -= MIN_SEPARATION + LEAF_DISTANCE * exponential(key, draw)
            draw += 1
        below = entry
    return n_returns
