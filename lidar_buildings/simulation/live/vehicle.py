"""A spinning scanner on a vehicle that drives along the streets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, parameter
from lidar_buildings.io.tiling.tile_stamps import gps_time_of
from lidar_buildings.simulation.live.motion import Leg, Sway
from lidar_buildings.simulation.live.moving_survey import (
    SECOND,
    TAKE_OFF_STAMP,
    MovingSurvey,
    Scan,
    mounting_pose,
)
from lidar_buildings.simulation.live.rays import (
    INTENSITY,
    RANGE,
    TRUE_BUILDING,
    TRUE_CLASS,
    TRUE_PLANE,
    measure_rays,
)
from lidar_buildings.simulation.scanner import StripPoints
from lidar_buildings.simulation.scene import Road, VirtualScene
from lidar_buildings.simulation.surfaces import surfaces_of

#: Lever arm [m] and boresight angles [deg]: on the roof, tilted a little, turned by a quarter.
MOUNTING = "0.6,-0.15,1.95,0.8,-1.2,90.5"
#: A car on its springs.
CAR = Sway(
    (0.0, 0.0, 0.0),
    ((0, 0.8, 1.7, 0.2), (0, 0.3, 0.6, 1.3), (1, 0.6, 1.3, 0.7), (2, 1.0, 4.3, 2.1)),
)
#: Poses a second.
POSE_RATE = 100.0
#: Turns a second.
SCAN_RATE = 10.0
#: It begins and ends this far from the ends of a street [m].
MARGIN = 2.0
#: Time between two streets [s], more than any reader fills between two poses.
BETWEEN = 5.0
#: What the driver sends of each ray, organised: name → type. `t` counts from the stamp [ns], `range` in mm.
ROW = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "intensity")]
    + [("t", "<u4"), ("ring", "<u2"), ("padding", "<u2"), ("range", "<u4")]
)


@dataclass(frozen=True)
class VehicleConfig(StageConfig):
    """How the vehicle drives and its scanner measures."""

    stage: ClassVar[str] = "vehicle"

    beams: int = parameter(32, "Rays above one another.", within=(2, 256))
    pulse_rate: float = parameter(
        163_840.0,
        "Rays a second; raising it gives more directions a turn.",
        unit="1/s",
        within=(1_000.0, 10_000_000.0),
    )
    lowest_deg: float = parameter(-25.0, "Elevation of the lowest ray.", unit="deg", within=(-89.0, 0.0))
    highest_deg: float = parameter(20.0, "Elevation of the highest ray.", unit="deg", within=(0.0, 89.0))
    speed: float = parameter(8.0, "Speed over ground.", unit="m/s", within=(0.1, 60.0))
    max_range: float = parameter(
        100.0, "Nothing comes back from further away.", unit="m", within=(1.0, 1000.0)
    )
    range_noise: float = parameter(0.02, "Standard deviation along the ray.", unit="m", within=(0.0, 1.0))


DEFAULTS = VehicleConfig()


def drive(scene: VirtualScene, seed: int = 0, config: VehicleConfig = DEFAULTS) -> MovingSurvey:
    """Drive once along each street of a scene; ParameterError if it has none."""
    if not scene.roads:
        raise ParameterError(f"scene = {scene.name!r}: has no street to drive on")
    legs: list[Leg] = []
    for road in scene.roads:
        legs.append(_leg(scene, road, legs, config.speed))
    scanner = _SpinningScanner(scene, seed, config)
    return MovingSurvey(scene, MOUNTING, tuple(legs), POSE_RATE, scanner.scans_of)


def _leg(scene: VirtualScene, road: Road, before: list[Leg], speed: float) -> Leg:
    start, end = np.array(road.start), np.array(road.end)
    length = float(np.hypot(*(end - start)))
    heading = (end - start) / length
    x, y = start + MARGIN * heading
    begin = TAKE_OFF_STAMP
    if before:
        begin = before[-1].stamp + int(np.ceil(before[-1].duration + BETWEEN)) * SECOND
    return Leg(
        number=len(before) + 1,
        start=(float(x), float(y), 0.0),
        heading=(float(heading[0]), float(heading[1])),
        speed=speed,
        duration=(length - 2 * MARGIN) / speed,
        stamp=begin,
        sway=CAR,
        ground=scene.terrain,
    )


class _SpinningScanner:
    """Measures turn by turn."""

    def __init__(self, scene: VirtualScene, seed: int, config: VehicleConfig) -> None:
        self._scene, self._seed, self._config = scene, seed, config
        columns = self._columns = max(1, round(config.pulse_rate / (SCAN_RATE * config.beams)))
        self._surfaces = tuple(surfaces_of(scene, 0.0))
        self._mounting = mounting_pose(MOUNTING)
        elevation = np.deg2rad(np.linspace(config.highest_deg, config.lowest_deg, config.beams))[:, None]
        # it turns clockwise, seen from above
        azimuth = -2 * np.pi * np.arange(columns)[None] / columns
        self._directions = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.broadcast_to(np.sin(elevation), (config.beams, columns)),
            ],
            axis=-1,
        )
        self._offsets = np.rint(np.arange(columns) * (SECOND / SCAN_RATE / columns)).astype(np.uint32)

    def scans_of(self, leg: Leg) -> Iterator[Scan]:
        """Yield the whole turns on a leg."""
        turn = round(SECOND / SCAN_RATE)
        for number in range(int(leg.duration * SCAN_RATE)):
            begin = leg.stamp + number * turn
            yield self._scan(leg, number, begin, begin + turn)

    def _scan(self, leg: Leg, number: int, begin: int, end: int) -> Scan:
        beams, columns = self._config.beams, self._columns
        stamps = begin + self._offsets.astype(np.int64)
        sensor = leg.at((stamps - leg.stamp) / SECOND).of_mounted(self._mounting)
        turned = np.einsum("cij,bcj->bci", sensor.axes, self._directions).reshape(-1, 3)
        origins = np.tile(sensor.place, (beams, 1))
        out = np.empty((beams * columns, 5))
        scanner = np.array([self._config.max_range, self._config.range_noise])
        first_ray = number * beams * columns
        measure_rays(
            origins, turned, first_ray, self._seed, leg.number, scanner, self._scene.size, self._surfaces, out
        )
        rows = self._rows(out)
        is_return = out[:, RANGE] > 0
        points = (origins + out[:, [RANGE]] * turned)[is_return]
        times = np.tile(stamps, beams)[is_return]
        return Scan(begin, end, rows, _truth(points, times, out[is_return], leg.number))

    def _rows(self, out: NDArray[np.float64]) -> NDArray[Any]:
        rows = np.zeros((self._config.beams, self._columns), dtype=ROW)
        distance = out[:, RANGE].reshape(rows.shape)
        for axis, name in enumerate(("x", "y", "z")):
            rows[name] = distance * self._directions[..., axis]
        rows["intensity"] = out[:, INTENSITY].reshape(rows.shape)
        rows["t"] = self._offsets
        rows["ring"] = np.arange(self._config.beams)[:, None]
        rows["range"] = np.rint(distance * 1000)
        return rows


def _truth(
    points: NDArray[np.float64], times: NDArray[np.int64], out: NDArray[np.float64], leg: int
) -> StripPoints:
    n_points = len(points)
    ones, zeros = np.ones(n_points, dtype=np.uint8), np.zeros(n_points, dtype=np.uint8)
    return StripPoints(
        points=points,
        gps_time=gps_time_of(times),
        scan_angle=np.zeros(n_points, dtype=np.float32),
        intensity=out[:, INTENSITY].astype(np.uint16),
        point_source_id=np.full(n_points, leg, dtype=np.uint16),
        return_number=ones,
        number_of_returns=ones,
        scan_direction=zeros,
        edge_of_flight_line=zeros,
        true_class=out[:, TRUE_CLASS].astype(np.uint8),
        true_building=out[:, TRUE_BUILDING].astype(np.uint32),
        true_plane=out[:, TRUE_PLANE].astype(np.uint16),
    )
