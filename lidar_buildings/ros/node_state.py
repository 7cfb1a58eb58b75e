"""What a node says of itself and its tiles on `node_state`, a few times a second and when it changes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from std_msgs.msg import String

from lidar_buildings.core.model.bounds import checked_stamp
from lidar_buildings.ros.text_messages import read_json

TOPIC = "node_state"
#: Period of the states [s].
PERIOD = 0.4
#: What a node says of a tile; where it waits it names the parts that are missing.
WAITING, IN_HAND, PASSED_ON, FAILED = "waiting", "in_hand", "passed_on", "failed"


class TileState(NamedTuple):
    """What a node has of a tile."""

    status: str
    missing: tuple[str, ...] = ()  #: parts that are waited for; sides, if the tile is too small
    reason: str = ""  #: why the node could not handle it


class NodeState(NamedTuple):
    """What a node says of itself."""

    node: str
    life: str  #: another one each time the node is started
    sequence: int
    tiles: Mapping[int, TileState] = MappingProxyType({})  #: by stamp [ns]
    #: Whether tiles go through it. The others are never waited for.
    is_stage: bool = True
    #: Nodes of one kind share the tiles; the node is number `replica` of so many.
    kind: str = ""
    replica: int = 0
    replicas: int = 1
    n_done: int = 0  #: tiles that it has reported as done
    #: Topic → how many subscriptions of it the node has found.
    matched: Mapping[str, int] = MappingProxyType({})

    def message(self) -> String:
        """Return it as JSON."""
        return String(
            data=json.dumps({**self._asdict(), "tiles": {**self.tiles}, "matched": {**self.matched}})
        )


#: Members of a state that are text or numbers.
_KINDS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("node", "life", "kind"), str),
    **dict.fromkeys(("sequence", "replica", "replicas", "n_done"), int),
    "is_stage": bool,
}


def state_of(message: String) -> NodeState:
    """Return what a message says; MessageError if it is no state."""

    def read(said: Any) -> NodeState:
        found = {name: kind(said[name]) for name, kind in _KINDS.items() if name in said}
        found["tiles"] = {
            checked_stamp(stamp): TileState(str(status), tuple(map(str, missing)), str(reason))
            for stamp, (status, missing, reason) in said.get("tiles", {}).items()
        }
        found["matched"] = {str(topic): int(n) for topic, n in said.get("matched", {}).items()}
        return NodeState(**found)

    return read_json(TOPIC, message, read)
