"""Scans and poses as ROS messages, of whatever library makes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pyproj

from lidar_buildings.core.scans.cloud_layout import members_of_fields
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.io.tiling.level_frame import Geodetic, LevelFrame
from lidar_buildings.simulation.live.moving_survey import (
    BODY,
    MAP,
    SECOND,
    SENSOR,
    BodyPose,
    MovingSurvey,
    Scan,
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
            mounting = self._survey.mounting_pose
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

    def _vector(self, kind: str, numbers: tuple[float, float, float]) -> Any:
        return self._make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", numbers, strict=True)))

    def _quaternion(self, pose: Pose) -> Any:
        return self._make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", pose.quaternion, strict=True)))

    def _transform(self, topic: str, stamp: int, parent: str, child: str, pose: Pose) -> Any:
        moved = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._vector("Vector3", pose.translation),
            rotation=self._quaternion(pose),
        )
        one = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(stamp, parent),
            child_frame_id=child,
            transform=moved,
        )
        return self._of(topic, transforms=[one])

    def _odometry(self, event: BodyPose) -> Any:
        place = self._make(
            "geometry_msgs/msg/Pose",
            position=self._vector("Point", event.pose.translation),
            orientation=self._quaternion(event.pose),
        )
        still = self._vector("Vector3", (0.0, 0.0, 0.0))
        twist = self._make("geometry_msgs/msg/Twist", linear=still, angular=still)
        return self._of(
            ODOMETRY,
            header=self._header(event.stamp, MAP),
            child_frame_id=BODY,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=np.zeros(36)),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
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
        return self._of(
            SCAN,
            header=self._header(scan.stamp, SENSOR),
            height=height,
            width=width,
            fields=[
                self._make("sensor_msgs/msg/PointField", **one) for one in members_of_fields(scan.rows.dtype)
            ],
            is_bigendian=False,
            point_step=step,
            row_step=step * width,
            data=scan.rows.reshape(-1).view(np.uint8),
            is_dense=True,
        )
