"""The virtual airborne scanner: strips in, measured points out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.simulation.config import SimulationConfig
from lidar_buildings.simulation.flight import Strip, plan_flight
from lidar_buildings.simulation.measuring import END_OF_LINE, LEFT_TO_RIGHT, MARKS, MAX_RETURNS, measure
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.surfaces import Surfaces, surfaces_of

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
    #: Brightness by material; number of the strip.
    intensity: NDArray[np.uint16]
    point_source_id: NDArray[np.uint16]
    #: From 1.
    return_number: NDArray[np.uint8]
    number_of_returns: NDArray[np.uint8]
    #: 1 = from left to right; 1 = last pulse of its scan line.
    scan_direction: NDArray[np.uint8]
    edge_of_flight_line: NDArray[np.uint8]
    #: ASPRS class. Façades are building, roads ground, cars and free walls unclassified.
    true_class: NDArray[np.uint8]
    true_building: NDArray[np.uint32]  #: number of the building, 0 = none
    true_plane: NDArray[np.uint16]  #: roof face of the building from 1; 0 = none, façades too


def scan(scene: VirtualScene, seed: int = 0, config: SimulationConfig = DEFAULTS) -> Iterator[StripPoints]:
    """
    Measure a scene, strip by strip, empty where a strip misses it; the same seed gives the same points.

    Beams are intersected exactly with the planes of roofs and walls and the ellipsoids of crowns, and by
    fixed-point iteration with the terrain. Every pulse has its own random sequence.
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
    n_points = measure(
        (*window, strip.pulses_per_line),
        zigzag,
        seed,
        strip.number,
        flight,
        scanner,
        size,
        tuple(surfaces),
        numbers,
        marks,
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
