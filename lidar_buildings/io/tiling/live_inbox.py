"""What has come of a feed and waits for its turn, as much as memory is meant for."""

from __future__ import annotations

import queue
from collections import Counter
from collections.abc import Callable
from typing import Any

#: Why points, and messages with poses, are left out: more wait than there is room for.
TOO_FAST = "came faster than they could be placed"
POSES_TOO_FAST = f"poses {TOO_FAST}"
#: Points, and messages, that may wait (about 0.5 GB each).
_MOST_POINTS, _MOST_MESSAGES = 10_000_000, 50_000

Work = Callable[[], Any]


class LiveInbox:
    """
    What is to be done with messages, in the order in which they came.

    `left_out` leads from a reason to the points, or messages with poses, for which there was no room.
    """

    def __init__(self) -> None:
        self.left_out: Counter[str] = Counter()
        self._waiting: queue.Queue[tuple[Work, int]] = queue.Queue()
        self._n_come = self._n_done = 0

    @property
    def n_points(self) -> int:
        """Points that wait, those under work among them."""
        return self._n_come - self._n_done

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits."""
        return self._waiting.empty()

    def fullness(self, n_points: int = 0) -> float:
        """Return which share of the room is taken, with so many points more."""
        return max((self.n_points + n_points) / _MOST_POINTS, self._waiting.qsize() / _MOST_MESSAGES)

    def put(self, work: Work, n_points: int = 0) -> None:
        """Let a message wait, if there is room for it."""
        if self.fullness(n_points) > 1.0:
            self.left_out[TOO_FAST if n_points else POSES_TOO_FAST] += n_points or 1
            return
        self._n_come += n_points
        self._waiting.put((work, n_points))

    def put_order(self, work: Work) -> None:
        """Let something wait that must not be left out."""
        self._waiting.put((work, 0))

    def work_on_next(self, do: Callable[[Work], None], timeout: float) -> None:
        """Do what waits for the longest time, if anything comes in so many seconds."""
        try:
            work, n_points = self._waiting.get(timeout=timeout)
        except queue.Empty:
            return
        do(work)
        self._n_done += n_points
