"""Messages made by the name of their type."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from lidar_buildings.ros.point_cloud import fill


def message_class(kind: str) -> Any:
    """Return the class of a type such as ``std_msgs/msg/Header``."""
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def is_installed(kind: str) -> bool:
    """Whether there is such a type here; PyPI has no tf2_msgs."""
    try:
        message_class(kind)
    except ImportError:
        return False
    return True


def make_message(kind: str, **members: Any) -> Any:
    """Return a message of a type; a cloud takes any array for its data, without copying it."""
    data = members.pop("data", None) if kind == "sensor_msgs/msg/PointCloud2" else None
    message = message_class(kind)(**members)
    if data is not None:
        fill(message, data)
    return message
