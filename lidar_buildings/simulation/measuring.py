"""Measuring a strip, pulse by pulse: where it goes, what returns, with which errors."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.simulation.casting import (
    ON_ROOF,
    ON_TERRAIN,
    ON_WALL,
    cell_of,
    first_hit,
    next_crown,
    on_road,
    position_at,
    terrain_hit,
)
from lidar_buildings.simulation.chance import exponential, normal_pair, pulse_key, uniform
from lidar_buildings.simulation.surfaces import CELL_START, CROWNS, FACES, TERRAIN

#: Mean intensities, made up, but in the order of a near-infrared laser's.
GRASS, ASPHALT, FACADE, METAL, LEAVES, DUST = 700.0, 250.0, 350.0, 900.0, 500.0, 30.0
ROOF_FROM, ROOF_STEP = 300.0, 60.0
#: Tops of low and medium vegetation above the ground (ASPRS classes 3 and 4) [m].
LOW_VEGETATION_TOP, MEDIUM_VEGETATION_TOP = 0.5, 2.0
#: The classes as plain numbers for compiled code; medium and high vegetation follow low.
UNCLASSIFIED, GROUND = int(PointClass.UNCLASSIFIED), int(PointClass.GROUND)
LOW_VEGETATION, BUILDING = int(PointClass.LOW_VEGETATION), int(PointClass.BUILDING)
LOW_NOISE, HIGH_NOISE = int(PointClass.LOW_NOISE), int(PointClass.HIGH_NOISE)
#: Bits of the column `flags`.
LEFT_TO_RIGHT, END_OF_LINE = 1, 2
#: Columns of whole numbers that `measure` writes.
MARKS = (
    "intensity",
    "return_number",
    "number_of_returns",
    "flags",
    "true_class",
    "true_building",
    "true_plane",
)
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


@kernel
def gross_error(key, share, terrain_z, hits):
    """Write a gross error with this probability; the number of returns, 0 or 1."""
    if uniform(key, DRAW_ERROR) >= share:
        return 0
    far = uniform(key, DRAW_ERROR + 1)
    if uniform(key, DRAW_ERROR + 2) < 0.5:
        return _write(hits, 0, terrain_z - LOW_FROM - far * (LOW_TO - LOW_FROM), TOO_LOW, -1)
    return _write(hits, 0, terrain_z + HIGH_FROM + far * (HIGH_TO - HIGH_FROM), TOO_HIGH, -1)


@kernel
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


@kernel
def _write(hits, n_returns, z, kind, row):
    """Append a return; their new number."""
    hits[n_returns, 0], hits[n_returns, 1], hits[n_returns, 2] = z, kind, row
    return n_returns + 1


@kernel
def _rim_hit(key, beam, divergence, cell, terrain_z, surfaces):
    """What the rim of the beam hits, in a random direction from its axis."""
    foot_x, foot_y, top, lean_x, lean_y = beam
    radius = 0.5 * divergence * (top - terrain_z)
    angle = 2.0 * np.pi * uniform(key, DRAW_FOOTPRINT)
    rim = foot_x + radius * np.cos(angle), foot_y + radius * np.sin(angle), top, lean_x, lean_y
    return first_hit(rim, cell, terrain_hit(rim, terrain_z, surfaces[TERRAIN]), surfaces)


@kernel
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


@kernel
def measure(window, zigzag, seed, strip_number, flight, scanner, size, surfaces, numbers, marks):
    """Send pulses `window[0]` to `window[1]` and write their points; the number of points."""
    max_angle, range_noise, planimetric_noise, divergence, error_share = scanner
    noise = range_noise, planimetric_noise
    first, last, per_line = window
    terrain, _, _, _, _, _, columns, rows, _, _ = surfaces
    hits = np.empty((MAX_RETURNS, 3))
    row, terrain_z = 0, terrain[0, 0]
    for pulse in range(first, last):
        line, place = pulse // per_line, pulse % per_line
        forward = not zigzag or line % 2 == 0
        share = (2.0 * place + 1.0) / per_line - 1.0
        angle = max_angle * (share if forward else -share)
        beam, elapsed = _beam(pulse, angle, flight)
        terrain_z = terrain_hit(beam, terrain_z, terrain)
        x, y = position_at(beam, terrain_z)
        if not (0.0 <= x < size[0] and 0.0 <= y < size[1]):
            continue
        cell = cell_of(x, y, columns, rows)
        key = pulse_key(seed, strip_number, pulse)
        n_returns = gross_error(key, error_share, terrain_z, hits)
        if n_returns == 0:
            n_returns = returns_of(key, beam, divergence, cell, terrain_z, surfaces, hits)
        line_end = END_OF_LINE if place == per_line - 1 else 0
        flags = (LEFT_TO_RIGHT if forward else 0) + line_end
        for number in range(n_returns):
            what = hits[number, 0], int(hits[number, 1]), int(hits[number, 2]), number
            numbers[row, 3], numbers[row, 4] = elapsed, angle
            marks[row, 1], marks[row, 2], marks[row, 3] = number + 1, n_returns, flags
            _write_point(numbers[row], marks[row], key, what, beam, noise, cell, terrain_z, surfaces)
            row += 1
    return row


@kernel
def _write_point(numbers, marks, key, what, beam, noise, cell, terrain_z, surfaces):
    """Write where a return was measured, and what it is."""
    true_z, kind, row, number = what
    range_noise, planimetric_noise = noise
    draw = DRAW_NOISE + 8 * number
    range_error, _ = normal_pair(key, draw)
    error_x, error_y = normal_pair(key, draw + 2)
    z = true_z + range_noise * range_error * np.cos(numbers[4])
    x, y = position_at(beam, z)
    numbers[0], numbers[1], numbers[2] = x + planimetric_noise * error_x, y + planimetric_noise * error_y, z
    building, plane_id = owner_of(kind, row, surfaces)
    asphalt = kind == ON_TERRAIN and on_road(x, y, cell, surfaces)
    brightness = brightness_of(kind, building, asphalt) * (0.9 + 0.2 * uniform(key, draw + 4))
    marks[0] = max(1, int(brightness / marks[2]))
    marks[4] = class_of(kind, building, true_z - terrain_z)
    marks[5], marks[6] = building, plane_id


@kernel
def _beam(pulse, angle, flight):
    """The line of a pulse, and its time after the strip's first [s]."""
    start_x, start_y, top, heading_x, heading_y, speed, pulse_rate = flight
    elapsed = pulse / pulse_rate
    x, y = start_x + heading_x * speed * elapsed, start_y + heading_y * speed * elapsed
    lean = np.tan(angle)
    return (x, y, top, heading_y * lean, -heading_x * lean), elapsed


