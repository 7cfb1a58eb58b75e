"""How a node gets on: what it counts over all tiles, and whether something is wrong. It needs no ROS."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import NamedTuple

#: Levels as in diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR = 0, 1, 2
#: So long what went wrong with a tile counts as how the node is [s].
_RECENT = 60.0
#: Tiles in flight of which nothing has been heard for so long are worth a warning [s]; wide margin: nodes
#: speak whenever they take or end a tile, and few tiles take longer.
_STALE = 30.0
#: Tiles that are remembered, to count each once; wide margin: at most 8 are in flight.
_REMEMBERED = 256


class State(NamedTuple):
    """Level, a few words, and numbers by name."""

    level: int
    message: str
    values: dict[str, float]


class NodeSummary:
    """
    Counts of one node since it was started.

    `counts` is what it counts beside tiles and points, and may add to; `problem` why it cannot do its work,
    empty if it can.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self.counts: Counter[str] = Counter()
        self.problem = ""
        self._now = now
        self._gauges: list[Callable[[], Mapping[str, float]]] = []
        self._seen: dict[str, OrderedDict[int, None]] = {
            "tiles_in": OrderedDict(),
            "tiles_out": OrderedDict(),
        }
        counted = ("tiles_in", "points_in", "tiles_out", "points_out", "tiles_failed")
        self._totals: Counter[str] = Counter(dict.fromkeys(counted, 0))
        self._in_hand: Counter[int] = Counter()
        self._seconds, self._last_tile, self._last_seconds = 0.0, -1, 0.0
        self._heard = -1.0
        self._trouble: dict[int, tuple[float, str]] = {}

    def watch(self, gauges: Callable[[], Mapping[str, float]]) -> None:
        """Have numbers as they are now told beside the counts."""
        self._gauges.append(gauges)

    def heard(self) -> None:
        """Note that something came in."""
        self._heard = self._now()

    def taken(self, stamp: int) -> None:
        """Note that the node works on a tile, or a part of it."""
        self._count_once("tiles_in", stamp)
        self._in_hand[stamp] += 1
        self.heard()

    def ended(self, stamp: int, n_points: int, seconds: float) -> None:
        """Note that the work on it is over."""
        self._in_hand[stamp] -= 1
        self._in_hand += Counter()  # drops zeros
        self._totals["points_in"] += n_points
        self._seconds += seconds
        self._last_seconds = seconds + (self._last_seconds if stamp == self._last_tile else 0.0)
        self._last_tile = stamp

    def passed_on(self, stamp: int, n_points: int) -> None:
        """Note that the results of a tile were published, or a part of it."""
        self._count_once("tiles_out", stamp)
        self._totals["points_out"] += n_points

    def warned(self, text: str) -> None:
        """Note what was wrong with a tile but did not keep it."""
        self._trouble[WARN] = (self._now(), text)

    def failed(self, text: str) -> None:
        """Note that a tile could not be handled."""
        self._totals["tiles_failed"] += 1
        self._trouble[ERROR] = (self._now(), text)

    def count_buildings(self, statuses: Iterable[str]) -> None:
        """Count buildings by their status."""
        self.counts.update(f"buildings_{status}" for status in statuses)

    @property
    def is_at_work(self) -> bool:
        """Whether a tile is in hand."""
        return bool(self._in_hand)

    def total(self, name: str) -> int:
        """Return a count of `state`, in any thread."""
        return self._totals[name] + self.counts[name]

    def state(self) -> State:
        """Return how the node is."""
        values: dict[str, float] = {
            **self._totals,
            "tiles_in_hand": len(self._in_hand),
            "seconds_last_tile": self._last_seconds,
            "seconds": self._seconds,
            **({"input_age": self._now() - self._heard} if self._heard >= 0 else {}),
            **self.counts,
        }
        for gauges in self._gauges:
            with suppress(RuntimeError):  # of a mapping to which another thread has just added something
                values.update(gauges())
        return State(*self._level(values), values)

    def _level(self, values: Mapping[str, float]) -> tuple[int, str]:
        if self.problem:
            return ERROR, self.problem
        for level in (ERROR, WARN):
            since, text = self._trouble.get(level, (0.0, ""))
            if text and self._now() - since < _RECENT:
                return level, text
        silence = values.get("silence", 0.0)
        if values.get("tiles_in_flight") and silence > _STALE:
            return WARN, f"no news of the tiles in flight for {silence:.0f} s"
        return OK, f"working on tile {next(iter(self._in_hand))}" if self._in_hand else "idle"

    def _count_once(self, name: str, stamp: int) -> None:
        """Count a tile, a part of which may have been counted."""
        seen = self._seen[name]
        if stamp not in seen:
            self._totals[name] += 1
            seen[stamp] = None
            if len(seen) > _REMEMBERED:
                seen.popitem(last=False)
