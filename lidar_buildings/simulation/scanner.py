"""
The virtual airborne scanner: strips in, measured points out.

Random numbers are counter-based: the same for a pulse in any order of work.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.simulation.casting import (
    CELL_START,
    CROWNS,
    FACES,
    NO_ROW,
    ON_ROOF,
    ON_TERRAIN,
    ON_WALL,
    TERRAIN,
    Surfaces,
    cell_of,
    first_hit,
    next_crown,
    on_road,
    position_at,
    surfaces_of,
    terrain_hit,
)
from lidar_buildings.simulation.facades import SurfaceKind
from lidar_buildings.simulation.flight import SimulationConfig, Strip, plan_flight
from lidar_buildings.simulation.scene import VirtualScene

#: Increment and multipliers of SplitMix64 (Steele, Lea & Flood 2014).
GAMMA = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
#: 2⁻⁵³: the 53 bits of a float64 in [0, 1).
ULP = 1.0 / 9007199254740992.0


@inner_kernel
def mixed(z):
    """Scramble 64 bits: the finaliser of SplitMix64."""
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@kernel
def pulse_key(seed, strip, pulse):
    """Where a pulse's sequence of random numbers starts."""
    key = mixed(np.uint64(seed) * GAMMA + np.uint64(strip))
    return mixed(key + np.uint64(pulse) * GAMMA)


@kernel
def uniform(key, draw):
    """Number `draw` of a sequence, uniform in [0, 1)."""
    return np.float64(mixed(key + np.uint64(draw + 1) * GAMMA) >> np.uint64(11)) * ULP


@kernel
def exponential(key, draw):
    """Number `draw` of a sequence, exponential with mean 1."""
    return -np.log(1.0 - uniform(key, draw))


@kernel
def normal_pair(key, draw):
    """Two independent standard normal numbers from draws `draw` and `draw` + 1 (Box & Muller 1958)."""
    radius = np.sqrt(2.0 * exponential(key, draw))
    angle = 2.0 * np.pi * uniform(key, draw + 1)
    return radius * np.cos(angle), radius * np.sin(angle)


#: Mean intensities, made up, but in the order of a near-infrared laser's.
GRASS, ASPHALT, FACADE, METAL, LEAVES, DUST = 700.0, 250.0, 350.0, 900.0, 500.0, 30.0
PAVING, GLASS = 450.0, 80.0
ROOF_FROM, ROOF_STEP = 300.0, 60.0
#: Tops of low and medium vegetation above the ground (ASPRS classes 3 and 4) [m].
LOW_VEGETATION_TOP, MEDIUM_VEGETATION_TOP = 0.5, 2.0
#: The classes as plain numbers for compiled code; medium and high vegetation follow low.
UNCLASSIFIED, GROUND = int(PointClass.UNCLASSIFIED), int(PointClass.GROUND)
LOW_VEGETATION, BUILDING = int(PointClass.LOW_VEGETATION), int(PointClass.BUILDING)
LOW_NOISE, HIGH_NOISE = int(PointClass.LOW_NOISE), int(PointClass.HIGH_NOISE)
#: The kinds of surface that compiled code tells apart.
TERRAIN_SURFACE, CROWN = int(SurfaceKind.TERRAIN), int(SurfaceKind.TREE)
HEDGE, PAVEMENT, WINDOW = int(SurfaceKind.HEDGE), int(SurfaceKind.PAVEMENT), int(SurfaceKind.WINDOW)
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
    "true_kind",
    "true_part",
)
#: Kinds of return beside the kinds of surface in `casting`.
IN_CROWN, TOO_LOW, TOO_HIGH = np.array([3, 4, 5])
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
DRAW_ERROR, DRAW_FOOTPRINT, DRAW_SOLID, DRAW_CROWN, DRAW_NOISE = np.array([0, 4, 6, 8, 64])


@kernel
def gross_error(key, share, terrain_z, hits):
    """Write a gross error with this probability; the number of returns, 0 or 1."""
    if uniform(key, DRAW_ERROR) >= share:
        return 0
    far = uniform(key, DRAW_ERROR + 1)
    z, kind = terrain_z + HIGH_FROM + far * (HIGH_TO - HIGH_FROM), TOO_HIGH
    if uniform(key, DRAW_ERROR + 2) < 0.5:
        z, kind = terrain_z - LOW_FROM - far * (LOW_TO - LOW_FROM), TOO_LOW
    return _write(hits, np.int64(0), z, kind, NO_ROW)


