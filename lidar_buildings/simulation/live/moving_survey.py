"""A survey on the move: how the body moves, and its scans and poses in the order of time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.simulation.scanner import StripPoints
from lidar_buildings.simulation.scene import Terrain, VirtualScene

#: Half the length over which the slope under a vehicle is taken [m].
HALF_BASE = 1.5


@dataclass(frozen=True)
class Sway:
    """Swings of roll, pitch and yaw that add up."""

    #: Roll, pitch and yaw about which they swing; yaw counts from the direction of travel.
    mean_deg: tuple[float, float, float]
    #: Of each: axis (0 roll, 1 pitch, 2 yaw), amplitude [deg], period [s], phase [rad].
    swings: tuple[tuple[int, float, float, float], ...]

    def at(self, elapsed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return roll, pitch and yaw [deg], shape (n, 3)."""
        angles = np.tile(self.mean_deg, (len(elapsed), 1))
        for axis, amplitude, period, phase in self.swings:
            angles[:, axis] += amplitude * np.sin(2 * np.pi / period * elapsed + phase)
        return angles


class Frames(NamedTuple):
    """Frames of something in the map, one per time."""

    place: NDArray[np.float64]  #: their origins [m], shape (n, 3)
    axes: NDArray[np.float64]  #: rotations from them into the map, shape (n, 3, 3)

    def of_mounted(self, mounting: Pose) -> Frames:
        """Return the frames of what is mounted there."""
        turned = Rotation.from_quat(mounting.quaternion).as_matrix()
        return Frames(self.place + self.axes @ np.array(mounting.translation), self.axes @ turned)

    def seen(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the map, one per frame, in the frames."""
        return np.einsum("nji,nj->ni", self.axes, points - self.place)


@dataclass(frozen=True, eq=False)
class Unrest:
    """By what the poses of a leg are told wrong, at some times; between them in proportion."""

    times: NDArray[np.float64]  #: after the beginning, ascending [s], shape (n,)
    shifts: NDArray[np.float64]  #: of positions in the map [m], shape (n, 3)
    turns: NDArray[np.float64]  #: roll, pitch and yaw in the body's frame [rad], shape (n, 3)

    def of(self, exact: Frames, elapsed: NDArray[np.float64]) -> Frames:
        """Return exact frames of these times as they are told."""
        shift, turn = (
            np.column_stack([np.interp(elapsed, self.times, axis) for axis in table.T])
            for table in (self.shifts, self.turns)
        )
        return Frames(exact.place + shift, exact.axes @ _matrices(turn))


@dataclass(frozen=True)
class Leg:
    """One straight way."""

    number: int
    start: tuple[float, float, float]  #: where it begins [m]
    heading: tuple[float, float]  #: unit vector
    #: [m/s], [s].
    speed: float
    duration: float
    stamp: int  #: when it begins, Unix time [ns]
    sway: Sway
    #: Which point of the body moves straight on, in its own frame [m].
    on_line: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ground: Terrain | None = None  #: what a vehicle stands on; an aircraft keeps its elevation
    unrest: Unrest | None = None  #: by what its poses are told wrong

    def at(self, elapsed: NDArray[np.float64]) -> Frames:
        """Return the body's exact frames in the map so many seconds after the beginning."""
        angles = self.sway.at(elapsed)
        angles[:, 2] += np.rad2deg(np.arctan2(self.heading[1], self.heading[0]))
        heading = np.array(self.heading)
        place = np.empty((len(elapsed), 3))
        place[:, :2] = np.array(self.start[:2]) + (self.speed * elapsed)[:, None] * heading
        place[:, 2] = self.start[2]
        if self.ground is not None:
            left = np.array([-heading[1], heading[0]])
            place[:, 2] = self.ground.at(place[:, :2])
            angles[:, 0] += _slope_deg(self.ground, place[:, :2], left)
            angles[:, 1] -= _slope_deg(self.ground, place[:, :2], heading)
        turned = _matrices(np.deg2rad(angles))
        return Frames(place - turned @ np.array(self.on_line), turned)

    def told(self, elapsed: NDArray[np.float64]) -> Frames:
        """Return the body's frames as the poses tell them."""
        exact = self.at(elapsed)
        return exact if self.unrest is None else self.unrest.of(exact, elapsed)


def _slope_deg(
    ground: Terrain, xy: NDArray[np.float64], direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    rise = ground.at(xy + HALF_BASE * direction) - ground.at(xy - HALF_BASE * direction)
    return np.rad2deg(np.arctan(rise / (2 * HALF_BASE)))


def _matrices(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Rz·Ry·Rx of roll, pitch and yaw [rad]; five times as fast as scipy's by way of quaternions."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles).T, np.cos(angles).T
    rows = [
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


#: Frames of the poses and of the scans.
MAP, BODY, SENSOR = "map", "base_link", "lidar"
SECOND = 1_000_000_000
#: When every survey begins, Unix time [ns]: `flight.TAKE_OFF`.
TAKE_OFF_STAMP = 1_714_986_000 * SECOND


@dataclass(frozen=True, eq=False)
class Scan:
    """What a driver sends as one cloud."""

    stamp: int  #: time of its beginning [ns]
    sent: int  #: when it is complete [ns]
    #: The fields; x, y, z in the sensor's frame, all 0 where nothing came back. Structured, shape (height,
    #: width).
    rows: NDArray[Any]
    truth: StripPoints  #: where its returns lie in the map and what they are, row by row


@dataclass(frozen=True)
class BodyPose:
    """Where the body is at a time."""

    stamp: int  #: [ns]
    pose: Pose  #: of the body in the map

    @property
    def sent(self) -> int:
        """When it is told [ns]: at once."""
        return self.stamp


@dataclass(frozen=True, eq=False)
class MovingSurvey:
    """A survey with a scanner on a body that moves."""

    scene: VirtualScene
    mounting: str  #: as `scan_assembler.mounting` takes it: lever arm and boresight
    legs: tuple[Leg, ...]  #: the ways; between two of them no pose is told
    pose_rate: float  #: poses a second
    scans_of: Callable[[Leg], Iterator[Scan]]  #: leg → its scans in the order of time

    @property
    def settings(self) -> dict[str, str]:
        """Parameters that a reader of its scans needs: name → value."""
        speed = max(leg.speed for leg in self.legs)
        needed = {"scan_assembler.mounting": self.mounting}
        if speed > ScanConfig().max_speed:
            needed["scan_assembler.max_speed"] = f"{np.ceil(1.1 * speed):.0f}"
        return needed

    def events(self) -> Iterator[Scan | BodyPose]:
        """Yield scans and poses in the order in which they are sent; every time the same ones."""
        for leg in self.legs:
            poses = list(self._poses_of(leg))
            told = 0
            for scan in self.scans_of(leg):
                while told < len(poses) and poses[told].sent <= scan.sent:
                    yield poses[told]
                    told += 1
                yield scan
            yield from poses[told:]

    def _poses_of(self, leg: Leg) -> Iterator[BodyPose]:
        """Yield poses from before a leg's first point to behind its last one."""
        numbers = np.arange(-1, np.ceil(leg.duration * self.pose_rate) + 2)
        stamps = leg.stamp + np.rint(numbers * (SECOND / self.pose_rate)).astype(np.int64)
        frames = leg.told((stamps - leg.stamp) / SECOND)
        quaternions = Rotation.from_matrix(frames.axes).as_quat()
        rows = zip(stamps.tolist(), frames.place.tolist(), quaternions.tolist(), strict=True)
        for stamp, (x, y, z), (qx, qy, qz, qw) in rows:
            yield BodyPose(stamp, Pose((x, y, z), (qx, qy, qz, qw)))


def mounting_pose(mounting: str) -> Pose:
    """Return where a mounting puts the sensor in the body."""
    pose = ScanConfig(mounting=mounting).mounting_pose()
    if pose is None:
        raise ValueError("mounting is empty: must be six numbers")
    return pose
