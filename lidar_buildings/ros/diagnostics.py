"""What nodes say on `diagnostics`: a status for every tile, and once a second how the node gets on."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
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
    How one node gets on since it was started.

    `counts` are of tiles and points, and of what else the node counts; `problem` is why it cannot do its
    work, empty if it can; `gauges` are functions that return numbers as they are now, and `in_hand` returns
    the tiles that are worked on.
    """

    def __init__(
        self, in_hand: Callable[[], Collection[int]] = tuple, now: Callable[[], float] = time.monotonic
    ) -> None:
        counted = ("tiles_in", "points_in", "tiles_out", "points_out", "tiles_failed")
        self.counts: Counter[str] = Counter(dict.fromkeys(counted, 0))
        self.problem = ""
        self.gauges: list[Callable[[], Mapping[str, float]]] = []
        self._in_hand, self._now = in_hand, now
        self._seconds = self._last_seconds = 0.0
        self._heard: float | None = None
        #: Level → when it was reached last, and why.
        self._trouble: dict[int, tuple[float, str]] = {}

    def heard(self) -> None:
        """Note that something came in."""
        self._heard = self._now()

    def taken(self) -> None:
        """Note that the node works on a tile."""
        self.counts["tiles_in"] += 1
        self.heard()

    def ended(self, n_points: int, seconds: float) -> None:
        """Note that the work on a tile is over."""
        self.counts["points_in"] += n_points
        self._seconds += seconds
        self._last_seconds = seconds

    def passed_on(self, n_points: int) -> None:
        """Note that the results of a tile were published."""
        self.counts.update(tiles_out=1, points_out=n_points)

    def warned(self, text: str) -> None:
        """Note what was wrong with a tile but did not keep it."""
        self._trouble[WARN] = (self._now(), text)

    def failed(self, text: str) -> None:
        """Note that a tile could not be handled."""
        self.counts["tiles_failed"] += 1
        self._trouble[ERROR] = (self._now(), text)

    def count_buildings(self, statuses: Iterable[str]) -> None:
        """Count buildings by their status."""
        self.counts.update(f"buildings_{status}" for status in statuses)

    def state(self) -> tuple[int, str, dict[str, float]]:
        """Return how the node is: level, a few words, and numbers by name."""
        in_hand, now = self._in_hand(), self._now()
        values: dict[str, float] = {
            **self.counts,
            "tiles_in_hand": len(in_hand),
            "seconds_last_tile": self._last_seconds,
            "seconds": self._seconds,
        }
        if self._heard is not None:
            values["input_age"] = now - self._heard
        for gauges in self.gauges:
            with suppress(RuntimeError):  # of a mapping to which another thread has just added something
                values.update(gauges())
        if self.problem:
            return ERROR, self.problem, values
        for level, (since, text) in sorted(self._trouble.items(), reverse=True):
            if now - since < _RECENT:
                return level, text, values
        silence = values.get("silence", 0.0)
        if values.get("tiles_in_flight") and silence > _STALE:
            return WARN, f"no news of the tiles in flight for {silence:.0f} s", values
        return OK, f"working on tile {min(in_hand)}" if in_hand else "idle", values


class Diagnostics:
    """Publishes a node's diagnostics: what became of each tile, and once a second the `summary`."""

    def __init__(self, node: Node, summary: NodeSummary, parameters: Callable[[], Mapping[str, Any]]) -> None:
        self._node, self._summary, self._parameters = node, summary, parameters
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, EVENT)
        node.create_timer(_PERIOD, self.publish_summary)

    def end_tile(self, report: TileReport, error: str = "") -> None:
        """Say what became of a tile."""
        seconds = time.perf_counter() - report.started
        self._summary.ended(report.n_points, seconds)
        level, text = OK, "done"
        if report.warnings:
            level, text = WARN, "; ".join(report.warnings)
            self._summary.warned(text)
        if error:
            level, text = ERROR, error
            self._summary.failed(f"tile {report.stamp}: {error}")
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
        level, text, numbers = self._summary.state()
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
