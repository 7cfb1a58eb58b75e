"""A node's state on `node_state`: a few times a second and whenever it changes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from uuid import uuid4

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.ros.qos import LATCHED, LATCHED_EVENT
from lidar_buildings.ros.stamps import tile_of
from lidar_buildings.ros.text_messages import read_json
from lidar_buildings.ros.tile_ledger import IN_HAND, NodeState, TileState

TOPIC = "node_state"
#: Period of the states [s].
PERIOD = 0.4
#: How many tiles are listed; wide margin: at most 8 are in flight. The oldest that are not in hand go first.
_MOST = 64
#: Who hears states takes all that wait; each node keeps its last one for late listeners.
LISTENER_QOS = LATCHED_EVENT


class StatePublisher:
    """
    Publishes what its node has of each tile; the node's life begins with this.

    `is_stage` says whether tiles go through the node, `outputs` are its publishers that others wait for,
    `n_done` is how many tiles it has reported as done.
    """

    def __init__(self, node: Node, kind: str, share: ReplicaConfig, outputs: Sequence[Publisher]) -> None:
        self.is_stage, self.n_done = False, 0
        self._node, self._kind, self._share, self._outputs = node, kind, share, outputs
        self._life, self._sequence = uuid4().hex, 0
        self._tiles: OrderedDict[int, TileState] = OrderedDict()
        self._publisher = node.create_publisher(String, TOPIC, LATCHED)
        node.create_timer(PERIOD, self.publish)

    def publish(self) -> None:
        """Publish the state as it is now."""
        self._sequence += 1
        state = NodeState(
            self._node.get_name(),
            self._life,
            self._sequence,
            self._tiles,
            self.is_stage,
            self._kind,
            self._share.replica,
            self._share.replicas,
            self.n_done,
            {one.topic_name: one.get_subscription_count() for one in self._outputs},
        )
        self._publisher.publish(String(data=state.text()))

    def has_in_hand(self, stamp: int) -> bool:
        """Whether the node works on a tile in this revision."""
        return stamp in self._tiles and self._tiles[stamp].status == IN_HAND

    def set(self, stamp: int, status: str, missing: Iterable[str] = (), reason: str = "") -> None:
        """Say what the node has of a tile, which parts or sides of it are missing, or why it failed."""
        state = TileState(status, tuple(sorted(missing)), reason)
        if self._tiles.get(stamp) == state:
            return
        self._tiles[stamp] = state
        self._tiles.move_to_end(stamp)
        idle = [one for one, at in self._tiles.items() if at.status != IN_HAND]
        earlier = [one for one in idle if one < stamp and tile_of(one) == tile_of(stamp)]
        for other in earlier or idle[: max(0, len(self._tiles) - _MOST)]:
            del self._tiles[other]
        self.publish()

    def forget(self, is_over: Callable[[int], bool]) -> None:
        """Drop the tiles that are over, but those in hand."""
        over = [one for one, at in self._tiles.items() if at.status != IN_HAND and is_over(one)]
        for stamp in over:
            del self._tiles[stamp]
        if over:
            self.publish()


def state_of(message: String) -> NodeState:
    """Return what a message says; MessageError if it is no state."""
    return read_json(TOPIC, message, NodeState.of)
