"""Credits: which tiles are in the graph, and which must be sent again."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from lidar_buildings.core.model.tile import PointTile

#: Time that a tile gets that should be done by now; wide margin over a message's way [s].
_GRACE = 1.0
#: After this time a tile is sent again as long as nothing has come through the graph; then doubled. Wide
#: margin over the discovery of nodes [s].
_FIRST_RETRY = 10.0


@dataclass
class Flight:
    """
    A tile in the graph.

    Attributes
    ----------
    tile : PointTile
        As it was sent last.
    attempt : int
        How many times it was given its time, the first included.
    sent, deadline : float
        When it was sent last, and when the time is up [s].
    n_copies, n_clipped : int
        How many times these same points were sent, and how many times they came back as clipped.
    is_lost : bool
        Whether it got lost on its way: sending it again counts as no attempt.
    """

    tile: PointTile
    attempt: int
    sent: float
    deadline: float
    n_copies: int = 1
    n_clipped: int = 0
    is_lost: bool = False


class FlowControl:
    """
    Keeps account of the tiles in flight.

    Topics keep their order, so a tile is lost if one that was sent later is done before it. Until a first
    tile is done, at the start and after a restart, nodes may not have found each other yet, and tiles are
    sent again soon. Neither counts as an attempt.

    Parameters
    ----------
    limit : int
        How many tiles may be in flight; 0: as many as come, and none is waited for.
    timeout : float
        Time that a tile has at its first attempt; doubles with each attempt [s].
    max_attempts : int
        After so many a tile is given up.
    now : callable
        The clock [s].
    """

    def __init__(
        self,
        limit: int,
        timeout: float,
        max_attempts: int,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._limit = limit
        self._timeout = timeout
        self._max_attempts = max_attempts
        self._now = now
        self._flights: dict[int, Flight] = {}
        self._retry: float | None = _FIRST_RETRY

    def __len__(self) -> int:
        """Return the number of tiles in flight."""
        return len(self._flights)

    @property
    def is_counting(self) -> bool:
        """Whether tiles are waited for."""
        return self._limit > 0

    @property
    def has_room(self) -> bool:
        """Whether one more tile may be sent."""
        return not self.is_counting or len(self._flights) < self._limit

    def sent(self, tile: PointTile) -> None:
        """Note that a tile was sent for the first time."""
        if self.is_counting:
            now = self._now()
            self._flights[tile.stamp] = Flight(tile, 1, now, now + self._time_allowed(1))

    def done(self, stamp: int) -> bool:
        """Note that a tile is done; False if it was not in flight."""
        done = self._flights.pop(stamp, None)
        if done is None:
            return False
        now = self._now()
        for flight in self._flights.values():
            if flight.sent < done.sent:
                flight.deadline, flight.is_lost = min(flight.deadline, now + _GRACE), True
            elif self._retry is not None:
                flight.deadline = flight.sent + self._timeout * 2 ** (flight.attempt - 1)
        self._retry = None
        return True

    def failed(self, stamp: int) -> bool:
        """Note that a node could not handle a tile: its time is up at once; False if it was not in flight."""
        flight = self._flights.get(stamp)
        if flight is not None:
            flight.deadline = self._now()
        return flight is not None

    def clipped(self, stamp: int) -> PointTile | None:
        """
        Note that a tile came back as clipped; return it if it is time to send a larger one.

        Copies of the smaller tile that are still under way must not meet the larger one's bounds, so the
        larger one waits until all have come back, or the time is up.
        """
        flight = self._flights.get(stamp)
        if flight is None:
            return None
        flight.n_clipped += 1
        if flight.n_clipped < flight.n_copies:
            # the other copy needs about as long, or is lost
            under_way = self._now() - flight.sent
            flight.deadline = min(flight.deadline, self._now() + 2 * under_way + _GRACE)
        return flight.tile if flight.n_clipped >= flight.n_copies else None

    def replaced(self, tile: PointTile) -> None:
        """Note that a tile was sent with other points or bounds."""
        attempt, now = self._flights[tile.stamp].attempt, self._now()
        self._flights[tile.stamp] = Flight(tile, attempt, now, now + self._time_allowed(attempt))

    def expire(self) -> None:
        """Note that all tiles in flight may be lost, since a node has started: they are due again at once."""
        self._retry = _FIRST_RETRY
        for flight in self._flights.values():
            flight.deadline, flight.is_lost = self._now(), True

    def overdue(self) -> list[Flight]:
        """Return the flights whose time is up and that get another attempt; their time starts anew."""
        now = self._now()
        late = [f for f in self._flights.values() if f.deadline <= now and f.attempt < self._max_attempts]
        is_free = self._is_retrying
        if late and self._retry is not None:
            self._retry *= 2
        for flight in late:
            flight.attempt += not (flight.is_lost or is_free)
            flight.is_lost = False
            flight.n_copies += 1
            flight.sent, flight.deadline = now, now + self._time_allowed(flight.attempt)
        return late

    def given_up(self) -> list[int]:
        """Remove and return the tiles whose last attempt is up."""
        now = self._now()
        lost = [
            stamp
            for stamp, f in self._flights.items()
            if f.deadline <= now and f.attempt >= self._max_attempts
        ]
        for stamp in lost:
            del self._flights[stamp]
        return lost

    def _time_allowed(self, attempt: int) -> float:
        """Return the time [s] of an attempt, counted from 1."""
        if self._retry is not None and self._is_retrying:
            return self._retry
        return float(self._timeout * 2 ** (attempt - 1))

    @property
    def _is_retrying(self) -> bool:
        """Whether nothing has come through yet, and a tile's own time is longer than it takes to see that."""
        return self._retry is not None and self._retry < self._timeout
