"""
What nodes of one process hand each other: tiles and rings as they are, messages only for listeners elsewhere.

rclcpp has this built in, rclpy has not.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any
from weakref import WeakKeyDictionary

from rclpy.context import Context
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.errands import Errands
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import Rings, ring_messages

#: Context → full name of a topic → who listens to it within it.
_INBOXES: WeakKeyDictionary[Context, defaultdict[str, list[Inbox]]] = WeakKeyDictionary()
_LOCK = threading.Lock()
#: Time to wait for subscribers that do not keep up, several times that of a tile, and between attempts [s].
_TIMEOUT = 30.0
_PAUSE = 0.2


class Inbox:
    """
    What publishers of this process leave for a subscription, where messages of other processes come.

    `take` is called with a tile's stamp and what was left, in the thread of the node's executor; `takes`
    tells which tiles are left, by their stamp.
    """

    def __init__(
        self,
        node: Node,
        errands: Errands,
        subscription: Subscription,
        take: Callable[[int, Any], None],
        takes: Callable[[int], bool] = lambda stamp: True,
    ) -> None:
        self._takes = takes
        self._take = take
        self._errands = errands
        self._coming: Counter[int] = Counter()
        with _LOCK:
            self._fellows = _INBOXES.setdefault(node.context, defaultdict(list))[subscription.topic_name]
            self._fellows.append(self)

    def put(self, stamp: int, item: Any, *, comes_again: bool) -> None:
        """Leave something; `comes_again` if a message with the same content follows."""
        if not self._takes(stamp):
            return
        if comes_again:
            with _LOCK:
                self._coming[stamp] += 1
        self._errands.put(lambda: self._take(stamp, item))

    def has_had(self, stamp: int) -> bool:
        """Whether what a message says of a tile was left here before it."""
        with _LOCK:
            if not self._coming[stamp]:
                del self._coming[stamp]
                return False
            self._coming[stamp] -= 1
            return True

    def close(self) -> None:
        """Let nothing more be left."""
        with _LOCK:
            self._fellows.remove(self)


class _Outlet:
    """Hands things on to the inboxes of this process, and publishes them where others listen."""

    def __init__(self, node: Node, publisher: Publisher) -> None:
        self._publisher = publisher
        self._context = node.context

    def _listeners(self) -> tuple[list[Inbox], bool]:
        """Return the inboxes of the topic, and whether anybody else listens."""
        with _LOCK:
            inboxes = list(_INBOXES.get(self._context, {}).get(self._publisher.topic_name, ()))
        return inboxes, self._publisher.get_subscription_count() > len(inboxes)

    def _hand_on(self, stamp: int, item: Any, messages: Callable[[], Iterable[Any]]) -> None:
        inboxes, is_heard_elsewhere = self._listeners()
        for inbox in inboxes:
            inbox.put(stamp, item, comes_again=is_heard_elsewhere)
        if is_heard_elsewhere:
            publish_all(self._publisher, messages())


class _CountingOutlet(_Outlet):
    """`note` is called with the stamp and the number of points of what is handed on."""

    def __init__(self, node: Node, publisher: Publisher, note: Callable[[int, int], None]) -> None:
        super().__init__(node, publisher)
        self._note = note


class TileOutlet(_CountingOutlet):
    """Hands tiles on; as PointCloud2 where others listen."""

    def publish(self, tile: PointTile) -> None:
        """Hand a tile on."""
        self._note(tile.stamp, len(tile))
        self._hand_on(tile.stamp, tile, lambda: [to_message(tile)])


class RingOutlet(_CountingOutlet):
    """Hands a tile's rings on; as polygons and a closing message where others listen."""

    def publish(self, stamp: int, rings: Rings) -> None:
        """Hand the rings of a tile on."""
        self._note(stamp, 0)
        self._hand_on(stamp, rings, lambda: ring_messages(stamp, rings))


class MessageOutlet(_Outlet):
    """Hands messages on as they are, which name no tile: published for all where others listen."""

    def publish(self, stamp: int, messages: Iterable[Any]) -> None:
        """Hand messages on that have to do with a tile."""
        inboxes, is_heard_elsewhere = self._listeners()
        if is_heard_elsewhere:
            publish_all(self._publisher, messages)
            return
        messages = tuple(messages)
        for inbox in inboxes:
            inbox.put(stamp, messages, comes_again=False)


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
