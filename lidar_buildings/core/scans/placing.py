"""Scans as they come, placed in the map as soon as the poses of their points are known."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans.cloud_layout import Cloud, columns_of
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.point_times import TIME_FIELDS, point_times
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.core.scans.transform_tree import TransformTree, frame_name

#: Fields that are kept beside place and time.
_KEPT = (
    "intensity",
    "return_number",
    "number_of_returns",
    "classification",
    "scan_angle",
    "scan_direction_flag",
    "point_source_id",
    "gps_time",
)
#: What was left out, in words.
NOT_FINITE = "x, y or z is not finite"
NO_RETURN = "at the sensor's own place: no return"
NO_POSE = "no pose at their time"
#: Poses are kept so long before the scan that was placed last [ns]: one may come so much later than others.
_KEPT_POSES = 10_000_000_000


class PlacedScan(NamedTuple):
    """
    Points of a scan in the map.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        Map frame [m].
    times : ndarray of int64, shape (n,)
        [ns]
    columns : dict
        Our column → values.
    """

    points: NDArray[np.float64]
    times: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]


class _Scan(NamedTuple):
    frame: str
    points: NDArray[np.float64]
    times: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]


class ScanPlacer:
    """
    Places scans in the map.

    Poses and scans may come in any order; a scan waits until the poses reach beyond its last point. Each
    point is placed by the pose at its own time, so that the sensor's motion within a scan is taken out.

    Parameters
    ----------
    config : ScanConfig
        How.

    Attributes
    ----------
    left_out : Counter
        Reason → points that were left out.
    n_scans : int
        Scans that came.
    """

    def __init__(self, config: ScanConfig | None = None) -> None:
        self.config = config or ScanConfig()
        self.tree = TransformTree(self.config.max_pose_gap, self.config.max_speed)
        self.left_out: Counter[str] = Counter()
        self.n_scans = 0
        self._waiting: deque[_Scan] = deque()
        self._odometry_child = ""
        self._mounting = self.config.mounting_pose()

    def add_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry."""
        pose = message.pose.pose
        self._odometry_child = frame_name(message.child_frame_id)
        self.tree.add(
            message.header.frame_id,
            message.child_frame_id,
            stamp_of(message.header),
            _pose(pose.position, pose.orientation),
        )

    def add_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a tf2_msgs/TFMessage of /tf or /tf_static."""
        for one in message.transforms:
            pose = _pose(one.transform.translation, one.transform.rotation)
            if is_static:
                self.tree.add_static(one.header.frame_id, one.child_frame_id, pose)
            elif frame_name(one.child_frame_id) != self._odometry_child:
                self.tree.add(one.header.frame_id, one.child_frame_id, stamp_of(one.header), pose)

    def add_scan(self, message: Any) -> None:
        """
        Take a sensor_msgs/PointCloud2.

        Raises
        ------
        MessageError
            If its layout contradicts itself, or it has no x, y and z.
        """
        cloud: Cloud = message
        columns = columns_of(cloud, {*TIME_FIELDS, *_KEPT, "buffer"})
        unit = "" if self.config.time_unit == "auto" else self.config.time_unit
        stamp = stamp_of(message.header)
        xyz = np.column_stack([np.asarray(columns.pop(axis), dtype=np.float64) for axis in "xyz"])
        self.n_scans += 1
        kept = self._measured(xyz)
        if "buffer" in columns:  # a tile of ours: these come with another one
            kept = kept[columns.pop("buffer")[kept] == 0]
        columns = {name: values[kept] for name, values in columns.items()}
        times, _ = point_times(columns, stamp, unit)
        if times is None:
            times = np.full(len(kept), stamp, dtype=np.int64)
        ours = {name: values for name, values in columns.items() if name in _KEPT}
        if "intensity" in ours:  # drivers put −1 or NaN where they have none
            ours["intensity"] = np.where(ours["intensity"] > 0, ours["intensity"], 0)
        self._waiting.append(_Scan(frame_name(message.header.frame_id), xyz[kept], times, ours))

    def placed(self, *, is_end: bool = False) -> Iterator[PlacedScan]:
        """
        Return the scans that can be placed, in the order in which they came.

        Parameters
        ----------
        is_end : bool
            Whether no more poses come: what has none yet is left out and counted.

        Raises
        ------
        MessageError
            If at the end no transform leads from a scan's frame to any other.
        """
        while self._waiting and (is_end or self._is_due(self._waiting[0])):
            scan = self._waiting.popleft()
            yield self._place(scan)
            if len(scan.times):
                self.tree.drop_before(int(scan.times.min()) - _KEPT_POSES)

    def target_of(self, frame: str) -> str:
        """Return the frame in which scans of a frame are placed."""
        wanted = frame_name(self.config.map_frame)
        return wanted if self.tree.has_way(frame, wanted) else self.tree.root_of(frame)

    def _measured(self, xyz: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the rows that are measurements."""
        is_finite = np.isfinite(xyz).all(axis=1)
        is_return = is_finite & xyz.any(axis=1)
        self._leave_out(NOT_FINITE, len(xyz) - np.count_nonzero(is_finite))
        self._leave_out(NO_RETURN, np.count_nonzero(is_finite) - np.count_nonzero(is_return))
        return np.flatnonzero(is_return)

    def _is_due(self, scan: _Scan) -> bool:
        if self._is_placed(scan):
            return True
        self._mount(scan.frame)
        if self.target_of(scan.frame) == scan.frame:
            return False  # nothing tells yet where it is
        until = self.tree.known_until(scan.frame, self.target_of(scan.frame))
        return until is None or until >= scan.times.max()

    def _is_placed(self, scan: _Scan) -> bool:
        """Whether a scan needs no pose."""
        is_in_map = self.config.georeferenced or scan.frame == frame_name(self.config.map_frame)
        return is_in_map or not len(scan.times)

    def _mount(self, frame: str) -> None:
        """Fix the scanner where the parameter says."""
        child = self._odometry_child
        if self._mounting is not None and child and child != frame:
            self.tree.set_fixed(child, frame, self._mounting)

    def _place(self, scan: _Scan) -> PlacedScan:
        if self._is_placed(scan):
            return PlacedScan(*scan[1:])
        self._mount(scan.frame)
        target = self.target_of(scan.frame)
        if target == scan.frame:
            known = ", ".join(self.tree.frames) or "none"
            raise MessageError(
                f"no pose leads from the scans' frame {scan.frame!r} to another one (frames with poses: "
                f"{known}): give the odometry or /tf of it; or scan_assembler.mounting, if fixed to one of "
                "those; or scan_assembler.georeferenced=true (--georeferenced), if the scans are in the map "
                "already"
            )
        # many points have the same time: each is looked up once
        times, row = np.unique(scan.times, return_inverse=True)
        poses = self.tree.poses(scan.frame, target, times)
        is_known = poses.is_known[row]
        self._leave_out(NO_POSE, len(row) - np.count_nonzero(is_known))
        matrices = poses.rotation.as_matrix()[row]
        points = np.einsum("nij,nj->ni", matrices, scan.points) + poses.translation[row]
        columns = {name: values[is_known] for name, values in scan.columns.items()}
        return PlacedScan(points[is_known], scan.times[is_known], columns)

    def _leave_out(self, reason: str, n_points: Any) -> None:
        if n_points:
            self.left_out[reason] += int(n_points)


def stamp_of(header: Any) -> int:
    """Return a header's time [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _pose(place: Any, attitude: Any) -> Pose:
    return Pose(
        (float(place.x), float(place.y), float(place.z)),
        (float(attitude.x), float(attitude.y), float(attitude.z), float(attitude.w)),
    )
