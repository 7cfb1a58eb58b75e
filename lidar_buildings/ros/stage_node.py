"""What every node does alike: parameters, diagnostics, state, and one bad tile that does not end the node."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future as Work
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, ClassVar
from uuid import uuid4

from geometry_msgs.msg import PolygonInstanceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.bounds import BEYOND_TILE
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.diagnostics import Diagnostics, NodeSummary, TileReport
from lidar_buildings.ros.node_state import FAILED, IN_HAND, PASSED_ON, PERIOD, WAITING, NodeState, TileState
from lidar_buildings.ros.node_state import TOPIC as NODE_STATE
from lidar_buildings.ros.parameters import NodeParameters
from lidar_buildings.ros.point_cloud import from_message
from lidar_buildings.ros.polygons import RingCollector, Rings
from lidar_buildings.ros.qos import BUILDING, CLOUD, LATCHED, SILENT_PUBLISHER, SILENT_SUBSCRIPTION
from lidar_buildings.ros.stamps import to_stamp
from lidar_buildings.ros.tile_info import TOPIC as TILE_INFO
from lidar_buildings.ros.tile_info import TileInfos
from lidar_buildings.ros.tile_table import Parts, TileEntry, TileTable

#: Free memory goes back to the system so often [s]: `ros.middleware` has malloc keep it.
_MEMORY_PERIOD = 10.0


class StageNode(Node):
    """
    Base of all nodes; `configs`, stage name → config class, are the node's parameters.

    ``parameters[GroundFilterConfig]`` is that stage's config as it is now. `outcome` is done when the node
    has nothing more to do, or cannot go on; `exit_status` is what its process ends with. `summary` is how it
    gets on, as `diagnostics` says once a second. What takes long is done in the processes of `pool`, or in a
    thread of the node, so that its executor is free for messages and timers. ParameterError if a start value
    or a parameter's name is wrong.
    """

    #: Whether scans come to the node, of which none comes again.
    carries_scans: ClassVar[bool] = False
    #: Whether tiles go through the node, and how many it has reported as done.
    is_stage, n_reported = False, 0

    def __init__(
        self, name: str, configs: Mapping[str, type[StageConfig]], pool: Any = None, **kwargs: Any
    ) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **kwargs)
        self.outcome: Future = Future()
        self.exit_status = 0
        self.pool = pool
        self._is_destroyed = False
        self._worker = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._later: deque[Callable[[], object]] = deque()
        self._woken = self.create_guard_condition(self._do_later)
        with self.starting():
            self.parameters = NodeParameters(self, configs)
        self.table = TileTable()
        self.summary = NodeSummary(lambda: self.table.in_hand)
        self._diagnostics = Diagnostics(self, self.summary, self.parameters.as_dict)
        self._kind, self.life, self._sequence = name, uuid4().hex, 0
        self._share = self.parameters[ReplicaConfig] if ReplicaConfig.stage in configs else ReplicaConfig()
        self._outputs: list[Publisher] = []
        self._state = self.create_publisher(String, NODE_STATE, LATCHED)
        self.create_timer(PERIOD, self.publish_state)
        self.create_timer(_MEMORY_PERIOD, lambda: give_memory_back(_MEMORY_PERIOD))

    @contextmanager
    def starting(self) -> Iterator[None]:
        """Leave nothing of the node if it cannot start."""
        try:
            yield
        except Exception:
            self.destroy_node()
            raise

    # rclpy, with errors that end nothing

    def create_publisher(self, *args: Any, **kwargs: Any) -> Publisher:
        """Create a publisher; a subscriber whose profile does not match is warned by its own node."""
        return super().create_publisher(*args, **{"event_callbacks": SILENT_PUBLISHER, **kwargs})

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Subscription:
        """Subscribe; a message on which the callback fails is left out, and the node goes on."""

        @functools.wraps(callback)  # rclpy looks whether it takes the message's times, too
        def guarded(*received: Any) -> None:
            try:
                callback(*received)
            except Exception as error:
                if not self.context.ok():
                    raise
                text = f"{topic}: {reason_of(error)}: ignoring the message"
                self.get_logger().error(text)
                self.summary.warned(text)

        return super().create_subscription(kind, topic, guarded, *args, **kwargs)

    def create_timer(self, period: float, callback: Callable[..., None], *args: Any, **kwargs: Any) -> Timer:
        """Create a timer, which goes on when the clock of a recording (`use_sim_time`) stands still."""
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        return super().create_timer(period, callback, *args, **{"clock": clock, **kwargs})

    def create_output(self, kind: Any, topic: str, qos: QoSProfile) -> Publisher:
        """Create a publisher of what other nodes wait for; the state says who listens to it."""
        self._outputs.append(self.create_publisher(kind, topic, qos))
        return self._outputs[-1]

    # work beside the executor

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Work[Any]:
        """Call a function, as for a whole tile, in the pool's processes, or in the node's thread."""
        return (self._worker if self.pool is None else self.pool).submit(function, *arguments)

    def submit_shared(self, function: Callable[..., Any], *arguments: Any) -> Work[Any]:
        """Call a function in the node's thread that shares a tile's buildings over the `pool`."""
        return self._worker.submit(function, *arguments, pool=self.pool)

    def submit_here(self, function: Callable[..., Any], *arguments: Any) -> Work[Any]:
        """Call a function in the node's thread."""
        return self._worker.submit(function, *arguments)

    def when_done(self, work: Work[Any], callback: Callable[[Work[Any]], object]) -> None:
        """Have a function called in the executor's thread when some work is done."""
        work.add_done_callback(lambda done: self.call_soon(lambda: callback(done)))

    def call_soon(self, callback: Callable[[], object]) -> None:
        """Have a function called in the executor's thread; from any thread."""
        self._later.append(callback)
        if self.context.ok() and not self._is_destroyed:
            self._woken.trigger()

    def _do_later(self) -> None:
        for _ in range(len(self._later)):
            self._later.popleft()()

    @property
    def is_at_work(self) -> bool:
        """Whether some work has begun that cannot be interrupted."""
        return bool(self.table.in_hand)

    # tiles

    def take_tiles(
        self,
        topics: Sequence[str],
        work: Callable[..., Work[Any]],
        publish: Callable[[int, Any], Mapping[str, int] | None],
        fits: Callable[[Parts], bool] = lambda parts: True,
        clipped: Callable[[Any], Sides] = lambda result: NONE,
    ) -> None:
        """
        Have `work` called with a tile's parts of these topics, and `publish` with the stamp and its result.

        Each topic has still to be subscribed to. What either raises ends that tile alone; `publish` returns
        counts for `diagnostics`. A result that reaches beyond the sides that `clipped` returns is held back
        until the source has sent a larger revision, or says that there is no more.
        """
        self._topics, self._fits, self._clipped = tuple(topics), fits, clipped
        self._work_on, self._publish_result = work, publish
        self.is_stage = True
        self._infos = TileInfos(self, self.look_again)
        self.create_timer(1.0, self.look_again)

    def subscribe_tiles(self, topic: str) -> None:
        """Take the points of tiles, with their limits and spacing if the source says them."""

        def read(message: PointCloud2) -> PointTile:
            tile, n_dropped, n_beyond = from_message(message)
            if (entry := self.table.entry(tile.stamp)) is not None:
                for number, why in ((n_dropped, "x, y or z is not finite"), (n_beyond, BEYOND_TILE)):
                    if number:
                        entry.warnings.append(f"{number} points of {topic} were left out: {why}")
            return tile

        self.subscribe_parts(PointCloud2, topic, CLOUD, read)

    def subscribe_rings(self, topic: str, read: Callable[[Rings], Any]) -> None:
        """Take what `read` makes of all rings of each tile that a topic closes."""
        collector = RingCollector()

        def gather(message: PolygonInstanceStamped) -> Any:
            rings = collector.add(message)
            return None if rings is None else read(rings)

        self.subscribe_parts(PolygonInstanceStamped, topic, BUILDING, gather)

    def subscribe_parts(
        self, kind: Any, topic: str, qos: QoSProfile, read: Callable[[Any], Any | None]
    ) -> None:
        """Take what `read` makes of a topic's messages, which have a header; None if nothing yet."""

        def on_message(message: Any) -> None:
            stamp = to_stamp(message.header.stamp)
            if self.drops(stamp, topic):
                return
            try:
                part = read(message)
            except Exception as error:
                self._fail_tile(TileReport(stamp), error)
                return
            if part is not None:
                self.add_part(stamp, topic, part)

        self.create_subscription(kind, topic, on_message, qos, event_callbacks=SILENT_SUBSCRIPTION)

    def drops(self, stamp: int, topic: str) -> bool:
        """Whether a part of a tile is dropped: the tile is a replica's, in hand, or over for the source."""
        return not self._share.takes(stamp) or stamp in self.table.in_hand or self._infos.is_over(stamp)

    def is_ready(self) -> str:
        """Return what the node waits for beside a tile's parts, empty if nothing."""
        return ""

    def add_part(self, stamp: int, topic: str, part: Any) -> None:
        """Take a part of a tile, and begin to work on the tile if it is complete."""
        if not self.drops(stamp, topic) and (entry := self.table.entry(stamp)) is not None:
            entry.parts[topic] = part
            self._look_at(entry)

    def look_again(self) -> None:
        """Begin with the tiles that have become complete, pass on those held back, and drop what is over."""
        over = [one for one in self.table if self._infos.is_over(one.stamp) and self.table.drop(one)]
        if over:
            self.publish_state()
        for entry in self.table:
            self._look_at(entry)

    def _look_at(self, entry: TileEntry) -> None:
        """Begin with a tile that is complete, pass on one that comes no larger, or say what is missing."""
        missing = self._missing(entry) if entry.parts else set()
        if entry.parts and not missing:
            self._begin_tile(entry)
        elif entry.held is not None and not self._infos.can_grow(entry.stamp, self._clipped(entry.held)):
            self._publish_tile(entry, entry.held)
        elif missing:
            self._set_state(entry, WAITING, missing)

    def _missing(self, entry: TileEntry) -> set[str]:
        """Return what a tile waits for: parts, all of them if they do not fit, or what is said of it."""
        if missing := {*self._topics} - entry.parts.keys():
            return missing
        if not self._fits(entry.parts):
            return {*self._topics}
        clouds = [one for one in entry.parts.values() if isinstance(one, PointTile)]
        is_promised = any(one.index is not None for one in clouds)
        if clouds and not self._infos.is_known(entry.stamp, is_promised=is_promised):
            missing.add(TILE_INFO)
        return missing | ({self.is_ready()} - {""})

    def _begin_tile(self, entry: TileEntry) -> None:
        report = TileReport(entry.stamp, warnings=entry.warnings)
        parts, entry.parts, entry.warnings, entry.held = entry.parts, {}, [], None
        self._set_state(entry, IN_HAND)
        self.summary.taken()
        try:
            for topic, part in parts.items():
                if isinstance(part, PointTile):
                    parts[topic] = self._infos.complete(part)
                    report.n_points = report.n_points or len(part)
            work = self._work_on(*(parts[topic] for topic in self._topics))
        except Exception as error:
            work = Work()
            work.set_exception(error)
        self.when_done(work, lambda done: self._finish_tile(entry, report, done))

    def _finish_tile(self, entry: TileEntry, report: TileReport, work: Work[Any]) -> None:
        """Publish a tile's results, or hold them back."""
        if work.cancelled():
            return
        if (error := work.exception()) is not None:
            self._fail_tile(report, error)
            return
        sides = self._clipped(work.result())
        if sides and self._infos.can_grow(entry.stamp, sides):
            entry.held = work.result()
            self._end_tile(report)
            self._set_state(entry, WAITING, (name for name, is_it in sides._asdict().items() if is_it))
        else:
            self._publish_tile(entry, work.result(), report)

    def _publish_tile(self, entry: TileEntry, result: Any, report: TileReport | None = None) -> None:
        """Publish a tile's results; there is no report of one that was held back, and has ended."""
        entry.held = None
        try:
            counts = self._publish_result(entry.stamp, result) or {}
        except Exception as error:
            self._fail_tile(report or TileReport(entry.stamp), error)
            return
        if report is not None:
            report.counts.update(counts)
            self._end_tile(report)
        self._set_state(entry, PASSED_ON)

    def _end_tile(self, report: TileReport) -> None:
        if report.warnings:
            self.get_logger().warning(f"tile {report.stamp}: {'; '.join(report.warnings)}")
        self._diagnostics.end_tile(report)

    def _fail_tile(self, report: TileReport, error: BaseException) -> None:
        """Say that the node cannot handle a tile."""
        if not self.context.ok():
            return
        failure = reason_of(error)
        self.get_logger().error(f"tile {report.stamp}: {failure}: the tile is not passed on")
        self._diagnostics.end_tile(report, failure)
        if (entry := self.table.entry(report.stamp)) is not None:
            entry.parts, entry.held = {}, None
            self._set_state(entry, FAILED, reason=failure)

    # state

    def _set_state(
        self, entry: TileEntry, status: str, missing: Iterable[str] = (), reason: str = ""
    ) -> None:
        """Say what the node has of a tile, which parts or sides of it are missing, or why it failed."""
        if self.table.set(entry, TileState(status, tuple(sorted(missing)), reason)):
            self.publish_state()

    def publish_state(self) -> None:
        """Say that the node is there, and what it has of each tile."""
        self._sequence += 1
        state = NodeState(
            self.get_name(),
            self.life,
            self._sequence,
            {one.stamp: one.state for one in self.table},
            self.is_stage,
            self._kind,
            self._share.replica,
            self._share.replicas,
            self.n_reported,
            {one.topic_name: one.get_subscription_count() for one in self._outputs},
        )
        self._state.publish(state.message())

    # life

    def interrupted(self, spin_once: Callable[[float], None]) -> None:
        """Do what a node has still to do when its process is interrupted; most have nothing."""

    def warn(self, text: str) -> None:
        """Say in the log and in `diagnostics` what is wrong beside any tile."""
        self.get_logger().warning(text)
        self.summary.warned(text)
        self._diagnostics.publish_summary()

    def fail(self, error: BaseException) -> None:
        """End the node: it cannot go on."""
        self.summary.problem = reason_of(error)
        self._diagnostics.publish_summary()
        if not self.outcome.done():
            self.outcome.set_exception(error)

    def destroy_node(self) -> None:
        """Begin no more work."""
        self._is_destroyed = True
        self._worker.shutdown(wait=False, cancel_futures=True)
        super().destroy_node()


def publish_all(publisher: Publisher, messages: Iterable[Any]) -> None:
    """Publish messages one after the other."""
    for message in messages:
        publisher.publish(message)


def reason_of(error: BaseException) -> str:
    """Say in one line what went wrong."""
    words = " ".join(str(error).split())
    return words if isinstance(error, LidarBuildingsError) else f"{type(error).__name__}: {words}"
