"""Many messages of a tile, one after the other."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from rclpy.publisher import Publisher

#: Time to wait for subscribers that do not keep up, several times that of a tile, and between attempts [s].
_TIMEOUT = 30.0
_PAUSE = 0.2


def publish_all(publisher: Publisher, messages: Iterable[Any]) -> None:
    """
    Publish messages, waiting while the middleware is full.

    Our profile of Fast DDS has no limit (`lidar_buildings.ros.middleware`); under a user's own profile a
    KEEP_ALL topic may be full until a subscriber in another process has caught up.
    """
    give_up = time.monotonic() + _TIMEOUT
    for message in messages:
        while True:
            try:
                publisher.publish(message)
                break
            except RuntimeError:  # rclpy's RCLError
                if time.monotonic() > give_up:
                    raise
                time.sleep(_PAUSE)