@kernel
def owner_of(kind, what, surfaces):
    """Number of the building that was hit and its roof face; 0 for all else."""
    _, faces, _, walls, _, _, _, _, _, _ = surfaces
    if kind == ON_ROOF:
        return faces[what].building, faces[what].plane_id
    if kind == ON_WALL:
        return walls[what].building, 0
    return 0, 0


@kernel
def class_of(kind, building, height):
    """ASPRS class of a return."""
    if kind == ON_TERRAIN:
        return GROUND
    if kind == TOO_LOW:
        return LOW_NOISE
    if kind == TOO_HIGH:
        return HIGH_NOISE
    if kind == IN_CROWN:
        return LOW_VEGETATION + int(height > LOW_VEGETATION_TOP) + int(height > MEDIUM_VEGETATION_TOP)
    return BUILDING if building > 0 else UNCLASSIFIED


@kernel
def brightness_of(kind, building, asphalt):
    """Mean intensity of the material; each building's roof has its own."""
    if kind == ON_TERRAIN:
        return ASPHALT if asphalt else GRASS
    if kind == IN_CROWN:
        return LEAVES
    if kind in (TOO_LOW, TOO_HIGH):
        return DUST
    if building == 0:
        return METAL
    return FACADE if kind == ON_WALL else ROOF_FROM + ROOF_STEP * (building * 5 % 9)
