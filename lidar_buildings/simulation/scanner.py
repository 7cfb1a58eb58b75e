"""
The virtual airborne scanner: strips in, measured points out.

"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.asprs import PointClass
from lidar_buildings.simulation.casting import (
    ON_ROOF,
    ON_TERRAIN,
    ON_WALL,
    cell_of,
    on_road,
    position_at,
    terrain_hit,
)
from lidar_buildings.simulation.chance import normal_pair, pulse_key, uniform
from lidar_buildings.simulation.config import SimulationConfig
from lidar_buildings.simulation.flight import Strip, plan_flight
from lidar_buildings.simulation.returns import (
    DRAW_NOISE,
    IN_CROWN,
    MAX_RETURNS,
    TOO_HIGH,
    TOO_LOW,
    gross_error,
    returns_of,
)
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.surfaces import Surfaces, surfaces_of

#: Pulses measured at once.
CHUNK = 100_000
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
#: Columns of whole numbers that `_measure` writes.
MARKS = (
    "intensity",
    "return_number",
    "number_of_returns",
    "flags",
    "true_class",
    "true_building",
    "true_plane",
)
#: An ordinary flight with an ordinary scanner.
DEFAULTS = SimulationConfig()


@dataclass(frozen=True, eq=False)
class StripPoints:
    """
    The points of one strip in the order of measurement, one row each.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        Map frame [m].
    gps_time : ndarray of float64
        Adjusted standard GPS time [s].
    scan_angle : ndarray of float32
        Positive to the right of the flight [deg].
    intensity, point_source_id : ndarray of uint16
        Brightness by material; number of the strip.
    return_number, number_of_returns : ndarray of uint8
        From 1.
    scan_direction, edge_of_flight_line : ndarray of uint8
        1 = from left to right; 1 = last pulse of its scan line.
    true_class : ndarray of uint8
        ASPRS class. Façades are building, roads ground, cars and free walls unclassified.
    true_building : ndarray of uint32
        Number of the building, 0 = none.
    true_plane : ndarray of uint16
        Roof face of the building from 1; 0 = none, façades too.

    """

    points: NDArray[np.float64]
    gps_time: NDArray[np.float64]
    scan_angle: NDArray[np.float32]
    intensity: NDArray[np.uint16]
    point_source_id: NDArray[np.uint16]
    return_number: NDArray[np.uint8]
    number_of_returns: NDArray[np.uint8]
    scan_direction: NDArray[np.uint8]
    edge_of_flight_line: NDArray[np.uint8]
    true_class: NDArray[np.uint8]
    true_building: NDArray[np.uint32]
    true_plane: NDArray[np.uint16]


def scan(scene: VirtualScene, seed: int = 0, config: SimulationConfig = DEFAULTS) -> Iterator[StripPoints]:
    """
    Measure a scene, strip by strip.

    Beams are intersected exactly with the planes of roofs and walls and the ellipsoids of crowns, and by
    fixed-point iteration with the terrain. Every pulse has its own random sequence.

    Parameters
    ----------
    scene : VirtualScene
        What there is to be measured.
    seed : int
        The same seed gives the same points.
    config : SimulationConfig
        Flight and scanner.

    Yields
    ------
    StripPoints
        One per strip, empty where a strip misses the scene.

    """
    surfaces = surfaces_of(scene, config.max_scan_angle_deg)
    for strip in plan_flight(scene, config):
        firsts = range(0, strip.n_pulses, CHUNK)
        chunks = [_measured(strip, first, scene.size, seed, surfaces, config) for first in firsts]
        yield joined(chunks)


def joined(parts: list[StripPoints]) -> StripPoints:
    """
    Return several strips' points as one.

    """
    return StripPoints(
        *(np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(StripPoints))
    )


def _measured(
    strip: Strip,
    first: int,
    size: tuple[float, float],
    seed: int,
    surfaces: Surfaces,
    config: SimulationConfig,
) -> StripPoints:
    """
    Measure one chunk of a strip's pulses.

    """
    last = min(first + CHUNK, strip.n_pulses)
    space = (last - first) * MAX_RETURNS
    numbers, marks = np.empty((space, 5)), np.empty((space, 7), dtype=np.uint32)
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
    zigzag = config.pattern == "zigzag"
    window = (first, last, strip.pulses_per_line)
    n_points = _measure(
        window, zigzag, seed, strip.number, flight, scanner, size, tuple(surfaces), numbers, marks
    )
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
    )


@njit(cache=True, nogil=True)
def _measure(window, zigzag, seed, strip_number, flight, scanner, size, surfaces, numbers, marks):
    """
    Send pulses `window[0]` to `window[1]` and write their points; the number of points.

    """
    max_angle, range_noise, planimetric_noise, divergence, error_share = scanner
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
        flags = (LEFT_TO_RIGHT if forward else 0) + (END_OF_LINE if place == per_line - 1 else 0)
        for number in range(n_returns):
            draw = DRAW_NOISE + 8 * number
            range_error, _ = normal_pair(key, draw)
            error_x, error_y = normal_pair(key, draw + 2)
            z = hits[number, 0] + range_noise * range_error * np.cos(angle)
            x, y = position_at(beam, z)
            numbers[row, 0], numbers[row, 1] = (
                x + planimetric_noise * error_x,
                y + planimetric_noise * error_y,
            )
            numbers[row, 2], numbers[row, 3], numbers[row, 4] = z, elapsed, angle
            kind, what = int(hits[number, 1]), int(hits[number, 2])
            building, plane_id = _owner(kind, what, surfaces)
            asphalt = kind == ON_TERRAIN and on_road(x, y, cell, surfaces)
            brightness = _brightness(kind, building, asphalt) * (0.9 + 0.2 * uniform(key, draw + 4))
            marks[row, 0] = max(1, int(brightness / n_returns))
            marks[row, 1], marks[row, 2], marks[row, 3] = number + 1, n_returns, flags
            marks[row, 4] = _true_class(kind, building, hits[number, 0] - terrain_z)
            marks[row, 5], marks[row, 6] = building, plane_id
            row += 1
    return row


@njit(cache=True, nogil=True)
def _beam(pulse, angle, flight):
    """
    The line of a pulse, and its time after the strip's first [s].

    """
    start_x, start_y, top, heading_x, heading_y, speed, pulse_rate = flight
    elapsed = pulse / pulse_rate
    x, y = start_x + heading_x * speed * elapsed, start_y + heading_y * speed * elapsed
    lean = np.tan(angle)
    return (x, y, top, heading_y * lean, -heading_x * lean), elapsed


@njit(cache=True, nogil=True)
def _owner(kind, what, surfaces):
    """
    Number of the building that was hit and its roof face; 0 for all else.

    """
    _, faces, _, walls, _, _, _, _, _, _ = surfaces
    if kind == ON_ROOF:
        return faces[what].building, faces[what].plane_id
    if kind == ON_WALL:
        return walls[what].building, 0
    return 0, 0


@njit(cache=True, nogil=True)
def _true_class(kind, building, height):
    """
    ASPRS class of a return.

    """
    if kind == ON_TERRAIN:
        return GROUND
    if kind == TOO_LOW:
        return LOW_NOISE
    if kind == TOO_HIGH:
        return HIGH_NOISE
    if kind == IN_CROWN:
        return LOW_VEGETATION + int(height > LOW_VEGETATION_TOP) + int(height > MEDIUM_VEGETATION_TOP)
    return BUILDING if building > 0 else UNCLASSIFIED


@njit(cache=True, nogil=True)
def _brightness(kind, building, asphalt):
    """
    Mean intensity of the material; each building's roof has its own.

    """
    if kind == ON_TERRAIN:
        return ASPHALT if asphalt else GRASS
    if kind == IN_CROWN:
        return LEAVES
    if kind in (TOO_LOW, TOO_HIGH):
        return DUST
    if building == 0:
        return METAL
    return FACADE if kind == ON_WALL else ROOF_FROM + ROOF_STEP * (building * 5 % 9)
