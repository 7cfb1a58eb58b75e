"""A subscription whose messages lie until its node looks: to wake a node takes longer than to read them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile

from lidar_buildings.ros.qos import SILENT_SUBSCRIPTION


class Letterbox:
    """
    Small messages of a topic, read when the node asks what there is; the middleware keeps them till then.

    Parameters
    ----------
    node : Node
        Whose.
    kind : type
        Of the messages.
    topic : str
        Where they come from.
    read : callable
        Called with each message, in the thread of the node's executor.
    qos : QoSProfile
        How many are kept, among others.
    is_urgent : callable, optional
        Whether the node is woken by a message, as by one of any other subscription.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        topic: str,
        read: Callable[[Any], None],
        qos: QoSProfile,
        is_urgent: Callable[[], bool] = lambda: False,
    ) -> None:
        self._subscription = node.create_subscription(
            kind, topic, read, qos, callback_group=_Only(is_urgent), event_callbacks=SILENT_SUBSCRIPTION
        )

    def look(self) -> None:
        """Read all that has come."""
        one = self._subscription
        with one.handle:
            while (taken := one.handle.take_message(one.msg_type, one.raw)) is not None:
                one.callback(taken[0])


class _Only(CallbackGroup):
    """What the executor waits for only while it is urgent."""

    def __init__(self, is_urgent: Callable[[], bool]) -> None:
        super().__init__()
        self._is_urgent = is_urgent

    def can_execute(self, entity: Any) -> bool:
        return self._is_urgent()

    def beginning_execution(self, entity: Any) -> bool:
        return True

    def ending_execution(self, entity: Any) -> None:
        pass
