"""What nodes say on `diagnostics`: a status for every tile, and once a second how the node gets on."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header

from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.stamps import header_of

TOPIC = "diagnostics"
#: Behind the node's name in the name of the status that sums a node up.
SUMMARY = ": summary"
#: Levels as in diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR = 0, 1, 2
#: Period of the summaries, as that of diagnostic_updater; how long what went wrong with a tile counts as how
#: the node is; and after how long without news of tiles in flight, of which few take so long, it warns [s].
_PERIOD, _RECENT, _STALE = 1.0, 60.0, 30.0


@dataclass
class TileReport:
    """A node's report of a tile."""

    stamp: int  #: the tile's key [ns]
    n_points: int = 0  #: points that came in
    warnings: list[str] = field(default_factory=list)  #: what was wrong but did not keep the tile
    counts: dict[str, int] = field(default_factory=dict)  #: what the node counted beside points, by name
    started: float = field(default_factory=time.perf_counter)


class NodeSummary:
    """
    Counts of one node since it was started.

    `counts` is what it counts beside tiles and points, and may add to; `problem` why it cannot do its work,
    empty if it can; `gauges` are functions that return numbers as they are now.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self.counts: Counter[str] = Counter()
        self.problem = ""
        self.gauges: list[Callable[[], Mapping[str, float]]] = []
        self._now = now
        counted = ("tiles_in", "points_in", "tiles_out", "points_out", "tiles_failed")
        self._totals = Counter(dict.fromkeys(counted, 0))
        self._in_hand: set[int] = set()
        self._seconds = self._last_seconds = 0.0
        self._heard = -1.0
        self._trouble: dict[int, tuple[float, str]] = {}

    def heard(self) -> None:
        """Note that something came in."""
        self._heard = self._now()

    def taken(self, stamp: int) -> None:
        """Note that the node works on a tile."""
        self._totals["tiles_in"] += 1
        self._in_hand.add(stamp)
        self.heard()

    def ended(self, stamp: int, n_points: int, seconds: float) -> None:
        """Note that the work on it is over."""
        self._in_hand.discard(stamp)
        self._totals["points_in"] += n_points
        self._seconds += seconds
        self._last_seconds = seconds

    def passed_on(self, n_points: int) -> None:
        """Note that the results of a tile were published."""
        self._totals["tiles_out"] += 1
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

    def state(self) -> tuple[int, str, dict[str, float]]:
        """Return how the node is: level, a few words, and numbers by name."""
        values: dict[str, float] = {
            **self._totals,
            "tiles_in_hand": len(self._in_hand),
            "seconds_last_tile": self._last_seconds,
            "seconds": self._seconds,
            **self.counts,
        }
        if self._heard >= 0:
            values["input_age"] = self._now() - self._heard
        for gauges in self.gauges:
            with suppress(RuntimeError):  # of a mapping to which another thread has just added something
                values.update(gauges())
        if self.problem:
            return ERROR, self.problem, values
        for level in (ERROR, WARN):
            since, text = self._trouble.get(level, (0.0, ""))
            if text and self._now() - since < _RECENT:
                return level, text, values
        silence = values.get("silence", 0.0)
        if values.get("tiles_in_flight") and silence > _STALE:
            return WARN, f"no news of the tiles in flight for {silence:.0f} s", values
        return OK, f"working on tile {min(self._in_hand)}" if self._in_hand else "idle", values


class Diagnostics:
    """Publishes a node's diagnostics; `summary` is what the node counts over all tiles."""

    def __init__(self, node: Node, parameters: Callable[[], Mapping[str, Any]]) -> None:
        self.summary = NodeSummary()
        self._node = node
        self._parameters = parameters
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, EVENT)
        node.create_timer(_PERIOD, self.publish_summary)

    def end_tile(self, report: TileReport, error: str = "") -> None:
        """Say what became of a tile."""
        seconds = time.perf_counter() - report.started
        self.summary.ended(report.stamp, report.n_points, seconds)
        level, text = OK, "done"
        if report.warnings:
            level, text = WARN, "; ".join(report.warnings)
            self.summary.warned(text)
        if error:
            level, text = ERROR, error
            self.summary.failed(f"tile {report.stamp}: {error}")
        values = {
            "tile": str(report.stamp),
            "seconds": f"{seconds:.6f}",
            "points": str(report.n_points),
            **{name: str(count) for name, count in report.counts.items()},
            "parameters": json.dumps(self._parameters()),
        }
        self._publish(header_of(report.stamp), level, "", text, values)

    def publish_summary(self) -> None:
        """Say how the node gets on."""
        level, text, numbers = self.summary.state()
        values = {name: f"{value:.3f}".rstrip("0").rstrip(".") for name, value in numbers.items()}
        header = Header(stamp=self._node.get_clock().now().to_msg())
        self._publish(header, level, SUMMARY, text, values)

    def _publish(self, header: Header, level: int, suffix: str, text: str, values: dict[str, str]) -> None:
        status = DiagnosticStatus(
            level=bytes([level]),
            name=f"{self._node.get_name()}{suffix}",
            message=text,
            hardware_id=self._node.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        self._publisher.publish(DiagnosticArray(header=header, status=[status]))
