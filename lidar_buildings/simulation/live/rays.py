"""
What rays in any direction hit, nearest first: those of a scanner among the buildings.

A ray is the line of a beam of `casting`, cut off at its origin: what lies behind that, above a falling ray or
under a rising one, is not hit. It is followed from cell to cell (Amanatides & Woo 1987).
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.simulation.casting import (
    ON_ROOF,
    ON_TERRAIN,
    ON_WALL,
    cell_of,
    crown_crossing,
    face_hit,
    on_road,
    wall_hit,
)
from lidar_buildings.simulation.chance import exponential, normal_pair, pulse_key, uniform
from lidar_buildings.simulation.measuring import (
    FIRST_LEAF_DISTANCE,
    IN_CROWN,
    brightness_of,
    class_of,
    owner_of,
)
from lidar_buildings.simulation.surfaces import CELL, CROWNS, FACES, WALLS
from lidar_buildings.simulation.terrain import terrain_elevation

#: Nearer things are the vehicle itself, or too near to be measured [m].
MIN_RANGE = 0.5
#: Rays are at least this steep: a level one would have no place by elevation. 0.1 mm at 100 m.
MIN_STEEPNESS = 1e-6
#: The terrain is found to this [m], by the rule of false position.
TERRAIN_TOLERANCE, TERRAIN_ROUNDS = 1e-5, 20
#: A ray's random numbers: its noise, its way into a crown, its brightness.
DRAW_RANGE, DRAW_LEAF, DRAW_BRIGHTNESS = 0, 2, 3
#: Columns that `measure_rays` writes: range [m], 0 = no return, intensity, and what is true.
RANGE, INTENSITY, TRUE_CLASS, TRUE_BUILDING, TRUE_PLANE = range(5)


@kernel
def measure_rays(origins, directions, first_ray, seed, leg, scanner, size, surfaces, out):
    """Send a ray from each origin in each direction, both in the map, and write what came back."""
    max_range, noise = scanner
    steepest = _steepest(surfaces[0])
    for row in range(len(origins)):
        key = pulse_key(seed, leg, first_ray + row)
        origin = origins[row, 0], origins[row, 1], origins[row, 2]
        steepness = directions[row, 2]
        if abs(steepness) < MIN_STEEPNESS:
            steepness = -MIN_STEEPNESS
        direction = directions[row, 0], directions[row, 1], steepness
        distance, kind, item = ray_hit(origin, direction, max_range, steepest, key, size, surfaces)
        out[row, :] = 0.0
        if kind < 0:
            continue
        x, y = origin[0] + distance * direction[0], origin[1] + distance * direction[1]
        height = origin[2] + distance * steepness - terrain_elevation(x, y, surfaces[0])
        building, plane_id = owner_of(kind, item, surfaces)
        asphalt = kind == ON_TERRAIN and on_road(x, y, cell_of(x, y, surfaces[6], surfaces[7]), surfaces)
        error, _ = normal_pair(key, DRAW_RANGE)
        out[row, RANGE] = distance + noise * error
        brightness = brightness_of(kind, building, asphalt) * (0.9 + 0.2 * uniform(key, DRAW_BRIGHTNESS))
        out[row, INTENSITY] = np.floor(brightness)
        out[row, TRUE_CLASS] = class_of(kind, building, height)
        out[row, TRUE_BUILDING], out[row, TRUE_PLANE] = building, plane_id


@kernel
def _steepest(terrain):
    """Return a slope that the terrain exceeds nowhere."""
    slope = np.hypot(terrain[0, 1], terrain[0, 2])
    for row in range(1, len(terrain)):
        slope += abs(terrain[row, 0]) * np.hypot(terrain[row, 1], terrain[row, 2])
    return slope


@kernel
def ray_hit(origin, direction, max_range, steepest, key, size, surfaces):
    """Distance, kind of surface and its row of what the ray hits first; kind −1 for nothing."""
    x, y, z = origin
    dx, dy, dz = direction
    sense = 1.0 if dz < 0.0 else -1.0
    beam = x, y, z, -dx / dz, -dy / dz
    best, kind, item, begin = np.inf, -1, -1, 0.0
    # the ray nears the ground by at most this per metre, so for a while it need not be looked at
    nearing = max(steepest * np.hypot(dx, dy) - dz, 1e-9)
    looked, above = 0.0, _clearance(origin, direction, 0.0, surfaces[0])
    while begin < max_range:
        # a little further on, so that the place lies in the cell that the ray enters
        at_x, at_y = x + (begin + 1e-6) * dx, y + (begin + 1e-6) * dy
        if not (0.0 <= at_x < size[0] and 0.0 <= at_y < size[1]):
            break
        end = min(min(_leaving(at_x, dx), _leaving(at_y, dy)) + begin + 1e-6, max_range)
        cell = cell_of(at_x, at_y, surfaces[6], surfaces[7])
        best, kind, item = _solid_in(beam, dz, sense, cell, surfaces, best, kind, item)
        best, kind, item = _leaves_in(beam, dz, sense, cell, key, surfaces, best, kind, item)
        if (end - looked) * nearing > above:
            under = _clearance(origin, direction, end, surfaces[0])
            if under < 0.0 < above:
                ground = _ground_between(origin, direction, looked, end, above, under, surfaces[0])
                if ground < best:
                    best, kind, item = ground, ON_TERRAIN, -1
            looked, above = end, under
        if best <= end:
            break
        begin = end
    return (best, kind, item) if best <= max_range else (np.inf, -1, -1)


@kernel
def _leaving(place, step):
    """How far the ray goes until it leaves the cell along one axis."""
    if abs(step) < 1e-12:
        return np.inf
    cell = np.floor(place / CELL)
    return ((cell + (1.0 if step > 0.0 else 0.0)) * CELL - place) / step


@kernel
def _solid_in(beam, dz, sense, cell, surfaces, best, kind, item):
    """The nearest of the hit so far and of the roofs and walls that the cell lists."""
    _, faces, edges, walls, _, _, _, _, start, items = surfaces
    top = beam[2]
    for place in range(start[FACES, cell], start[FACES, cell + 1]):
        row = items[place]
        distance = (face_hit(beam, faces[row], edges, sense) - top) / dz
        if MIN_RANGE < distance < best:
            best, kind, item = distance, ON_ROOF, row
    for place in range(start[WALLS, cell], start[WALLS, cell + 1]):
        row = items[place]
        distance = (wall_hit(beam, walls[row]) - top) / dz
        if MIN_RANGE < distance < best:
            best, kind, item = distance, ON_WALL, row
    return best, kind, item


@kernel
def _leaves_in(beam, dz, sense, cell, key, surfaces, best, kind, item):
    """The nearest of the hit so far and of the leaves of the crowns that the cell lists."""
    _, _, _, _, crowns, _, _, _, start, items = surfaces
    top = beam[2]
    for place in range(start[CROWNS, cell], start[CROWNS, cell + 1]):
        upper, lower = crown_crossing(beam, crowns[items[place]])
        if upper == -np.inf:
            continue
        near, far = (upper, lower) if sense > 0.0 else (lower, upper)
        distance = (near - top) / dz + FIRST_LEAF_DISTANCE * exponential(key, DRAW_LEAF)
        if MIN_RANGE < distance < min(best, (far - top) / dz):
            best, kind, item = distance, IN_CROWN, -1
    return best, kind, item


@kernel
def _clearance(origin, direction, distance, terrain):
    """How far above the terrain the ray is [m]."""
    x, y = origin[0] + distance * direction[0], origin[1] + distance * direction[1]
    return origin[2] + distance * direction[2] - terrain_elevation(x, y, terrain)


@kernel
def _ground_between(origin, direction, begin, end, above, under, terrain):
    """Distance at which the ray meets the terrain between one above it and one under it."""
    middle = begin
    for _ in range(TERRAIN_ROUNDS):
        middle = begin + (end - begin) * above / (above - under)
        clearance = _clearance(origin, direction, middle, terrain)
        if abs(clearance) < TERRAIN_TOLERANCE:
            break
        if clearance > 0.0:
            begin, above = middle, clearance
        else:
            end, under = middle, clearance
    return middle
