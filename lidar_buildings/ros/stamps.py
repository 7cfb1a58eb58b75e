"""
The tile's key in messages: `header.stamp`.

A tile that is sent with other points, larger for instance, is another revision of it: its stamp is a
nanosecond later, so that no node takes parts of two revisions for one. Stamps of tiles are whole microseconds
apart.
"""

from __future__ import annotations

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from lidar_buildings.core.model.ids import tile_of as tile_of

#: The local map frame of REP-105.
FRAME_ID = "map"
_SECOND = 1_000_000_000


def to_time(stamp: int) -> Time:
    """Turn a tile's stamp [ns] into a message: the nearest one that it can hold."""
    seconds, nanoseconds = divmod(min(max(stamp, -(2**31) * _SECOND), 2**31 * _SECOND - 1), _SECOND)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_stamp(time: Time) -> int:
    """Turn a message's time into a tile's stamp [ns]."""
    return time.sec * _SECOND + time.nanosec


def header_of(stamp: int) -> Header:
    """Return the header that all messages of a tile carry."""
    return Header(stamp=to_time(stamp), frame_id=FRAME_ID)
