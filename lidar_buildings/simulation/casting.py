"""
What a single beam hits.

A beam is the line x = foot_x + lean_x · (top − z), and the same for y: it starts at the scanner's elevation
`top` over (foot_x, foot_y) and only descends, so the hit of highest z is the first one. Compiled functions
take it as the tuple (foot_x, foot_y, top, lean_x, lean_y), and the scene as `Surfaces` turned into a plain
tuple: numba cannot read its cache any more once the class of a named one has gone.
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.simulation.surfaces import CELL, CROWNS, FACES, ROADS, WALLS
from lidar_buildings.simulation.terrain import terrain_elevation

#: Kinds of surface.
ON_TERRAIN, ON_ROOF, ON_WALL = 0, 1, 2
#: The terrain is found to this [m] by fixed-point iteration; slope · lean < 0.1 gains a digit in each round.
TERRAIN_TOLERANCE, TERRAIN_ROUNDS = 1e-4, 10
#: A face is missed by beams along it: cosine-like measure of how much it faces the beam.
MIN_FACING = 0.02


@kernel
def cell_of(x, y, columns, rows):
    """Number of the grid cell at a position within the scene."""
    return min(int(y / CELL), rows - 1) * columns + min(int(x / CELL), columns - 1)


@kernel
def position_at(beam, z):
    """Where the beam is at an elevation."""
    foot_x, foot_y, top, lean_x, lean_y = beam
    return foot_x + lean_x * (top - z), foot_y + lean_y * (top - z)


@kernel
def terrain_hit(beam, guess, terrain):
    """Elevation at which the beam meets the terrain [m], from a first guess."""
    z = guess
    for _ in range(TERRAIN_ROUNDS):
        before = z
        x, y = position_at(beam, z)
        z = terrain_elevation(x, y, terrain)
        if abs(z - before) < TERRAIN_TOLERANCE:
            break
    return z


@kernel
def first_hit(beam, cell, terrain_z, surfaces):
    """Elevation, kind of surface and its row for the first solid thing on the beam."""
    _, faces, edges, walls, _, _, _, _, start, items = surfaces
    best, kind, row = terrain_z, ON_TERRAIN, -1
    for place in range(start[FACES, cell], start[FACES, cell + 1]):
        face = items[place]
        z = face_hit(beam, faces[face], edges, 1.0)
        if z > best:
            best, kind, row = z, ON_ROOF, face
    for place in range(start[WALLS, cell], start[WALLS, cell + 1]):
        wall = items[place]
        z = wall_hit(beam, walls[wall])
        if z > best:
            best, kind, row = z, ON_WALL, wall
    return best, kind, row


@kernel
def face_hit(beam, face, edges, sense):
    """Elevation at which a beam that falls (sense 1) or rises (−1) meets a roof face, −∞ if it does not."""
    _, _, _, lean_x, lean_y = beam
    facing = 1.0 + face.a * lean_x + face.b * lean_y
    if sense * facing < MIN_FACING:
        return -np.inf
    x_at_zero, y_at_zero = position_at(beam, 0.0)
    z = (face.a * x_at_zero + face.b * y_at_zero + face.c) / facing
    x, y = position_at(beam, z)
    if x < face.x_from or x > face.x_to or y < face.y_from or y > face.y_to:
        return -np.inf
    inside = False
    for row in range(face.first_edge, face.last_edge):
        edge = edges[row]
        if (edge.y_0 > y) != (edge.y_1 > y):
            inside ^= x < edge.x_0 + (edge.x_1 - edge.x_0) * (y - edge.y_0) / (edge.y_1 - edge.y_0)
    return z if inside else -np.inf


@kernel
def wall_hit(beam, wall):
    """Elevation at which the beam meets a wall, −∞ if it does not."""
    foot_x, foot_y, beam_top, lean_x, lean_y = beam
    edge_x, edge_y = wall.x_1 - wall.x_0, wall.y_1 - wall.y_0
    crossing = lean_x * edge_y - lean_y * edge_x
    if abs(crossing) < 1e-9:
        return -np.inf
    to_x, to_y = wall.x_0 - foot_x, wall.y_0 - foot_y
    share = (to_x * lean_y - to_y * lean_x) / crossing
    if share < 0.0 or share > 1.0:
        return -np.inf
    z = beam_top - (to_x * edge_y - to_y * edge_x) / crossing
    bottom = wall.bottom_0 + share * (wall.bottom_1 - wall.bottom_0)
    top = wall.top_0 + share * (wall.top_1 - wall.top_0)
    return z if bottom < z < top else -np.inf


@kernel
def next_crown(beam, cell, below, surfaces):
    """Entry and exit [m] of the next crown that the beam enters below an elevation; −∞ if there is none."""
    _, _, _, _, crowns, _, _, _, start, items = surfaces
    best, best_exit = -np.inf, -np.inf
    for place in range(start[CROWNS, cell], start[CROWNS, cell + 1]):
        entry, leaving = crown_crossing(beam, crowns[items[place]])
        if best < entry < below:
            best, best_exit = entry, leaving
    return best, best_exit


@kernel
def crown_crossing(beam, crown):
    """Elevations at which the beam enters and leaves an ellipsoid, −∞ if it misses it."""
    _, _, _, lean_x, lean_y = beam
    x, y = position_at(beam, crown.z)
    x, y = (x - crown.x) / crown.radius, (y - crown.y) / crown.radius
    dx, dy, dz = -lean_x / crown.radius, -lean_y / crown.radius, 1.0 / crown.half_height
    a, half_b, c = dx * dx + dy * dy + dz * dz, x * dx + y * dy, x * x + y * y - 1.0
    discriminant = half_b * half_b - a * c
    if discriminant <= 0.0:
        return -np.inf, -np.inf
    root = np.sqrt(discriminant)
    return crown.z + (root - half_b) / a, crown.z - (root + half_b) / a


@kernel
def on_road(x, y, cell, surfaces):
    """Whether a position lies on a road."""
    _, _, _, _, _, roads, _, _, start, items = surfaces
    for place in range(start[ROADS, cell], start[ROADS, cell + 1]):
        road = roads[items[place]]
        dx, dy = road.x_1 - road.x_0, road.y_1 - road.y_0
        length = np.hypot(dx, dy)
        along = ((x - road.x_0) * dx + (y - road.y_0) * dy) / length
        aside = abs((x - road.x_0) * dy - (y - road.y_0) * dx) / length
        if 0.0 <= along <= length and aside <= road.half_width:
            return True
    return False
