"""A survey as it comes: what is said of it beforehand, and its scans and poses in the order of time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.simulation.live.motion import Leg
from lidar_buildings.simulation.scanner import StripPoints
from lidar_buildings.simulation.scene import VirtualScene

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
    def mounting_pose(self) -> Pose:
        """Where the sensor is in the body."""
        return mounting_pose(self.mounting)

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
        poses = leg.at((stamps - leg.stamp) / SECOND).poses()
        for stamp, pose in zip(stamps.tolist(), poses, strict=True):
            yield BodyPose(stamp, pose)


def mounting_pose(mounting: str) -> Pose:
    """Return where a mounting puts the sensor in the body."""
    pose = ScanConfig(mounting=mounting).mounting_pose()
    if pose is None:
        raise ValueError("mounting is empty: must be six numbers")
    return pose
