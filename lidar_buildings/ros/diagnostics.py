"""What nodes say on `diagnostics`: a status for every tile, and once a second how the node gets on."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header

from lidar_buildings.ros.node_summary import NodeSummary
from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.stamps import header_of

TOPIC = "diagnostics"
#: Behind the node's name in the name of the status that sums a node up.
SUMMARY = ": summary"
#: Period of the summaries, as that of diagnostic_updater [s].
_PERIOD = 1.0
_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


@dataclass
class TileReport:
    """A node's report of a tile in `diagnostics`."""

    stamp: int  #: the tile's key [ns]
    n_points: int = 0  #: points that came in
    warnings: list[str] = field(default_factory=list)  #: what was wrong but did not keep the tile
    counts: dict[str, int] = field(default_factory=dict)  #: what the node counted beside points, by name


class Diagnostics:
    """Publishes a node's diagnostics; `summary` is what the node counts over all tiles."""

    def __init__(self, node: Node, parameters: Callable[[], Mapping[str, Any]]) -> None:
        self.summary = NodeSummary()
        self._node = node
        self._parameters = parameters
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, EVENT)
        self._due = 0.0
        node.create_timer(_PERIOD, self.publish_summary)

    def begin_tile(self, stamp: int) -> None:
        """Note that a tile is taken; a node that works for long cannot say so later."""
        self.summary.taken(stamp)
        if time.monotonic() >= self._due:
            self.publish_summary()

    def end_tile(self, report: TileReport, error: str, seconds: float) -> None:
        """Say what became of a tile."""
        self.summary.ended(report.stamp, report.n_points, seconds)
        level, text = DiagnosticStatus.OK, "done"
        if report.warnings:
            level, text = DiagnosticStatus.WARN, "; ".join(report.warnings)
            self.summary.warned(text)
        if error:
            level, text = DiagnosticStatus.ERROR, error
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
        self._due = time.monotonic() + _PERIOD
        state = self.summary.state()
        values = {name: f"{value:.3f}".rstrip("0").rstrip(".") for name, value in state.values.items()}
        header = Header(stamp=self._node.get_clock().now().to_msg())
        self._publish(header, _LEVELS[state.level], SUMMARY, state.message, values)

    def _publish(self, header: Header, level: bytes, suffix: str, text: str, values: dict[str, str]) -> None:
        status = DiagnosticStatus(
            level=level,
            name=f"{self._node.get_name()}{suffix}",
            message=text,
            hardware_id=self._node.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        self._publisher.publish(DiagnosticArray(header=header, status=[status]))
