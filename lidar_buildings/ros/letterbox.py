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

    `read` is called with each message, in the thread of the node's executor. If `is_urgent` says so the node
    is woken by a message, as by one of any other subscription.
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
        group = _WhileUrgent(is_urgent, node.default_callback_group)
        self._subscription = node.create_subscription(
            kind, topic, read, qos, callback_group=group, event_callbacks=SILENT_SUBSCRIPTION
        )

    def look(self) -> None:
        """Read all that has come."""
        one = self._subscription
        with one.handle:
            while (taken := one.handle.take_message(one.msg_type, one.raw)) is not None:
                one.callback(taken[0])


class _WhileUrgent(CallbackGroup):
    """What the executor waits for only while it is urgent, and never beside the node's other callbacks."""

    def __init__(self, is_urgent: Callable[[], bool], others: CallbackGroup) -> None:
        super().__init__()
        self._is_urgent, self._others = is_urgent, others

    def add_entity(self, entity: Any) -> None:
        super().add_entity(entity)
        self._others.add_entity(entity)

    def can_execute(self, entity: Any) -> bool:
        return self._is_urgent() and bool(self._others.can_execute(entity))

    def beginning_execution(self, entity: Any) -> bool:
        return bool(self._others.beginning_execution(entity))

    def ending_execution(self, entity: Any) -> None:
        self._others.ending_execution(entity)
