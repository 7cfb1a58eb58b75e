"""
A scanner on a vehicle that drives along the streets: it spins rays above one another, or a tilted profile.

A ray is the line of a beam of `casting`, cut off at its origin: what lies behind that, above a falling ray or
under a rising one, is not hit. It is followed from cell to cell (Amanatides & Woo 1987).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, parameter
from lidar_buildings.io.tiling.tile_stamps import gps_time_of
from lidar_buildings.simulation.casting import (
    CELL,
    CROWNS,
    FACES,
    NO_ROW,
    ON_ROOF,
    ON_TERRAIN,
    ON_WALL,
    WALL_TABLE,
    WALLS,
    cell_of,
    crown_crossing,
    face_hit,
    on_road,
    surfaces_of,
    wall_hit,
)
from lidar_buildings.simulation.facades import SurfaceKind
from lidar_buildings.simulation.live.moving_survey import (
    SECOND,
    TAKE_OFF_STAMP,
    Frames,
    Leg,
    MovingSurvey,
    Scan,
    Sway,
    Unrest,
    mounting_pose,
)
from lidar_buildings.simulation.scanner import (
    FIRST_LEAF_DISTANCE,
    IN_CROWN,
    StripPoints,
    brightness_of,
    class_of,
    exponential,
    normal_pair,
    owner_of,
    pulse_key,
    uniform,
)
from lidar_buildings.simulation.scene import Road, VirtualScene, terrain_elevation

#: Nearer things are the vehicle itself, or too near to be measured [m].
MIN_RANGE = 0.5
#: Rays have no width; what lies on the border of two cells is listed in both [m].
RAY_SLACK = 0.01
#: Rays are at least this steep: a level one would have no place by elevation. 0.1 mm at 100 m.
MIN_STEEPNESS = 1e-6
#: The terrain is found to this [m], by the rule of false position.
TERRAIN_TOLERANCE, TERRAIN_ROUNDS = 1e-5, 20
#: Share of the rays that a pane and a fence let through.
THROUGH_GLASS, THROUGH_FENCE = 0.4, 0.5
#: Mean way of a ray into a hedge [m].
HEDGE_DEPTH = 0.06
WINDOW, FENCE, HEDGE = int(SurfaceKind.WINDOW), int(SurfaceKind.FENCE), int(SurfaceKind.HEDGE)
INTERIOR = int(SurfaceKind.INTERIOR)
#: A ray's random numbers: its noise, its way into a crown, its brightness, whether it passes, its way into a
#: hedge.
DRAW_RANGE, DRAW_LEAF, DRAW_BRIGHTNESS, DRAW_PASS, DRAW_HEDGE = np.array([0, 2, 3, 4, 5])
#: Columns that `measure_rays` writes: range [m], 0 = no return, intensity, and what is true.
RANGE, INTENSITY, TRUE_CLASS, TRUE_BUILDING, TRUE_PLANE, TRUE_KIND, TRUE_PART = range(7)


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
        building, plane_id, surface, part = owner_of(kind, item, surfaces)
        if kind == ON_WALL and part > 0 and _is_behind(direction, surfaces[WALL_TABLE][item]):
            surface, part = INTERIOR, 0
        if surface == HEDGE:
            distance += HEDGE_DEPTH * exponential(key, DRAW_HEDGE)
        asphalt = kind == ON_TERRAIN and on_road(x, y, cell_of(x, y, surfaces[6], surfaces[7]), surfaces)
        error, _ = normal_pair(key, DRAW_RANGE)
        out[row, RANGE] = distance + noise * error
        brightness = brightness_of(kind, building, surface, asphalt)
        out[row, INTENSITY] = np.floor(brightness * (0.9 + 0.2 * uniform(key, DRAW_BRIGHTNESS)))
        out[row, TRUE_CLASS] = class_of(kind, building, surface, height)
        out[row, TRUE_KIND], out[row, TRUE_PART] = surface, part
        out[row, TRUE_BUILDING], out[row, TRUE_PLANE] = building, plane_id


@kernel
def _is_behind(direction, wall):
    """Whether a ray comes from within a building, through a pane; outside is to the right of the wall."""
    return direction[0] * (wall.y_1 - wall.y_0) > direction[1] * (wall.x_1 - wall.x_0)


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
    best, kind, item, begin = np.inf, NO_ROW, NO_ROW, 0.0
    # the ray nears the ground by at most this per metre, so for a while it need not be looked at
    nearing = max(steepest * np.hypot(dx, dy) - dz, 1e-9)
    luck = uniform(key, DRAW_PASS)
    looked, above = 0.0, _clearance(origin, direction, 0.0, surfaces[0])
    while begin < max_range:
        # a little further on, so that the place lies in the cell that the ray enters
        at_x, at_y = x + (begin + 1e-6) * dx, y + (begin + 1e-6) * dy
        if not (0.0 <= at_x < size[0] and 0.0 <= at_y < size[1]):
            break
        end = min(min(_leaving(at_x, dx), _leaving(at_y, dy)) + begin + 1e-6, max_range)
        cell = cell_of(at_x, at_y, surfaces[6], surfaces[7])
        best, kind, item = _solid_in(beam, dz, sense, cell, luck, surfaces, best, kind, item)
        best, kind, item = _leaves_in(beam, dz, sense, cell, key, surfaces, best, kind, item)
        if (end - looked) * nearing > above:
            under = _clearance(origin, direction, end, surfaces[0])
            if under < 0.0 < above:
                ground = _ground_between(origin, direction, looked, end, above, under, surfaces[0])
                if ground < best:
                    best, kind, item = ground, ON_TERRAIN, NO_ROW
            looked, above = end, under
        if best <= end:
            break
        begin = end
    return (best, kind, item) if best <= max_range else (np.inf, NO_ROW, NO_ROW)


@kernel
def _leaving(place, step):
    """How far the ray goes until it leaves the cell along one axis."""
    if abs(step) < 1e-12:
        return np.inf
    cell = np.floor(place / CELL)
    return ((cell + (1.0 if step > 0.0 else 0.0)) * CELL - place) / step


@kernel
def _solid_in(beam, dz, sense, cell, luck, surfaces, best, kind, item):
    """The nearest of the hit so far and of the faces and walls that the cell lists."""
    _, faces, edges, walls, _, _, _, _, start, items = surfaces
    top = beam[2]
    for place in range(start[FACES, cell], start[FACES, cell + 1]):
        row = items[place]
        distance = (face_hit(beam, faces[row], edges, sense) - top) / dz
        if MIN_RANGE < distance < best:
            best, kind, item = distance, ON_ROOF, row
    for place in range(start[WALLS, cell], start[WALLS, cell + 1]):
        row = items[place]
        surface = walls[row].surface
        if (surface == WINDOW and luck < THROUGH_GLASS) or (surface == FENCE and luck < THROUGH_FENCE):
            continue
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
            best, kind, item = distance, IN_CROWN, NO_ROW
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


#: Lever arm [m] and boresight angles [deg]: on the roof, tilted a little, turned by a quarter.
MOUNTING = "0.6,-0.15,1.95,0.8,-1.2,90.5"
#: A car on its springs.
CAR = Sway((0.0, 0.0, 0.0), ((0, 0.8, 1.7, 0.2), (0, 0.3, 0.6, 1.3), (1, 0.6, 1.3, 0.7), (2, 1.0, 4.3, 2.1)))
#: Poses a second.
POSE_RATE = 100.0
#: Turns a second.
SCAN_RATE = 10.0
#: Rays a second of each beam of the default scanner: 512 directions a turn.
PULSE_RATE_OF_BEAM = 5_120.0
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
        32 * PULSE_RATE_OF_BEAM,
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
    is_profiler: bool = parameter(
        False, "Whether one ray turns in a tilted plane, as in mobile mapping, and not `beams` about an axis."
    )
    profile_rate: float = parameter(
        100.0, "Turns of a profile scanner.", unit="1/s", within=(SCAN_RATE, 1000.0)
    )
    position_noise: float = parameter(
        0.0, "Standard deviation of each pose's position along each axis.", unit="m", within=(0.0, 10.0)
    )
    angle_noise_deg: float = parameter(
        0.0, "Standard deviation of each pose's roll, pitch and yaw.", unit="deg", within=(0.0, 10.0)
    )
    position_drift: float = parameter(
        0.0, "What a random walk adds to the positions in a second.", unit="m", within=(0.0, 1.0)
    )
    angle_drift_deg: float = parameter(
        0.0, "What a random walk adds to roll, pitch and yaw in a second.", unit="deg", within=(0.0, 1.0)
    )


DEFAULTS = VehicleConfig()


def drive(scene: VirtualScene, seed: int = 0, config: VehicleConfig = DEFAULTS) -> MovingSurvey:
    """Drive once along each street of a scene; ParameterError if it has none."""
    if not scene.roads:
        raise ParameterError(f"scene = {scene.name!r}: has no street to drive on")
    legs: list[Leg] = []
    for road in scene.roads:
        legs.append(_leg(scene, road, legs, config.speed))
    legs = [replace(leg, unrest=_unrest(leg, seed, config)) for leg in legs]
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


def _unrest(leg: Leg, seed: int, config: VehicleConfig) -> Unrest | None:
    """By what a leg's poses are told wrong: white noise and a random walk."""
    noise = np.array([config.position_noise, config.angle_noise_deg])
    drift = np.array([config.position_drift, config.angle_drift_deg])
    if not (noise.any() or drift.any()):
        return None
    random = np.random.default_rng([seed, leg.number, UNREST])
    numbers = np.arange(-1, np.ceil(leg.duration * POSE_RATE) + 2)
    steps = random.standard_normal((2, len(numbers), 2, 3))
    walk = np.cumsum(steps[1] / np.sqrt(POSE_RATE), axis=0)
    off = noise[:, None] * steps[0] + drift[:, None] * walk
    return Unrest(numbers / POSE_RATE, off[:, 0], np.deg2rad(off[:, 1]))


