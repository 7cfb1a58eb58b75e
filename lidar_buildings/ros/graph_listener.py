"""Listens to all graphs that are there, one to a namespace."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.ros.diagnostics import SUMMARY
from lidar_buildings.ros.diagnostics import TOPIC as DIAGNOSTICS
from lidar_buildings.ros.graph_view import GraphView
from lidar_buildings.ros.node_state import LISTENER_QOS, state_of
from lidar_buildings.ros.node_state import TOPIC as NODE_STATE
from lidar_buildings.ros.qos import EVENT

#: Period of the search for graphs [s].
_SEARCH = 0.2


class GraphListener:
    """Keeps a view of every graph, or of one namespace's: `views` by namespace, ordered as `GraphView`."""

    def __init__(self, node: Node, namespace: str = "", order: Sequence[str] = ()) -> None:
        self.views: dict[str, GraphView] = {}
        self._node = node
        self._order = order
        self._only = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        node.create_timer(_SEARCH, self.search)

    def search(self) -> None:
        """Listen to graphs that are new."""
        for topic, _ in self._node.get_topic_names_and_types():
            namespace = topic.removesuffix(f"/{NODE_STATE}")
            is_meant = topic.endswith(f"/{NODE_STATE}") and self._only in ("", namespace)
            if is_meant and namespace not in self.views and self._node.count_publishers(topic):
                self._listen(namespace)

    def has_ended(self) -> bool:
        """Whether all nodes of all graphs have gone."""
        return bool(self.views) and not any(
            self._node.count_publishers(f"{namespace}/{NODE_STATE}") for namespace in self.views
        )

    def _listen(self, namespace: str) -> None:
        view = self.views[namespace] = GraphView(self._order)
        on_state, on_status = _takers(view)
        self._node.create_subscription(String, f"{namespace}/{NODE_STATE}", on_state, LISTENER_QOS)
        self._node.create_subscription(DiagnosticArray, f"{namespace}/{DIAGNOSTICS}", on_status, EVENT)


def _takers(view: GraphView) -> tuple[Callable[[String], None], Callable[[DiagnosticArray], None]]:
    """Return what takes the messages of one graph; what is not understood says nothing of it."""

    def on_state(message: String) -> None:
        with suppress(MessageError):
            view.hear_state(state_of(message), time.monotonic())

    def on_status(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith(SUMMARY):
                with suppress(ValueError):
                    values = {pair.key: float(pair.value) for pair in status.values}
                    name = status.name.removesuffix(SUMMARY)
                    level = min(int.from_bytes(status.level, "little"), 2)
                    view.hear_summary(name, level, status.message, values, time.monotonic())

    return on_state, on_status
