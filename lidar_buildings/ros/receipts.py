"""What every node says of the tiles in its hands: topic `tile_receipt`, a line of JSON each."""

from __future__ import annotations

import json
from typing import NamedTuple
from uuid import uuid4

from rclpy.node import Node
from std_msgs.msg import String

from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.ros.json_text import read_json
from lidar_buildings.ros.qos import LATCHED_EVENT

TOPIC = "tile_receipt"
#: What a node says: that it has started; that it works on a tile, or a part of it; what became of that.
READY, TAKEN, DONE, FAILED = "ready", "taken", "done", "failed"
#: Tells this process from all others that run nodes.
_PROCESS = uuid4().hex


class Receipt(NamedTuple):
    """One message."""

    node: str  #: the node's name
    life: str  #: another one each time the node is started
    state: str  #: one of the four above
    stamp: int  #: the tile's key [ns]; 0 where it is about none
    #: What nodes that share their tiles have in common; the node's name where it shares them with none.
    kind: str = ""
    #: The node is number `replica` of so many.
    replica: int = 0
    replicas: int = 1

    @property
    def is_of_this_process(self) -> bool:
        """Whether the node runs in this process."""
        return self.life.startswith(_PROCESS)


class ReceiptSender:
    """Publishes the receipts of a node, whose life begins with this."""

    def __init__(self, node: Node, kind: str = "", share: ReplicaConfig | None = None) -> None:
        self._name = node.get_name()
        share = share or ReplicaConfig()
        self._of = (kind or self._name, share.replica, share.replicas)
        self._life = f"{_PROCESS}.{uuid4().hex}"
        self._publisher = node.create_publisher(String, TOPIC, LATCHED_EVENT)

    def send(self, state: str, stamp: int = 0) -> None:
        """Say something of a tile."""
        self._publisher.publish(receipt_message(Receipt(self._name, self._life, state, stamp, *self._of)))


def receipt_message(receipt: Receipt) -> String:
    """Return the message of a receipt."""
    return String(data=json.dumps(receipt._asdict()))


def receipt_of(message: String) -> Receipt:
    """Return what a message says; MessageError if it is no receipt."""
    return read_json(
        TOPIC,
        message,
        lambda said: Receipt(
            *(str(said[name]) for name in ("node", "life", "state")),
            int(said["stamp"]),
            str(said.get("kind", said["node"])),
            int(said.get("replica", 0)),
            int(said.get("replicas", 1)),
        ),
    )
