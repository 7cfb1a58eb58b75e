"""Node `scan_assembler`."""

from __future__ import annotations

import time
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import NavSatFix, PointCloud2
from std_srvs.srv import Trigger

from lidar_buildings.io.tiling.live_feed import LiveFeed
from lidar_buildings.io.tiling.live_files import Recorded
from lidar_buildings.nodes.configs import ScanAssemblerConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.nodes.table import NODE_TABLE
from lidar_buildings.nodes.tile_sender import TileSender
from lidar_buildings.ros.middleware import SOCKET_BUFFER, allowed_buffer
from lidar_buildings.ros.node_state import TOPIC as NODE_STATE
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD, LATCHED_HISTORY, POSE, SENSOR
from lidar_buildings.ros.stamps import FRAME_ID

#: A warning of lost scans is repeated no sooner, and after so long it is told that none has come [s].
_REMIND = _PATIENCE = 10.0
#: Type of the messages that scanners publish.
_CLOUD = "sensor_msgs/msg/PointCloud2"


class ScanAssembler(TileSender):
    """Makes tiles of the scans of a moving sensor, and sends them into the graph."""

    carries_scans = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("scan_assembler", ScanAssemblerConfig, **kwargs)
        config = self.parameters[ScanAssemblerConfig]
        with self.starting():
            self.tiles: LiveFeed = LiveFeed(config, config, config.given_frame())
        self._n_flushed = self._last_flush = self._n_lost = 0
        self.told_at = 0.0  # time of the last `survey_done` [s]
        self._told: set[str] = set()
        self._has_looked = self._has_frame = False
        self.summary.gauges.append(lambda: {**self.tiles.counts(), "scans_lost": self._n_lost})
        self._road_points = self.create_publisher(PointCloud2, "road_points", CLOUD)
        self._newer_points = self.create_publisher(PointCloud2, "newer_points", CLOUD)
        self.begin()
        self.create_service(Trigger, "~/flush", self.on_flush)
        self.create_service(Trigger, "~/reset", self.on_reset)
        FrameListener(self, self.tiles.add_frame, n_own=1)
        self._subscribe_sensors()

    def on_tick(self) -> None:
        """Tell where the map lies and what is wrong, send what is due, and say when a flush is done."""
        self.summary.problem = self.tiles.obstacle  # as long as nothing can be written
        for problem in [*self.tiles.problems, self.tiles.obstacle]:
            if problem and problem not in self._told:
                self._told.add(problem)
                self.get_logger().error(problem)
                self.summary.warned(problem)
        if not self._has_looked and self._time > _PATIENCE:
            self._has_looked = True
            if not any(self.tiles.counts().values()):  # by a topic or a bag
                self.warn(f"so far {missing_scans(self)}")
        if not self._has_frame and self.tiles.frame is not None:
            self._has_frame = True
            self._tell_place(self.tiles.recorded)
            self.publish_frame(self.tiles.frame)
        for place in self.tiles.take_places():
            self._road_points.publish(to_message(place))
        for points in self.tiles.take_newer():
            self._newer_points.publish(to_message(points))
        super().on_tick()
        n_flushed = self.tiles.n_flushed
        if self._n_flushed < n_flushed and self.is_empty:
            self.told_at, self._n_flushed = time.monotonic(), n_flushed
            if self.tiles.thinned:
                self.get_logger().info(self.tiles.thinned)
            self.tell_survey_done()

    @property
    def is_finished(self) -> bool:
        """Whether `survey_done` has followed what `finish` wanted."""
        return 0 < self._last_flush <= self._n_flushed

    def on_end(self, stamp: int, *, is_done: bool = True) -> None:
        """Let a tile come again, with more points."""
        self.tiles.finish(stamp, is_done=is_done)

    def on_scan(self, message: PointCloud2) -> None:
        """Take a scan."""
        self.summary.heard()
        self.tiles.add_scan(message)

    def on_lost(self, status: Any) -> None:
        """Say how many scans were lost on their way here, and what may be done about it."""
        self._n_lost = status.total_count
        advice = "have the driver publish reliably"
        if allowed_buffer() < SOCKET_BUFFER:
            advice = f"allow larger buffers (sysctl -w net.core.rmem_max={SOCKET_BUFFER}), or {advice}"
        text = f"{self._n_lost} scans were lost in transit: {advice}"
        self.get_logger().warning(text, throttle_duration_sec=_REMIND)
        self.summary.warned(text)

    def on_flush(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send all tiles that have new points."""
        self.tiles.flush()
        response.success, response.message = True, "survey_done follows the last tile"
        return response

    def finish(self) -> None:
        """Send all tiles that have new points, also if sending was paused."""
        self._is_paused, self._steps = False, 0
        self._last_flush = self.tiles.flush()

    def on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget all points and tiles."""
        self.tiles.reset()
        self.forget_tiles()
        response.success, response.message = True, "all points and tiles are deleted"
        return response

    def destroy_node(self) -> None:
        """Write what has come, and stop."""
        if hasattr(self, "tiles"):
            self.tiles.stop()
        super().destroy_node()

    def _subscribe_sensors(self) -> None:
        """Listen to scans and poses, with the quality of service that parameters say."""
        options = {"qos_overriding_options": QoSOverridingOptions.with_default_policies()}
        feed = self.tiles
        self.create_subscription(Odometry, "odometry", feed.add_odometry, POSE, **options)
        self.create_subscription(NavSatFix, "fix", feed.add_fix, POSE, **options)
        if find_spec("tf2_msgs") is not None:
            kind = import_module("tf2_msgs.msg").TFMessage
            for topic, is_static, profile in (("/tf_static", True, LATCHED_HISTORY), ("/tf", False, POSE)):
                self.create_subscription(
                    kind, topic, partial(feed.add_transforms, is_static=is_static), profile
                )
        else:
            self.get_logger().info("tf2_msgs is not installed: poses come by odometry only")
        losses = SubscriptionEventCallbacks(message_lost=self.on_lost)
        self.create_subscription(PointCloud2, "scan", self.on_scan, SENSOR, event_callbacks=losses, **options)

    def _tell_place(self, recorded: Recorded | None) -> None:
        """Say where satellites lay the map, and where the poses' frame lies in that of our topics."""
        if recorded is None:
            return
        if recorded.given.said:
            self.get_logger().info(recorded.given.said)
        if where := recorded.where_target_lies(FRAME_ID):
            tell = self.warn if recorded.target == FRAME_ID else self.get_logger().info
            tell(where)


def missing_scans(node: Node) -> str:
    """Say where no scan has come, what is published there instead, and on which other topics clouds are."""
    scan = node.resolve_topic_name("scan")
    published = {
        name: kinds for name, kinds in node.get_topic_names_and_types() if node.count_publishers(name)
    }
    graphs = [name.removesuffix(NODE_STATE) for name in published if name.endswith(f"/{NODE_STATE}")]
    own = {f"{one}{topic.name}" for one in graphs for card in NODE_TABLE for topic in card.publishes}
    others = [kind for kind in published.pop(scan, ()) if kind != _CLOUD]
    clouds = sorted(name for name, kinds in published.items() if _CLOUD in kinds and name not in own)
    instead = f", which is published as {', '.join(others)}" if others else ""
    hint = f"; clouds are published on {', '.join(clouds)}: --scan TOPIC" if clouds else ""
    return f"no scan has arrived on {scan}{instead}{hint}"
