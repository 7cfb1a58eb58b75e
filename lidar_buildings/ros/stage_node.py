"""What every node does alike: parameters, diagnostics, and one bad tile that does not end the node."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PolygonInstanceStamped
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.hand_over import Inbox, RingOutlet, TileOutlet
from lidar_buildings.ros.parameters import NodeParameters
from lidar_buildings.ros.point_cloud import from_message
from lidar_buildings.ros.polygons import Rings
from lidar_buildings.ros.qos import BUILDING, CLOUD, EVENT
from lidar_buildings.ros.receipts import DONE, FAILED, READY, TAKEN, ReceiptSender
from lidar_buildings.ros.ring_collector import RingCollector
from lidar_buildings.ros.stamps import header_of, to_stamp
from lidar_buildings.ros.tile_info import TileInfos


@dataclass
class TileReport:
    """
    A node's report of a tile in `diagnostics`.

    Attributes
    ----------
    stamp : int
        The tile's key [ns].
    n_points : int
        Points that came in.
    warnings : list of str
        What was wrong but did not keep the tile.
    counts : dict
        What the node counted beside points, by name.
    """

    stamp: int
    n_points: int = 0
    warnings: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)


class StageNode(Node):
    """
    Base of all nodes.

    Parameters
    ----------
    name : str
        The node's name.
    configs : mapping
        Stage name → config class: the node's parameters.
    **kwargs
        As for `rclpy.node.Node`: namespace, parameter_overrides, context…

    Attributes
    ----------
    parameters : NodeParameters
        ``parameters[GroundFilterConfig]`` is that stage's config as it is now.
    outcome : Future
        Done when the node has nothing more to do, or cannot go on.
    exit_status : int
        What its process ends with.

    Raises
    ------
    ParameterError
        If a start value or a parameter's name is wrong.
    """

    def __init__(self, name: str, configs: Mapping[str, type[StageConfig]], **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.outcome: Future = Future()
        self.exit_status = 0
        self._inboxes: list[Inbox] = []
        try:
            self.parameters = NodeParameters(self, configs)
        except LidarBuildingsError:
            self.destroy_node()
            raise
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", EVENT)
        self._receipts = ReceiptSender(self)
        self.tile_infos: TileInfos | None = None

    def announce(self) -> None:
        """Say that the node is there; called when it begins to spin."""
        self._receipts.send(READY)

    def subscribe_tiles(self, topic: str, work: Callable[[PointTile], Mapping[str, int] | None]) -> None:
        """
        Have `work` called with every tile of a topic; what it raises ends that tile alone.

        The tile has its limits and spacing if the source tells them. What `work` returns, if anything, are
        counts for `diagnostics`.
        """
        infos = self.tile_infos = self.tile_infos or TileInfos(self)

        def on_message(message: PointCloud2) -> None:
            stamp = to_stamp(message.header.stamp)
            if not inbox.has_had(stamp):
                is_ours = any(one.name == "index" for one in message.fields)
                infos.when_known(
                    stamp, lambda: handle(stamp, lambda report: read(message, report)), is_promised=is_ours
                )

        def on_tile(stamp: int, tile: PointTile) -> None:
            if not infos.is_over(stamp):
                handle(stamp, lambda _: tile)

        def read(message: PointCloud2, report: TileReport) -> PointTile:
            reading = from_message(message)
            if reading.n_dropped:
                report.warnings.append(
                    f"{reading.n_dropped} points of {topic} were left out: x, y or z is not finite"
                )
            return infos.complete(reading.tile)

        def handle(stamp: int, get: Callable[[TileReport], PointTile]) -> None:
            with self.reporting(stamp) as report:
                tile = get(report)
                report.n_points = len(tile)
                report.counts.update(work(tile) or {})

        inbox = self._inbox(self.create_subscription(PointCloud2, topic, on_message, CLOUD), on_tile)

    def subscribe_rings(self, topic: str, work: Callable[[int, Rings], None]) -> None:
        """Have `work` called with the stamp and all rings of every tile that a topic closes."""
        collector = RingCollector()

        def on_message(message: PolygonInstanceStamped) -> None:
            with self.reporting(to_stamp(message.header.stamp), quiet=True):
                closed = collector.add(message)
            if closed is not None and not inbox.has_had(closed.stamp):
                on_rings(closed.stamp, closed.rings)

        def on_rings(stamp: int, rings: Rings) -> None:
            with self.reporting(stamp):
                work(stamp, rings)

        subscription = self.create_subscription(PolygonInstanceStamped, topic, on_message, BUILDING)
        inbox = self._inbox(subscription, on_rings)

    def create_tile_outlet(self, topic: str) -> TileOutlet:
        """Return what hands tiles on under a topic."""
        return TileOutlet(self, self.create_publisher(PointCloud2, topic, CLOUD))

    def create_ring_outlet(self, topic: str) -> RingOutlet:
        """Return what hands rings on under a topic."""
        return RingOutlet(self, self.create_publisher(PolygonInstanceStamped, topic, BUILDING))

    def destroy_node(self) -> None:
        """Let nothing more be handed to the node."""
        for inbox in self._inboxes:
            inbox.close()
        self._inboxes.clear()
        super().destroy_node()

    def _inbox(self, subscription: Subscription, take: Callable[[int, Any], None]) -> Inbox:
        self._inboxes.append(Inbox(self, subscription, take))
        return self._inboxes[-1]

    @contextmanager
    def reporting(self, stamp: int, *, quiet: bool = False) -> Iterator[TileReport]:
        """
        Have a tile in hand, and publish what became of it; an exception is reported and goes no further.

        Parameters
        ----------
        stamp : int
            The tile's key [ns].
        quiet : bool
            Whether nothing but an exception is reported.
        """
        report = TileReport(stamp)
        if not quiet:
            self._receipts.send(TAKEN, stamp)
        started = time.perf_counter()
        try:
            yield report
        except Exception as error:
            self._report_failure(report, error)
        else:
            if report.warnings:
                self.get_logger().warning(f"tile {stamp}: {'; '.join(report.warnings)}")
            if not quiet:
                level = DiagnosticStatus.WARN if report.warnings else DiagnosticStatus.OK
                text = "; ".join(report.warnings) or "done"
                self._publish_status(report, level, text, time.perf_counter() - started)
                self._receipts.send(DONE, stamp)

    def fail(self, error: Exception) -> None:
        """End the node: it cannot go on."""
        if not self.outcome.done():
            self.outcome.set_exception(error)

    def _report_failure(self, report: TileReport, error: Exception) -> None:
        """Say in one line why a tile is not handed on."""
        words = " ".join(str(error).split())
        reason = words if isinstance(error, LidarBuildingsError) else f"{type(error).__name__}: {words}"
        self.get_logger().error(f"tile {report.stamp}: {reason}: the tile is not handed on")
        self._publish_status(report, DiagnosticStatus.ERROR, reason, 0.0)
        self._receipts.send(FAILED, report.stamp)

    def _publish_status(self, report: TileReport, level: bytes, text: str, seconds: float) -> None:
        values = {
            "tile": str(report.stamp),
            "seconds": f"{seconds:.6f}",
            "points": str(report.n_points),
            **{name: str(count) for name, count in report.counts.items()},
            "parameters": json.dumps(self.parameters.as_dict()),
        }
        status = DiagnosticStatus(
            level=level,
            name=self.get_name(),
            message=text,
            hardware_id=self.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        self._diagnostics.publish(DiagnosticArray(header=header_of(report.stamp), status=[status]))
