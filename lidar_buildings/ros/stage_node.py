"""What every node does alike: parameters, diagnostics, and one bad tile that does not end the node."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from geometry_msgs.msg import PolygonInstanceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.diagnostics import Diagnostics, TileReport
from lidar_buildings.ros.errands import Errands, Turns
from lidar_buildings.ros.hand_over import Inbox, Outlet
from lidar_buildings.ros.parameters import NodeParameters
from lidar_buildings.ros.point_cloud import from_message, to_message
from lidar_buildings.ros.polygons import Rings, ring_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD, SILENT_PUBLISHER, SILENT_SUBSCRIPTION
from lidar_buildings.ros.receipts import DONE, FAILED, READY, TAKEN, ReceiptSender
from lidar_buildings.ros.ring_collector import RingCollector
from lidar_buildings.ros.stamps import to_stamp
from lidar_buildings.ros.tile_info import TileInfos

#: Free memory goes back to the system so often [s]: `ros.middleware` has malloc keep it.
_MEMORY_PERIOD = 10.0


class StageNode(Node):
    """
    Base of all nodes; `configs`, stage name → config class, are the node's parameters.

    ``parameters[GroundFilterConfig]`` is that stage's config as it is now. `outcome` is done when the node
    has nothing more to do, or cannot go on; `exit_status` is what its process ends with. `summary` is how it
    gets on, as `diagnostics` tells once a second. ParameterError if a start value or a parameter's name is
    wrong.
    """

    def __init__(self, name: str, configs: Mapping[str, type[StageConfig]], **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.outcome: Future = Future()
        self.exit_status = 0
        self._inboxes: list[Inbox] = []
        self.errands = Errands(self)
        with self.starting():
            self.parameters = NodeParameters(self, configs)
        self._diagnostics = Diagnostics(self, self.parameters.as_dict)
        self.summary = self._diagnostics.summary
        shares = ReplicaConfig.stage in configs
        self._share = self.parameters[ReplicaConfig] if shares else ReplicaConfig()
        self._receipts = ReceiptSender(self, name, self._share)
        self.tile_infos: TileInfos | None = None
        self.create_timer(_MEMORY_PERIOD, lambda: give_memory_back(_MEMORY_PERIOD))

    @contextmanager
    def starting(self) -> Iterator[None]:
        """Leave nothing of the node if it cannot start."""
        try:
            yield
        except Exception:
            self.destroy_node()
            raise

    def create_publisher(self, *args: Any, **kwargs: Any) -> Publisher:
        """Create a publisher; of profiles that do not match the subscriber's node tells."""
        return super().create_publisher(*args, **{"event_callbacks": SILENT_PUBLISHER, **kwargs})

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Subscription:
        """Subscribe; a message on which the callback fails is left out, and the node goes on."""
        in_turn = self._in_turn(callback)

        @functools.wraps(callback)  # rclpy looks whether it takes the message's times, too
        def guarded(*received: Any) -> None:
            try:
                in_turn(*received)
            except Exception as error:
                if not self.context.ok():
                    raise
                text = f"{topic}: {_reason(error)}: the message is left out"
                self.get_logger().error(text)
                self.summary.warned(text)

        return super().create_subscription(kind, topic, guarded, *args, **kwargs)

    def create_timer(self, period: float, callback: Callable[..., None], *args: Any, **kwargs: Any) -> Timer:
        """Create a timer, which goes on when the clock of a recording (`use_sim_time`) stands still."""
        named = {"clock": Clock(clock_type=ClockType.STEADY_TIME), **kwargs}
        return super().create_timer(period, self._in_turn(callback), *args, **named)

    def create_service(
        self, kind: Any, name: str, callback: Callable[..., Any], *args: Any, **kwargs: Any
    ) -> Service:
        """Offer a service."""
        return super().create_service(kind, name, self._in_turn(callback), *args, **kwargs)

    def takes(self, stamp: int) -> bool:
        """Whether a tile is this node's, where nodes of one kind share them [ns]."""
        return self._share.takes(stamp)

    def announce(self) -> None:
        """Say that the node is there; called when it begins to spin."""
        self._receipts.send(READY)

    def subscribe_tiles(
        self,
        topic: str,
        work: Callable[[PointTile], Turns | Mapping[str, int] | None],
        *,
        is_part: bool = False,
    ) -> None:
        """
        Have `work` called with every tile of a topic; what it raises ends that tile alone.

        Where that is only a part of what the node waits for, `work` tells itself when it is `reporting`. The
        tile has its limits and spacing if the source tells them. What `work` returns, if anything, are
        counts for `diagnostics`; what yields lets the next tile begin before it has come to its end.
        """
        infos = self.tile_infos = self.tile_infos or TileInfos(self)

        def on_message(message: PointCloud2) -> None:
            stamp = to_stamp(message.header.stamp)
            if self.takes(stamp) and not inbox.has_had(stamp):
                is_ours = any(one.name == "index" for one in message.fields)
                work_on = turns(stamp, lambda report: read(message, report))
                infos.when_known(stamp, lambda: self.errands.begin(work_on), is_promised=is_ours)

        def on_tile(stamp: int, tile: PointTile) -> None:
            if not infos.is_over(stamp):
                self.errands.begin(turns(stamp, lambda _: tile))

        def read(message: PointCloud2, report: TileReport) -> PointTile:
            reading = from_message(message)
            if reading.n_dropped:
                report.warnings.append(
                    f"{reading.n_dropped} points of {topic} were left out: x, y or z is not finite"
                )
            return infos.complete(reading.tile)

        def turns(stamp: int, get: Callable[[TileReport], PointTile]) -> Turns:
            with self.reporting(stamp, quiet=is_part) as report:
                tile = get(report)
                report.n_points = len(tile)
                counts = work(tile)
                if isinstance(counts, Generator):
                    counts = yield from counts
                report.counts.update(counts or {})

        inbox = self._inbox(self.create_subscription(PointCloud2, topic, on_message, CLOUD), on_tile)

    def subscribe_rings(
        self, topic: str, work: Callable[[int, Rings], None], *, is_part: bool = False
    ) -> None:
        """
        Have `work` called with the stamp and all rings of every tile that a topic closes.

        They may be a part, as tiles of `subscribe_tiles`. Where a node takes tiles as well, rings of a tile
        that is over are dropped as its points are.
        """
        collector = RingCollector()

        def on_message(message: PolygonInstanceStamped) -> None:
            stamp = to_stamp(message.header.stamp)
            if not self.takes(stamp):
                return
            with self.reporting(stamp, quiet=True):
                closed = collector.add(message)
            if closed is not None and not inbox.has_had(stamp):
                on_rings(stamp, closed)

        def on_rings(stamp: int, rings: Rings) -> None:
            if self.tile_infos is not None and self.tile_infos.is_over(stamp):
                return
            with self.reporting(stamp, quiet=is_part):
                work(stamp, rings)

        subscription = self.create_subscription(PolygonInstanceStamped, topic, on_message, BUILDING)
        inbox = self._inbox(subscription, on_rings)

    def subscribe_messages(self, kind: Any, topic: str, work: Callable[[Any], None], qos: QoSProfile) -> None:
        """Have `work` called with every message of a topic for which others have an outlet."""

        def on_messages(_: int, messages: Iterable[Any]) -> None:
            for message in messages:
                subscription.callback(message)

        subscription = self.create_subscription(kind, topic, work, qos, event_callbacks=SILENT_SUBSCRIPTION)
        self._inbox(subscription, on_messages)

    def create_tile_outlet(self, topic: str) -> Outlet:
        """Return what hands tiles on under a topic."""
        publisher = self.create_publisher(PointCloud2, topic, CLOUD)
        return Outlet(
            self,
            publisher,
            lambda _, tile: [to_message(tile)],
            lambda stamp, tile: self.summary.handed_on(stamp, len(tile)),
        )

    def create_ring_outlet(self, topic: str) -> Outlet:
        """Return what hands the rings of tiles on under a topic."""
        publisher = self.create_publisher(PolygonInstanceStamped, topic, BUILDING)
        return Outlet(self, publisher, ring_messages, lambda stamp, _: self.summary.handed_on(stamp, 0))

    def create_message_outlet(self, kind: Any, topic: str, qos: QoSProfile) -> Outlet:
        """Return what hands messages on under a topic."""
        return Outlet(self, self.create_publisher(kind, topic, qos))

    def destroy_node(self) -> None:
        """Let nothing more be handed to the node."""
        self.errands.stop()
        for inbox in self._inboxes:
            inbox.close()
        self._inboxes.clear()
        super().destroy_node()

    def _inbox(self, subscription: Subscription, take: Callable[[int, Any], None]) -> Inbox:
        self._inboxes.append(Inbox(self, self.errands, subscription, take, self.takes))
        return self._inboxes[-1]

    def _in_turn(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that the executor calls while no errand of the node is being done."""

        @functools.wraps(callback)
        def called(*received: Any) -> Any:
            with self.errands.turn:
                return callback(*received)

        return called

    @contextmanager
    def reporting(self, stamp: int, *, quiet: bool = False) -> Iterator[TileReport]:
        """
        Have a tile in hand, and publish what became of it; an exception is reported and goes no further.

        Nothing but an exception is reported if `quiet`.
        """
        report = TileReport(stamp)
        if not quiet:
            self._receipts.send(TAKEN, stamp)
            self._diagnostics.begin_tile(stamp)
        started = time.perf_counter()
        failure = ""
        try:
            yield report
        except Exception as error:
            if not self.context.ok():
                raise
            failure = _reason(error)
            self.get_logger().error(f"tile {stamp}: {failure}: the tile is not handed on")
        if report.warnings:
            self.get_logger().warning(f"tile {stamp}: {'; '.join(report.warnings)}")
        if failure or not quiet:
            self._diagnostics.end_tile(report, failure, time.perf_counter() - started)
            self._receipts.send(FAILED if failure else DONE, stamp)

    def warn(self, text: str) -> None:
        """Say in the log and in `diagnostics` what is wrong beside any tile."""
        self.get_logger().warning(text)
        self.summary.warned(text)
        self._diagnostics.publish_summary()

    def fail(self, error: Exception) -> None:
        """End the node: it cannot go on."""
        self.summary.problem = _reason(error)
        self._diagnostics.publish_summary()
        if not self.outcome.done():
            self.outcome.set_exception(error)


def _reason(error: Exception) -> str:
    """Say in one line what went wrong."""
    words = " ".join(str(error).split())
    return words if isinstance(error, LidarBuildingsError) else f"{type(error).__name__}: {words}"
