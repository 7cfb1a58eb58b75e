"""
Which tiles are in the graph, and which are lost: one rule, by the states that nodes publish.

A tile is lost when no node that is there has it in hand, every node has sent two later states, nothing has
changed in them, and the tile has had the time that its size takes. It is sent once more, and the same
counts from then on. A state holds until its node sends another, begins a new life or leaves the graph:
silence proves nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field

from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.replicas import MAX_REPLICAS
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.depths import FEW_POINTS, MOST_TILES
from lidar_buildings.ros.node_state import FAILED, IN_HAND, WAITING, NodeState, TileState

#: Parts that are points beyond the tile's sides, which the source sends in a larger revision.
SIDES = Sides._fields
#: Bytes of a point on its way, and how many pass a slow link in a second.
_POINT, _RATE = 32, 50e6
#: How many later states of a node without the tile are needed, and how often the wait is doubled at most.
_STATES, _MOST_DOUBLED = 2, 6
#: Nodes that have just come are given so long to know of each other [s].
_MEETING = 5.0


@dataclass
class _Heard:
    """A node, as it was heard last."""

    state: NodeState
    since: float  #: when this life was first heard [s]
    n_heard: int
    is_there: bool = True


@dataclass
class Flight:
    """A tile in the graph."""

    tile: PointTile  #: as it was sent last
    began: float  #: when its first revision was sent [s]
    since: float = 0.0  #: when it was sent, or something about it changed [s]
    #: Node → how many of its states had been heard when those that were on their way had come.
    heard: dict[str, int] | None = None
    n_lost: int = 0  #: how often in succession without anything new
    n_resent: int = 0
    n_deaths: int = 0  #: nodes that died with it in hand
    is_adopted: bool = False  #: whether it was under way before the source was started


@dataclass
class TileLedger:
    """
    Keeps account of the tiles in flight: at most `limit`, 0 for as many as come, of which none is waited for.

    Unless `limit` is 1 more are in flight while they have few points. `patience` is the least time after
    which a tile may be lost [s]. A tile that `max_attempts` nodes died with is given up, and so is one that a
    node cannot handle.
    """

    limit: int
    patience: float
    max_attempts: int
    now: Callable[[], float] = time.monotonic
    #: Tile → the last revision of it that is done; and tiles that were given up.
    finished: dict[int, int] = field(default_factory=dict)
    failed: set[int] = field(default_factory=set)
    _latency: float = 0.0
    _flights: dict[int, Flight] = field(default_factory=dict)
    _nodes: dict[str, _Heard] = field(default_factory=dict)
    _past: set[str] = field(default_factory=set)

    def __len__(self) -> int:
        """Return the number of tiles in flight."""
        return len(self._flights)

    def gauges(self) -> dict[str, float]:
        """Return how it goes; `latency` is the last tile's, `silence` since anything changed [s]."""
        changed = [one.since for one in self._flights.values()]
        return {
            "tiles_in_flight": len(self._flights),
            "tiles_done": len(self.finished),
            "tiles_given_up": len(self.failed),
            "latency": self._latency,
            "silence": self.now() - max(changed, default=self.now()),
        }

    @property
    def has_room(self) -> bool:
        """Whether one more tile may be sent."""
        if len(self._flights) < self.limit or not self.limit:
            return True
        n_points = sum(len(flight.tile) for flight in self._flights.values())
        return self.limit > 1 and len(self._flights) < MOST_TILES and n_points < FEW_POINTS

    def listed(self, *, is_adopted: bool = False) -> list[PointTile]:
        """Return the tiles in flight as they were sent last; those adopted from an earlier life apart."""
        return [flight.tile for flight in self._flights.values() if flight.is_adopted == is_adopted]

    def tile(self, stamp: int) -> PointTile | None:
        """Return a tile in flight as it was sent last, None if it is not in flight."""
        flight = self._flights.get(tile_of(stamp))
        return None if flight is None else flight.tile

    # what is heard

    def hear(self, state: NodeState) -> None:
        """Note a node's state; one of an earlier life, or older than the last one, says nothing."""
        if state.life in self._past:
            return
        one = self._nodes.setdefault(state.node, _Heard(state, self.now(), 0))
        before = one.state if one.n_heard else state._replace(tiles={})
        if before.life != state.life:
            self._past.add(before.life)
            one.since = self.now()
            for stamp, at in before.tiles.items():
                flight = self._flights.get(tile_of(stamp))
                if flight is not None and flight.tile.stamp == stamp and at.status == IN_HAND:
                    flight.n_deaths += 1
        elif one.n_heard and one.is_there and state.sequence <= before.sequence:
            return
        one.state, one.is_there, one.n_heard = state, True, one.n_heard + 1
        self._note_changes(before.tiles, state.tiles)

    def see(self, nodes: Collection[str]) -> None:
        """Note which nodes are in the graph; one that leaves and returns with the same life has its tiles."""
        for name, one in self._nodes.items():
            if one.is_there != (name in nodes):
                one.is_there = name in nodes
                self._note_changes(one.state.tiles, {})

    def _note_changes(self, before: Mapping[int, TileState], after: Mapping[int, TileState]) -> None:
        for stamp in before.keys() | after.keys():
            flight = self._flights.get(tile_of(stamp))
            if flight is not None and before.get(stamp) != after.get(stamp):
                flight.since, flight.heard, flight.n_lost = self.now(), None, 0

    # who is there

    def is_settled(self, seen: Collection[str], listeners: Callable[[str], int]) -> bool:
        """
        Whether all nodes that are seen have said something, and know of each other's subscriptions.

        `listeners` returns how many subscriptions of a topic the source sees. Nodes that do not find each
        other, or of which not all done tiles have been heard, are waited for a few seconds.
        """
        there = self._there()
        if not {*seen} <= {one.state.node for one in there}:
            return False
        if all(self.now() - one.since >= _MEETING for one in there):
            return True
        return max((one.state.n_done for one in there), default=0) <= len(self.finished) and all(
            n >= listeners(topic) for one in there for topic, n in one.state.matched.items()
        )

    def missing_replicas(self) -> list[str]:
        """Return which nodes are not there that take a share of the tiles, in words."""
        states = [one.state for one in self._there()]
        shares = {one.kind: one.replicas for one in states if 1 < one.replicas <= MAX_REPLICAS}
        there = {(one.kind, one.replica) for one in states}
        return [
            f"replica {number} of {n} of {kind}"
            for kind, n in sorted(shares.items())
            for number in range(n)
            if (kind, number) not in there
        ]

    def _there(self) -> list[_Heard]:
        return [one for one in self._nodes.values() if one.is_there]

    def latest(self, stamp: int) -> int | None:
        """Return the last revision of a tile that a node has, None if no node has any."""
        found = [at for one in self._there() for at in one.state.tiles if tile_of(at) == tile_of(stamp)]
        return max(found, default=None)

    # what is sent and done

    def sent(self, tile: PointTile, *, is_adopted: bool = False) -> None:
        """Note that a tile was sent, for the first time, again, or with other points or bounds."""
        if not self.limit:
            return
        number = tile_of(tile.stamp)
        flight = self._flights.setdefault(number, Flight(tile, self.now()))
        flight.tile, flight.since, flight.heard, flight.is_adopted = tile, self.now(), None, is_adopted

    def done(self, stamp: int) -> bool:
        """Note that a revision of a tile is done; False if a later one is in flight."""
        number = tile_of(stamp)
        flight = self._flights.get(number)
        if flight is not None:
            if stamp < flight.tile.stamp:
                return False
            self._latency = self.now() - flight.began
            del self._flights[number]
        self.finished[number] = max(stamp, self.finished.get(number, stamp))
        self.failed.discard(number)
        return True

    def is_done(self, stamp: int) -> bool:
        """Whether this revision of a tile, or a later one, is done."""
        return stamp <= self.finished.get(tile_of(stamp), -1)

    def forget(self) -> None:
        """Remove all tiles."""
        for of_tiles in (self._flights, self.finished, self.failed):
            of_tiles.clear()

    # what is to be done

    def lost(self) -> list[Flight]:
        """Return the flights that are lost, to be sent once more; each is told once."""
        found = [flight for flight in self._flights.values() if self._is_lost(flight)]
        for flight in found:
            flight.since, flight.heard = self.now(), None
            flight.n_lost += 1
            flight.n_resent += 1
        return found

    def wanted(self) -> Iterator[tuple[PointTile, Sides]]:
        """Yield the tiles that a node has found too small, and beyond which sides it needs points."""
        for flight in list(self._flights.values()):
            if sides := self._wanted(flight):
                yield flight.tile, sides

    def given_up(self) -> dict[int, str]:
        """Remove the tiles that a node cannot handle, or ended too many nodes; return stamps and reasons."""
        found = {}
        for flight in self._flights.values():
            failed = [one.reason for one in self._states(flight) if one.status == FAILED]
            if failed:
                found[flight.tile.stamp] = failed[0]
            elif flight.n_deaths >= self.max_attempts:
                found[flight.tile.stamp] = f"{flight.n_deaths} nodes ended while they worked on it"
        for stamp in found:
            del self._flights[tile_of(stamp)]
        self.failed.update(map(tile_of, found))
        return found

    def _states(self, flight: Flight) -> list[TileState]:
        """Return what the nodes that are there say of a tile in the revision that was sent last."""
        stamp = flight.tile.stamp
        return [one.state.tiles[stamp] for one in self._there() if stamp in one.state.tiles]

    def _wanted(self, flight: Flight) -> Sides:
        """Return beyond which sides of a tile points are missing, none if it is known that there are none."""
        missing = {part for one in self._states(flight) if one.status == WAITING for part in one.missing}
        sides = Sides(*(side in missing for side in SIDES))
        return NONE if sides.opened(flight.tile.bounds) == flight.tile.bounds else sides

    def _is_lost(self, flight: Flight) -> bool:
        has_it = any(one.status in (IN_HAND, FAILED) for one in self._states(flight))
        if has_it or self._wanted(flight):
            return False
        patience = self.patience + len(flight.tile) * _POINT / _RATE
        patience *= 2.0 ** min(flight.n_lost, _MOST_DOUBLED)
        waited = self.now() - flight.since
        stages = {one.state.node: one.n_heard for one in self._there() if one.state.is_stage}
        if waited < 0.5 * patience or not stages:  # states that were on their way still come
            return False
        # a node that has come, or is back, since has to speak, too
        before = stages if flight.heard is None else flight.heard
        flight.heard = {name: before.get(name, n) for name, n in stages.items()}
        later = all(n - flight.heard[name] >= _STATES for name, n in stages.items())
        return later and waited >= patience
