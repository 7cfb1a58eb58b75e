"""Credits: which tiles are in the graph, and which must be sent again."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.depths import FEW_POINTS, MOST_TILES
from lidar_buildings.ros.receipts import FAILED, TAKEN, Receipt
from lidar_buildings.ros.stamps import tile_of

#: Silence after which a tile is lost that was under way when a node started, and what each point adds to it;
#: wide margins over the way of a message to a node that has nothing else to do [s].
_SILENCE, _POINT_SILENCE = 1.0, 2e-6
#: For so long a node may not know of all others that know of it: one whose first announcements got lost is
#: announced again after 3 s; margin of three [s].
_MEETING = 10.0


@dataclass
class Flight:
    """A tile in the graph."""

    tile: PointTile  #: as it was sent last
    #: Place of that among all that was sent, and of its points, where later only its bounds were sent.
    order: int
    order_of_points: int
    sent_at: float  #: by the clock of the account [s]
    #: How many times it was sent, the first included; what got lost on its way does not count.
    attempt: int = 1
    #: Whether no node can have it any more, and whether it was in the hands of one that was started anew.
    is_lost: bool = False
    has_ended_a_node: bool = False
    has_failed: bool = False  #: whether a node could not handle it
    since: float = field(default_factory=time.monotonic)  #: when its first revision was sent [s]


class FlowControl:
    """
    Keeps account of the tiles in flight, and of the nodes that work on them.

    A tile that a node has in its hands is never sent again, however long that takes. A tile in nobody's hands
    is lost if the node that had it was started anew, or if one that was sent later is done: topics keep their
    order, unless nodes share their tiles or have several in hand. Beside that it is lost if all nodes are
    idle and silent: for a few seconds if a node has started since, or shortly before, else for `timeout` [s],
    which doubles with each attempt; after `max_attempts` it is given up. At most `limit` tiles are in flight;
    0: as many as come, and none is waited for. Unless it is 1 there are more while they have few points: on
    its way from node to node nobody works on a tile.
    """

    def __init__(
        self, limit: int, timeout: float, max_attempts: int, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._limit = limit
        self._timeout = timeout
        self._max_attempts = max_attempts
        self._now = now
        self._flights: dict[int, Flight] = {}
        self._at_work: dict[str, set[int]] = {}
        self._n_sent = self._n_done = self._n_given_up = 0
        self._latency = 0.0
        self._keeps_order = True
        self._last_event = now()
        self._last_start = -math.inf

    def __len__(self) -> int:
        """Return the number of tiles in flight."""
        return len(self._flights)

    def gauges(self) -> dict[str, float]:
        """
        Return how it goes.

        `latency` is the time from sending to done of the tile that was done last, `silence` that since a node
        has said something [s].
        """
        return {
            "tiles_in_flight": len(self._flights),
            "tiles_done": self._n_done,
            "tiles_given_up": self._n_given_up,
            "latency": self._latency,
            "silence": self._now() - self._last_event,
        }

    @property
    def is_counting(self) -> bool:
        """Whether tiles are waited for."""
        return self._limit > 0

    @property
    def has_room(self) -> bool:
        """Whether one more tile may be sent."""
        if len(self._flights) < self._limit or not self.is_counting:
            return True
        n_points = sum(len(flight.tile) for flight in self._flights.values())
        return self._limit > 1 and len(self._flights) < MOST_TILES and n_points < FEW_POINTS

    def is_held(self, stamp: int) -> bool:
        """Whether a node has a tile in its hands, whatever revision of it."""
        return any(tile_of(stamp) in map(tile_of, stamps) for stamps in self._at_work.values())

    def tile(self, stamp: int) -> PointTile | None:
        """Return a tile in flight as it was sent last, None if it is not in flight."""
        flight = self._flights.get(tile_of(stamp))
        return None if flight is None else flight.tile

    def sent(self, tile: PointTile) -> None:
        """
        Note that a tile was sent, for the first time or with other points or bounds.

        Where the revision stays only its bounds were sent: they keep no order with other tiles' points, so
        that its end says nothing of tiles that were sent between its points and its bounds.
        """
        if self.is_counting:
            before = self._flights.get(tile_of(tile.stamp))
            flight = self._flights[tile_of(tile.stamp)] = self._begun(tile)
            if before is not None:
                flight.attempt, flight.since = before.attempt, before.since
                if before.tile.stamp == tile.stamp:
                    flight.order_of_points = before.order_of_points
            self._note_event()

    def done(self, stamp: int) -> bool:
        """Note that a tile is done; False if it was not in flight."""
        done = self._flights.pop(tile_of(stamp), None)
        if done is None:
            return False
        self._latency = time.monotonic() - done.since
        self._n_done += 1
        if self._keeps_order:
            for flight in self._flights.values():
                is_passed = flight.order < done.order_of_points
                flight.is_lost |= is_passed and not self.is_held(flight.tile.stamp)
        self._last_event = self._now()
        return True

    def started(self, node: str) -> None:
        """Note that a node was started: what it had in its hands is lost, what was on its way may be."""
        held = self._at_work.pop(node, set())
        self._last_start = self._now()
        for stamp, flight in self._flights.items():
            flight.has_ended_a_node |= stamp in map(tile_of, held)
            flight.is_lost |= stamp in map(tile_of, held)

    def hear(self, receipt: Receipt) -> None:
        """Note what a node does with a tile."""
        self._last_event = self._now()
        in_hand = self._at_work.setdefault(receipt.node, set())
        if receipt.state == TAKEN:
            in_hand.add(receipt.stamp)
            self._keeps_order &= receipt.replicas == len(in_hand) == 1
            return
        in_hand.discard(receipt.stamp)
        flight = self._flights.get(tile_of(receipt.stamp))
        if flight is not None:
            flight.has_failed |= receipt.state == FAILED

    @property
    def has_losses(self) -> bool:
        """Whether a tile is lost."""
        return any(map(self._is_due, self._flights.values()))

    def overdue(self) -> list[Flight]:
        """Return the flights that are lost and get another attempt, as flights that begin anew."""
        late = [one for one in self._flights.values() if self._is_due(one) and not self._is_over(one)]
        for one in late:
            attempt = one.attempt + self._counts(one)
            self._flights[tile_of(one.tile.stamp)] = self._begun(one.tile, attempt=attempt, since=one.since)
            self._note_event()
        return [self._flights[tile_of(one.tile.stamp)] for one in late]

    def given_up(self) -> list[int]:
        """
        Remove the tiles that a node could not handle, or whose last attempt is up; return their last stamps.
        """
        lost = [
            one.tile.stamp
            for one in self._flights.values()
            if one.has_failed or (self._is_due(one) and self._is_over(one))
        ]
        for stamp in lost:
            del self._flights[tile_of(stamp)]
        self._n_given_up += len(lost)
        return lost

    def forget(self) -> list[int]:
        """Remove all tiles; return their last stamps."""
        stamps = [one.tile.stamp for one in self._flights.values()]
        self._flights.clear()
        return stamps

    def _begun(self, tile: PointTile, **members: Any) -> Flight:
        return Flight(tile, self._n_sent, self._n_sent, self._now(), **members)

    def _note_event(self) -> None:
        self._n_sent += 1
        self._last_event = self._now()

    def _is_due(self, flight: Flight) -> bool:
        """Whether a tile is lost."""
        if self.is_held(flight.tile.stamp):
            return False
        return flight.is_lost or (
            not any(self._at_work.values())
            and self._now() - self._last_event >= self._longest_silence(flight)
        )

    def _longest_silence(self, flight: Flight) -> float:
        if self._is_in_doubt(flight):
            return _SILENCE + _POINT_SILENCE * len(flight.tile)
        return self._timeout * 2 ** (flight.attempt - 1)

    def _is_in_doubt(self, flight: Flight) -> bool:
        """Whether a tile may be lost since not all nodes knew of each other when it was sent, or after."""
        return flight.sent_at < self._last_start + _MEETING

    def _counts(self, flight: Flight) -> bool:
        """Whether sending a tile again is an attempt."""
        return flight.has_ended_a_node or not (flight.is_lost or self._is_in_doubt(flight))

    def _is_over(self, flight: Flight) -> bool:
        return self._counts(flight) and flight.attempt >= self._max_attempts