@kernel
def returns_of(key, beam, divergence, cell, terrain_z, surfaces, hits):
    """Write elevation, kind and row of each return, highest first; the number of returns."""
    z, kind, row = first_hit(beam, cell, terrain_z, surfaces)
    start = surfaces[CELL_START]
    n_returns = np.int64(0)
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
    n_returns, draw = np.int64(0), DRAW_CROWN
    below, last = np.inf, np.inf
    while n_returns < MAX_CROWN_RETURNS:
        entry, leaving = next_crown(beam, cell, below, surfaces)
        if entry <= solid_z:
            break
        floor = max(leaving, solid_z + MIN_SEPARATION)
        z = min(entry - FIRST_LEAF_DISTANCE * exponential(key, draw), last - MIN_SEPARATION)
        draw += 1
        while z > floor and n_returns < MAX_CROWN_RETURNS:
            n_returns = _write(hits, n_returns, z, IN_CROWN, NO_ROW)
            last = z
            z -= MIN_SEPARATION + LEAF_DISTANCE * exponential(key, draw)
            draw += 1
        below = entry
    return n_returns


@kernel
def measure(window, seed, strip_number, flight, scanner, size, surfaces, numbers, marks):
    """Send pulses `window[0]` to `window[1]` and write their points; the number of points."""
    max_angle, range_noise, planimetric_noise, divergence, error_share = scanner
    noise = range_noise, planimetric_noise
    first, last, per_line = window
    terrain, _, _, _, _, _, columns, rows, _, _ = surfaces
    hits = np.empty((MAX_RETURNS, 3))
    row, terrain_z = 0, terrain[0, 0]
    for pulse in range(first, last):
        line, place = pulse // per_line, pulse % per_line
        forward = line % 2 == 0
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
    building, plane_id, surface, part = owner_of(kind, row, surfaces)
    asphalt = kind == ON_TERRAIN and on_road(x, y, cell, surfaces)
    brightness = brightness_of(kind, building, surface, asphalt) * (0.9 + 0.2 * uniform(key, draw + 4))
    marks[0] = max(1, int(brightness / marks[2]))
    marks[4] = class_of(kind, building, surface, true_z - terrain_z)
    marks[5], marks[6], marks[7], marks[8] = building, plane_id, surface, part


@inner_kernel
def _beam(pulse, angle, flight):
    """The line of a pulse, and its time after the strip's first [s]."""
    start_x, start_y, top, heading_x, heading_y, speed, pulse_rate = flight
    elapsed = pulse / pulse_rate
    x, y = start_x + heading_x * speed * elapsed, start_y + heading_y * speed * elapsed
    lean = np.tan(angle)
    return (x, y, top, heading_y * lean, -heading_x * lean), elapsed


@kernel
def owner_of(kind, what, surfaces):
    """Number of the building that was hit, its roof face, the kind of surface and the part; 0 for none."""
    _, faces, _, walls, _, _, _, _, _, _ = surfaces
    if kind == ON_ROOF:
        return faces[what].building, faces[what].plane_id, faces[what].surface, faces[what].part
    if kind == ON_WALL:
        return walls[what].building, 0, walls[what].surface, walls[what].part
    surface = TERRAIN_SURFACE if kind == ON_TERRAIN else (CROWN if kind == IN_CROWN else 0)
    return 0, 0, surface, 0


@kernel
def class_of(kind, building, surface, height):
    """ASPRS class of a return."""
    if kind == ON_TERRAIN or surface == PAVEMENT:
        return GROUND
    if kind == TOO_LOW:
        return LOW_NOISE
    if kind == TOO_HIGH:
        return HIGH_NOISE
    if kind == IN_CROWN or surface == HEDGE:
        return LOW_VEGETATION + int(height > LOW_VEGETATION_TOP) + int(height > MEDIUM_VEGETATION_TOP)
    return BUILDING if building > 0 else UNCLASSIFIED


@kernel
def brightness_of(kind, building, surface, asphalt):
    """Mean intensity of the material; each building's roof has its own."""
    if kind == ON_TERRAIN:
        return ASPHALT if asphalt else GRASS
    if kind == IN_CROWN or surface == HEDGE:
        return LEAVES
    if kind in (TOO_LOW, TOO_HIGH):
        return DUST
    if surface == PAVEMENT:
        return PAVING
    if surface == WINDOW:
        return GLASS
    if building == 0:
        return METAL
    return FACADE if kind == ON_WALL else ROOF_FROM + ROOF_STEP * (building * 5 % 9)


