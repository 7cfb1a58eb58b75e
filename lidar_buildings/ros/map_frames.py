"""The map frame in messages: where it lies, and the source's units."""

from __future__ import annotations

from geometry_msgs.msg import Point, PointStamped, Vector3, Vector3Stamped
from std_msgs.msg import Header

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.ros.stamps import FRAME_ID


def origin_message(frame: MapFrame) -> PointStamped:
    """Return the message for `map_origin`: `frame_id` names the reference system."""
    x, y, z = frame.origin
    return PointStamped(header=Header(frame_id=frame.crs), point=Point(x=x, y=y, z=z))


def units_message(frame: MapFrame) -> Vector3Stamped:
    """Return the message for `map_units`: metres per unit of the source's x, y and z."""
    x, y, z = (float(unit) for unit in frame.units)
    return Vector3Stamped(header=Header(frame_id=FRAME_ID), vector=Vector3(x=x, y=y, z=z))


def frame_of(origin: PointStamped, units: Vector3Stamped | None) -> MapFrame:
    """Return the frame that the messages describe; the source is in metres where no units are given."""
    point = origin.point
    horizontal, vertical = (units.vector.x, units.vector.z) if units is not None else (1.0, 1.0)
    return MapFrame(origin.header.frame_id, (point.x, point.y, point.z), horizontal, vertical)