#: Of the random numbers of poses' errors.
UNREST = 2
#: The plane of profiles is square to the way of the vehicle, then turned to the side and tilted by so much.
PROFILE_YAW_DEG, PROFILE_TILT_DEG = 35.0, 20.0


def _directions(config: VehicleConfig, columns: int) -> NDArray[np.float64]:
    """Directions of the rays of one turn in the scanner's frame, shape (rows, columns, 3)."""
    # it turns clockwise, seen from above
    if config.is_profiler:
        n_turns = max(1, round(config.profile_rate / SCAN_RATE))
        angle = -2 * np.pi * n_turns * np.arange(columns) / columns
        circle = np.stack([np.cos(angle), np.zeros(columns), np.sin(angle)], axis=-1)
        tilted = Rotation.from_euler("zx", [PROFILE_YAW_DEG, PROFILE_TILT_DEG], degrees=True)
        return tilted.apply(circle)[None]
    elevation = np.deg2rad(np.linspace(config.highest_deg, config.lowest_deg, config.beams))[:, None]
    azimuth = -2 * np.pi * np.arange(columns)[None] / columns
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation), (config.beams, columns)),
        ],
        axis=-1,
    )


class _SpinningScanner:
    """Measures turn by turn."""

    def __init__(self, scene: VirtualScene, seed: int, config: VehicleConfig) -> None:
        self._scene, self._seed, self._config = scene, seed, config
        self._beams = 1 if config.is_profiler else config.beams
        columns = self._columns = max(1, round(config.pulse_rate / (SCAN_RATE * self._beams)))
        self._surfaces = tuple(surfaces_of(scene, 0.0, slack=RAY_SLACK))
        self._mounting = mounting_pose(MOUNTING)
        self._directions = _directions(config, columns)
        self._offsets = np.rint(np.arange(columns) * (SECOND / SCAN_RATE / columns)).astype(np.uint32)

    def scans_of(self, leg: Leg) -> Iterator[Scan]:
        """Yield the whole turns on a leg."""
        turn = round(SECOND / SCAN_RATE)
        for number in range(int(leg.duration * SCAN_RATE)):
            begin = leg.stamp + number * turn
            yield self._scan(leg, number, begin, begin + turn)

    def _scan(self, leg: Leg, number: int, begin: int, end: int) -> Scan:
        beams, columns = self._beams, self._columns
        stamps = begin + self._offsets.astype(np.int64)
        elapsed = (stamps - leg.stamp) / SECOND
        origins, turned = self._rays(leg.at(elapsed))
        out = np.empty((beams * columns, 7))
        scanner = np.array([self._config.max_range, self._config.range_noise])
        first_ray = number * beams * columns
        measure_rays(
            origins, turned, first_ray, self._seed, leg.number, scanner, self._scene.size, self._surfaces, out
        )
        rows = self._rows(out)
        is_return = out[:, RANGE] > 0
        if leg.unrest is not None:
            origins, turned = self._rays(leg.told(elapsed))
        points = (origins + out[:, [RANGE]] * turned)[is_return]
        times = np.tile(stamps, beams)[is_return]
        return Scan(begin, end, rows, _truth(points, times, out[is_return], leg.number))

    def _rays(self, body: Frames) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origins and directions in the map of all rays of a turn."""
        sensor = body.of_mounted(self._mounting)
        turned = np.einsum("cij,bcj->bci", sensor.axes, self._directions).reshape(-1, 3)
        return np.tile(sensor.place, (self._beams, 1)), turned

    def _rows(self, out: NDArray[np.float64]) -> NDArray[Any]:
        rows = np.zeros((self._beams, self._columns), dtype=ROW)
        distance = out[:, RANGE].reshape(rows.shape)
        for axis, name in enumerate(("x", "y", "z")):
            rows[name] = distance * self._directions[..., axis]
        rows["intensity"] = out[:, INTENSITY].reshape(rows.shape)
        rows["t"] = self._offsets
        rows["ring"] = np.arange(self._beams)[:, None]
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
        true_kind=out[:, TRUE_KIND].astype(np.uint8),
        true_part=out[:, TRUE_PART].astype(np.uint32),
    )
