"""A bag played several times over, each time later and further east: a feed that lasts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lidar_buildings.commands import live
from lidar_buildings.io.bags.bag import CLOUD, ODOMETRY, TRANSFORMS, BagMessage

_SECOND = 1_000_000_000
#: Pause between two passes [ns], and how far east of one the next one lies [m].
_PAUSE, _STEP = 2 * _SECOND, 4_000.0


def repeat_bags(n_times: int) -> None:
    """Have bags played so often by whatever plays one in this process."""
    read = live.chosen_messages

    def messages(bag: Any, topics: Any, choice: Any) -> Iterator[BagMessage]:
        shift, last = 0, 0
        for k in range(n_times):
            first = None
            for one in read(bag, topics, choice):
                if one.topic in topics.of_whole:
                    if not k:
                        yield one
                    continue
                first = one.time if first is None else first
                yield one._replace(time=one.time + shift, message=_moved(one, shift, k * _STEP))
                last = one.time
            shift += last - (first or 0) + _PAUSE

    live.chosen_messages = messages


def _moved(one: BagMessage, shift: int, east: float) -> Any:
    """Return a message of a later time and another place; in the message itself."""
    message = one.message
    if one.type == CLOUD:
        _set_later(message.header, shift)
        _set_points_later(message, shift)
    elif one.type == ODOMETRY:
        _set_later(message.header, shift)
        message.pose.pose.position.x += east
    elif one.type == TRANSFORMS:
        for moved in message.transforms:
            _set_later(moved.header, shift)
            moved.transform.translation.x += east
    return message


def _set_later(header: Any, shift: int) -> None:
    stamp = header.stamp.sec * _SECOND + header.stamp.nanosec + shift
    header.stamp.sec, header.stamp.nanosec = divmod(stamp, _SECOND)


def _set_points_later(cloud: Any, shift: int) -> None:
    """Move times of points since 1970, as the virtual airborne scanner tells them; others are relative."""
    field = next((one for one in cloud.fields if one.name == "timestamp"), None)
    if field is not None and shift:
        rows = np.frombuffer(cloud.data, np.uint8).copy().reshape(-1, cloud.point_step)
        times = rows[:, field.offset : field.offset + 8].copy().view("<f8")
        rows[:, field.offset : field.offset + 8] = (times + shift / _SECOND).view(np.uint8)
        cloud.data = rows.reshape(-1)
