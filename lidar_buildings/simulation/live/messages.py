"""Scans and poses as ROS messages of any library: written into bags and files, or played in real time."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pyproj

from lidar_buildings.core.scans.cloud_layout import members_of_fields
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.io.bags.bag_writer import BagWriter
from lidar_buildings.io.tiling.map_place import Geodetic, LevelFrame
from lidar_buildings.simulation.live.moving_survey import (
    BODY,
    MAP,
    SECOND,
    SENSOR,
    BodyPose,
    MovingSurvey,
    Scan,
    mounting_pose,
)

SCAN, ODOMETRY, ORIGIN, FIX = "scan", "odometry", "map_origin", "fix"
TF, TF_STATIC, CLOCK = "/tf", "/tf_static", "/clock"
#: Topics that latecomers get, too.
LATCHED = frozenset({ORIGIN, TF_STATIC})
#: Topic → type.
TYPES = {
    SCAN: "sensor_msgs/msg/PointCloud2",
    ODOMETRY: "nav_msgs/msg/Odometry",
    ORIGIN: "geometry_msgs/msg/PointStamped",
    FIX: "sensor_msgs/msg/NavSatFix",
    TF: "tf2_msgs/msg/TFMessage",
    TF_STATIC: "tf2_msgs/msg/TFMessage",
    CLOCK: "rosgraph_msgs/msg/Clock",
}
#: Time between two messages of a clock and of a satellite receiver [ns].
_CLOCK_STEP, _FIX_STEP = SECOND // 100, SECOND // 5
#: sensor_msgs/NavSatStatus: fixed with ground stations, GPS; NavSatFix: the covariance is not known.
_GROUND_BASED, _GPS, _UNKNOWN = 2, 1, 0


class Told(NamedTuple):
    """A message and where it goes."""

    topic: str
    message: Any


class LiveMessages:
    """
    Makes the messages of a survey, by what makes a message of a type from its members.

    /tf and /tf_static tell poses and mounting, too, if asked for. With a fix, satellite positions on `fix`
    tell where the map lies, and not `map_origin`. Then the scene stands in a level frame that touches the
    Earth at its origin, as poses do, and not in the grid.
    """

    def __init__(
        self, survey: MovingSurvey, make: Callable[..., Any], *, with_tf: bool = True, with_fix: bool = False
    ) -> None:
        self._survey, self._make = survey, make
        self._with_tf, self._with_fix = with_tf, with_fix
        self._next_clock = self._next_fix = 0
        frame = survey.scene.frame
        to_earth = pyproj.Transformer.from_crs(frame.crs, "EPSG:4979", always_xy=True)
        self._level = LevelFrame(Geodetic(*to_earth.transform(*frame.origin)), frame.crs)

    @property
    def topics(self) -> list[str]:
        """What there will be."""
        tf = [TF, TF_STATIC] if self._with_tf else []
        return [SCAN, ODOMETRY, CLOCK, FIX if self._with_fix else ORIGIN, *tf]

    def opening(self) -> Iterator[Told]:
        """Yield what is said once, before all else."""
        stamp, frame = self._survey.legs[0].stamp, self._survey.scene.frame
        if not self._with_fix:
            place = self._vector("Point", frame.origin)
            yield Told(ORIGIN, self._of(ORIGIN, header=self._header(stamp, frame.crs), point=place))
        if self._with_tf:
            mounting = mounting_pose(self._survey.mounting)
            yield Told(TF_STATIC, self._transform(TF_STATIC, stamp, BODY, SENSOR, mounting))

    def of(self, event: Scan | BodyPose) -> Iterator[Told]:
        """Yield what is said of a scan or a pose."""
        if isinstance(event, Scan):
            yield Told(SCAN, self._cloud(event))
            return
        if event.stamp >= self._next_clock:
            self._next_clock = event.stamp + _CLOCK_STEP
            yield Told(CLOCK, self._of(CLOCK, clock=self._time(event.stamp)))
        yield Told(ODOMETRY, self._odometry(event))
        if self._with_tf:
            yield Told(TF, self._transform(TF, event.stamp, MAP, BODY, event.pose))
        if self._with_fix and event.stamp >= self._next_fix:
            self._next_fix = event.stamp + _FIX_STEP
            yield Told(FIX, self._fix(event))

    def _of(self, topic: str, **members: Any) -> Any:
        return self._make(TYPES[topic], **members)

    def _time(self, stamp: int) -> Any:
        return self._make("builtin_interfaces/msg/Time", sec=stamp // SECOND, nanosec=stamp % SECOND)

    def _header(self, stamp: int, frame: str) -> Any:
        return self._make("std_msgs/msg/Header", stamp=self._time(stamp), frame_id=frame)

    def _geometry(self, kind: str, **members: Any) -> Any:
        return self._make(f"geometry_msgs/msg/{kind}", **members)

    def _vector(self, kind: str, numbers: tuple[float, ...]) -> Any:
        return self._geometry(kind, **dict(zip("xyzw", numbers, strict=False)))

    def _transform(self, topic: str, stamp: int, parent: str, child: str, pose: Pose) -> Any:
        translation = self._vector("Vector3", pose.translation)
        rotation = self._vector("Quaternion", pose.quaternion)
        moved = self._geometry("Transform", translation=translation, rotation=rotation)
        header = self._header(stamp, parent)
        one = self._geometry("TransformStamped", header=header, child_frame_id=child, transform=moved)
        return self._of(topic, transforms=[one])

    def _odometry(self, event: BodyPose) -> Any:
        position = self._vector("Point", event.pose.translation)
        orientation = self._vector("Quaternion", event.pose.quaternion)
        pose = self._geometry("Pose", position=position, orientation=orientation)
        still = self._vector("Vector3", (0.0, 0.0, 0.0))
        twist = self._geometry("Twist", linear=still, angular=still)
        return self._of(
            ODOMETRY,
            header=self._header(event.stamp, MAP),
            child_frame_id=BODY,
            pose=self._geometry("PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self._geometry("TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )

    def _fix(self, event: BodyPose) -> Any:
        longitude, latitude, altitude = map(float, self._level.geodetic(np.array(event.pose.translation)))
        return self._of(
            FIX,
            header=self._header(event.stamp, BODY),
            status=self._make("sensor_msgs/msg/NavSatStatus", status=_GROUND_BASED, service=_GPS),
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=_UNKNOWN,
        )

    def _cloud(self, scan: Scan) -> Any:
        height, width = scan.rows.shape
        step = scan.rows.dtype.itemsize
        fields = members_of_fields(scan.rows.dtype)
        return self._of(
            SCAN,
            header=self._header(scan.stamp, SENSOR),
            height=height,
            width=width,
            fields=[self._make("sensor_msgs/msg/PointField", **one) for one in fields],
            is_bigendian=False,
            point_step=step,
            row_step=step * width,
            data=scan.rows.reshape(-1).view(np.uint8),
            is_dense=True,
        )


Item = TypeVar("Item")


@dataclass
class PlayReport:
    """How a survey was played."""

    n_scans: int = 0
    n_points: int = 0
    busy: float = 0.0  #: wall time with scans [s]
    pauses: float = 0.0  #: wall time without [s]
    worst_delay: float = 0.0  #: by how much at most something came too late [s]

    @property
    def rate(self) -> float:
        """Points a second while there were scans."""
        return self.n_points / max(self.busy, 1e-9)

    def __str__(self) -> str:
        return (
            f"{self.n_points:,} points in {self.n_scans:,} scans"
            f" in {self.busy:.1f} s ({self.rate:,.0f} points/s)"
            f" and {self.pauses:.1f} s between; at worst {self.worst_delay * 1000:.0f} ms late"
        )


def ahead(items: Iterable[Item], depth: int) -> Generator[Item, None, None]:
    """
    Yield items that a thread of their own makes, at most `depth` of them ahead.

    An error in making them is raised here; the thread ends when the iterator is closed.
    """
    source, end = iter(items), object()
    thread = ThreadPoolExecutor(1)
    try:
        made = deque(thread.submit(next, source, end) for _ in range(depth))
        while (item := made.popleft().result()) is not end:
            made.append(thread.submit(next, source, end))
            yield item
    finally:
        thread.shutdown(cancel_futures=True)


class Pace:
    """
    Waits until the time of what is told has come: as long after the first of all as it was recorded.

    The report gets the times. A time longer than `pause` between two items is one between two legs [s].
    """

    def __init__(
        self,
        report: PlayReport,
        pause: float,
        now: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._report = report
        self._pause, self._now, self._wait = pause, now, wait
        self._first: tuple[int, float] | None = None
        self._last = 0

    def wait_for(self, stamp: int) -> None:
        """Return when the time of something has come, at once if it has gone by [ns]."""
        now = self._now()
        if self._first is None:
            self._first, self._last = (stamp, now), stamp
        due = self._first[1] + (stamp - self._first[0]) * 1e-9
        if due > now:
            self._wait(due - now)
        step = (stamp - self._last) * 1e-9
        self._last = stamp
        if step > self._pause:
            self._report.pauses += step
        self._report.worst_delay = max(self._report.worst_delay, self._now() - due)
        self._report.busy = self._now() - self._first[1] - self._report.pauses


class SurveyBag:
    """
    A bag of a survey's messages, as a recorder would have made it; see `BagWriter` and `LiveMessages`.

    OutputError if there is something of that name, or it cannot be written.
    """

    def __init__(
        self, path: Path, survey: MovingSurvey, *, with_tf: bool = True, with_fix: bool = False
    ) -> None:
        self.files = [path]
        self._bag = BagWriter(path, latched={_absolute(topic) for topic in LATCHED})
        self._messages = LiveMessages(survey, self._bag.make, with_tf=with_tf, with_fix=with_fix)
        for told in self._messages.opening():
            self._write(told, survey.legs[0].stamp)

    def __enter__(self) -> SurveyBag:
        return self

    def __exit__(self, *_: object) -> None:
        self._bag.close()

    def add(self, event: Scan | BodyPose) -> None:
        """Write what is said of a scan or a pose."""
        for told in self._messages.of(event):
            self._write(told, event.sent)

    def _write(self, told: Told, time: int) -> None:
        self._bag.write(_absolute(told.topic), TYPES[told.topic], time, told.message)


def _absolute(topic: str) -> str:
    return "/" + topic.lstrip("/")
