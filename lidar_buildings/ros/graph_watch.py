"""Which nodes are in the graph, by their receipts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from rclpy.node import Node

from lidar_buildings.core.model.replicas import MAX_REPLICAS
from lidar_buildings.ros.receipts import TOPIC, Receipt

#: Time that a node of another process is given to discover its counterparts; wide margin [s].
_DISCOVERY = 0.75
#: What was seen holds for so long, and until there are more or fewer: publishers are seen before it is known
#: of which nodes they are [s].
_GLANCE = 0.1


class GraphWatch:
    """
    Knows the nodes of its own node's namespace that live, each by its last life.

    Nodes of one process know of each other at once; what is sent before those of another one do may be lost.
    """

    def __init__(self, node: Node, now: Callable[[], float] = time.monotonic) -> None:
        self._node = node
        self._now = now
        #: Node → the first receipt of its life, the latest last.
        self._nodes: dict[str, Receipt] = {}
        self._past: set[str] = set()
        self._settled_at = 0.0
        self._names: set[str] = set()
        self._n_seen, self._seen_at = 0, -math.inf

    def hear(self, receipt: Receipt) -> bool:
        """Note who speaks; return whether this life of the node was not known."""
        before = self._nodes.get(receipt.node)
        if self.is_past(receipt) or (before is not None and before.life == receipt.life):
            return False
        if before is not None:
            self._past.add(self._nodes.pop(receipt.node).life)
        self._nodes[receipt.node] = receipt
        if not receipt.is_of_this_process:
            self._settled_at = self._now() + _DISCOVERY
        return True

    def is_past(self, receipt: Receipt) -> bool:
        """Whether a receipt is of a life that is over."""
        return receipt.life in self._past

    @property
    def is_settled(self) -> bool:
        """Whether all nodes that can be seen have spoken, and know of each other."""
        return self._now() >= self._settled_at and self._seen() <= self._nodes.keys()

    def missing_replicas(self) -> list[str]:
        """Return which nodes are not there that take a share of the tiles, in words."""
        shares = {one.kind: one.replicas for one in self._nodes.values() if 1 < one.replicas <= MAX_REPLICAS}
        if not shares:
            return []
        seen = self._seen()
        there = {(one.kind, one.replica) for name, one in self._nodes.items() if name in seen}
        return [
            f"replica {number} of {n} of {kind}"
            for kind, n in sorted(shares.items())
            for number in range(n)
            if (kind, number) not in there
        ]

    def _seen(self) -> set[str]:
        """Return the names of the nodes that can be seen; to look at each of them takes long."""
        n_seen, now = self._node.count_publishers(TOPIC), self._now()
        if n_seen != self._n_seen or now - self._seen_at >= _GLANCE:
            self._names = {
                one.node_name
                for one in self._node.get_publishers_info_by_topic(TOPIC)
                if one.node_namespace == self._node.get_namespace()
            }
            self._n_seen, self._seen_at = n_seen, now
        return self._names
