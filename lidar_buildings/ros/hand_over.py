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

from lidar_buildings.ros.errands import Errands

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


class Outlet:
    """
    Hands what a tile has on to the inboxes of this process, and publishes it where others listen.

    `messages` makes messages of a stamp and what it is; if not given it is messages, which name no tile: they
    are published for all where others listen. `note` is called with both.
    """

    def __init__(
        self,
        node: Node,
        publisher: Publisher,
        messages: Callable[[int, Any], Iterable[Any]] | None = None,
        note: Callable[[int, Any], None] = lambda stamp, item: None,
    ) -> None:
        self._context, self._publisher, self._messages, self._note = node.context, publisher, messages, note

    def publish(self, stamp: int, item: Any) -> None:
        """Hand something on."""
        self._note(stamp, item)
        with _LOCK:
            inboxes = list(_INBOXES.get(self._context, {}).get(self._publisher.topic_name, ()))
        is_heard_elsewhere = self._publisher.get_subscription_count() > len(inboxes)
        if self._messages is None and is_heard_elsewhere:
            publish_all(self._publisher, item)
            return
        item = tuple(item) if self._messages is None else item
        for inbox in inboxes:
            inbox.put(stamp, item, comes_again=is_heard_elsewhere)
        if self._messages is not None and is_heard_elsewhere:
            publish_all(self._publisher, self._messages(stamp, item))


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
