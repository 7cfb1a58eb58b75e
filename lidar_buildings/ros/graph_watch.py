"""Notices nodes of the graph that have just started, by their new endpoints."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable

from rclpy.node import Node

#: Period of the look-ups of endpoints, much shorter than what a restart takes [s].
_INTERVAL = 0.25
#: Time that new endpoints are given to discover their counterparts; wide margin [s].
_DISCOVERY = 0.75


class GraphWatch:
    """
    Watches the subscriptions that a tile has to pass.

    A node that was restarted has new endpoints; what was in it is lost, and what is sent before all others
    know of them may be.

    Parameters
    ----------
    node : Node
        Whose view of the graph is used; only nodes of its namespace count.
    topics : iterable of str
        The topics between the graph's nodes, relative names.
    nodes : collection of str
        Their names; tools that listen in are no part of the graph.
    now : callable
        The clock [s].
    """

    def __init__(
        self,
        node: Node,
        topics: Iterable[str],
        nodes: Collection[str],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node = node
        self._topics = tuple(topics)
        self._nodes = frozenset(nodes)
        self._now = now
        self._known: set[bytes] = set()
        self._next = 0.0
        self._stable_at: float | None = None

    @property
    def is_stable(self) -> bool:
        """Whether no node has started just now."""
        return self._stable_at is None

    def has_new_nodes(self) -> bool:
        """Whether nodes have started since the last time, and have found their counterparts by now."""
        now = self._now()
        if now >= self._next:
            self._next = now + _INTERVAL
            found = self._endpoints()
            if found - self._known:
                self._known |= found
                self._stable_at = now + _DISCOVERY
        if self._stable_at is None or now < self._stable_at:
            return False
        self._stable_at = None
        return True

    def _endpoints(self) -> set[bytes]:
        return {
            bytes(one.endpoint_gid)
            for topic in self._topics
            for one in self._node.get_subscriptions_info_by_topic(topic)
            if one.node_name in self._nodes and one.node_namespace == self._node.get_namespace()
        }