#: Pulses measured at once.
CHUNK = 100_000
#: An ordinary flight with an ordinary scanner.
DEFAULTS = SimulationConfig()


@dataclass(frozen=True, eq=False)
class StripPoints:
    """The points of one strip in the order of measurement, one row each."""

    points: NDArray[np.float64]  #: map frame [m], shape (n, 3)
    gps_time: NDArray[np.float64]  #: adjusted standard GPS time [s]
    scan_angle: NDArray[np.float32]  #: positive to the right of the flight [deg]
    intensity: NDArray[np.uint16]  #: brightness of the material
    point_source_id: NDArray[np.uint16]  #: number of the strip
    return_number: NDArray[np.uint8]  #: from 1
    number_of_returns: NDArray[np.uint8]
    scan_direction: NDArray[np.uint8]  #: 1 = from left to right
    edge_of_flight_line: NDArray[np.uint8]  #: 1 = last pulse of its scan line
    #: ASPRS class. Façades are building, roads ground, cars and free walls unclassified.
    true_class: NDArray[np.uint8]
    true_building: NDArray[np.uint32]  #: number of the building, 0 = none
    true_plane: NDArray[np.uint16]  #: roof face of the building from 1; 0 = none, façades too
    true_kind: NDArray[np.uint8]  #: `SurfaceKind`
    true_part: NDArray[np.uint32]  #: wall, opening or eave from 1, in the order of the scene's; 0 = none


def scan(scene: VirtualScene, seed: int = 0, config: SimulationConfig = DEFAULTS) -> Iterator[StripPoints]:
    """
    Measure a scene, strip by strip, empty where a strip misses it; the same seed gives the same points.

    Beams, to and fro in scan lines, are intersected exactly with the planes of roofs and walls and the
    ellipsoids of crowns, and by fixed-point iteration with the terrain. Every pulse has its own random
    sequence.
    """
    surfaces = surfaces_of(scene, config.max_scan_angle_deg)
    for strip in plan_flight(scene, config):
        windows = [(k, min(k + CHUNK, strip.n_pulses)) for k in range(0, strip.n_pulses, CHUNK)]
        yield joined([measured(strip, one, scene.size, seed, surfaces, config) for one in windows])


def joined(parts: list[StripPoints]) -> StripPoints:
    """Return several strips' points as one."""
    return StripPoints(
        *(np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(StripPoints))
    )


def measured(
    strip: Strip,
    window: tuple[int, int],
    size: tuple[float, float],
    seed: int,
    surfaces: Surfaces,
    config: SimulationConfig,
) -> StripPoints:
    """Measure pulses `window[0]` to `window[1]` of a strip; arguments as `scan` has them."""
    space = (window[1] - window[0]) * MAX_RETURNS
    numbers, marks = np.empty((space, 5)), np.empty((space, len(MARKS)), dtype=np.uint32)
    flight = np.array([*strip.start, *strip.heading, strip.speed, strip.pulse_rate])
    scanner = np.array(
        [
            np.deg2rad(config.max_scan_angle_deg),
            config.range_noise,
            config.planimetric_noise,
            config.beam_divergence_mrad / 1000.0,
            config.gross_error_share,
        ]
    )
    where = size, tuple(surfaces), numbers, marks
    n_points = measure((*window, strip.pulses_per_line), seed, strip.number, flight, scanner, *where)
    x, y, z, elapsed, angle = numbers[:n_points].T
    mark = dict(zip(MARKS, marks[:n_points].T, strict=True))
    return StripPoints(
        points=np.column_stack([x, y, z]),
        gps_time=strip.start_time + elapsed,
        scan_angle=np.rad2deg(angle).astype(np.float32),
        point_source_id=np.full(n_points, strip.number, dtype=np.uint16),
        scan_direction=(mark["flags"] & LEFT_TO_RIGHT > 0).astype(np.uint8),
        edge_of_flight_line=(mark["flags"] & END_OF_LINE > 0).astype(np.uint8),
        intensity=mark["intensity"].astype(np.uint16),
        return_number=mark["return_number"].astype(np.uint8),
        number_of_returns=mark["number_of_returns"].astype(np.uint8),
        true_class=mark["true_class"].astype(np.uint8),
        true_building=mark["true_building"].copy(),
        true_plane=mark["true_plane"].astype(np.uint16),
        true_kind=mark["true_kind"].astype(np.uint8),
        true_part=mark["true_part"].copy(),
    )
