"""Scans that are no sensor_msgs/PointCloud2: Livox' are made one, others named with what makes one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from lidar_buildings.core.scans.cloud_layout import members_of_fields

#: Types of Livox' drivers; a bag need not define them.
LIVOX = (
    "livox_ros_driver2/msg/CustomMsg",
    "livox_ros_driver/msg/CustomMsg",
    "livox_interfaces/msg/CustomMsg",
)
LIVOX_TEXT = """\
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
================================================================================
MSG: {package}/CustomPoint
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
_ROWS = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("offset_time", "<u4"), ("tag", "u1")]
)
#: A part of a type's name → what it is, and what makes clouds of it.
_REMEDIES = {
    "CompressedPointCloud": ("compressed clouds, as of draco", "point_cloud_transport's republish"),
    "foxglove": ("clouds of Foxglove", "a converter of yours"),
    "VelodyneScan": ("packets of Velodyne", "velodyne_pointcloud's transform node"),
    "PacketMsg": ("packets of Ouster", "ouster_ros' replay.launch.xml"),
    "PandarScan": ("packets of Hesai", "hesai_ros_driver"),
    "UdpFrame": ("packets of Hesai", "hesai_ros_driver"),
    "RslidarPacket": ("packets of RoboSense", "rslidar_sdk"),
    "NebulaPackets": ("packets of a scanner", "nebula_ros"),
    "LaserScan": ("scans in one plane", "laser_assembler"),
}


def as_cloud(message: Any) -> Any:
    """Return a CustomMsg of Livox as a PointCloud2: intensity is its reflectivity, times are its own."""
    points = message.points
    rows = np.zeros(len(points), _ROWS)
    for name, theirs in {**{name: name for name in _ROWS.names or ()}, "intensity": "reflectivity"}.items():
        rows[name] = np.fromiter((getattr(one, theirs) for one in points), _ROWS[name], len(points))
    return SimpleNamespace(
        header=message.header,
        height=1,
        width=len(rows),
        fields=[SimpleNamespace(**one) for one in members_of_fields(_ROWS)],
        is_bigendian=False,
        point_step=_ROWS.itemsize,
        row_step=rows.nbytes,
        data=rows.view(np.uint8),
        is_dense=True,
    )


def remedy_of(kind: str) -> str:
    """Say what scans of another type are, and what makes clouds of them; empty if it is not known as such."""
    for part, (what, how) in _REMEDIES.items():
        if part.lower() in kind.lower():
            return f"{what}: play it, make sensor_msgs/msg/PointCloud2 of them ({how}), and record these"
    return ""
