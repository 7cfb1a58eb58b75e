"""The map frame in messages: where it lies, and the source's units."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import Point, PointStamped, Vector3, Vector3Stamped
from rclpy.timer import Timer
from std_msgs.msg import Header

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.files.reference_systems import check_place, true_frame
from lidar_buildings.ros.qos import LATCHED
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import FRAME_ID


def origin_message(frame: MapFrame) -> PointStamped:
    """Return the message for `map_origin`: `frame_id` names the reference system."""
    x, y, z = frame.origin
    return PointStamped(header=Header(frame_id=frame.crs), point=Point(x=x, y=y, z=z))


def units_message(frame: MapFrame) -> Vector3Stamped:
    """Return the message for `map_units`: metres per unit of the source's x, y and z."""
    x, y, z = (float(unit) for unit in frame.units)
    return Vector3Stamped(header=Header(frame_id=FRAME_ID), vector=Vector3(x=x, y=y, z=z))


class FrameListener:
    """
    Subscribes to `map_origin` and `map_units`; calls `on_frame` when a message has changed the frame.

    Where tiles wait for the frame and nobody publishes `map_origin`, the map frame is taken as it is after
    `patience` [s]: origin 0, no reference system. What is published later counts from then on. Who publishes
    one of the two but says nothing is waited for, with a warning. Publishers that the node has itself,
    `n_own`, tell it nothing.
    """

    def __init__(
        self,
        node: StageNode,
        on_frame: Callable[[MapFrame], None],
        patience: float = math.inf,
        n_own: int = 0,
    ) -> None:
        self._node, self._on_frame, self._patience, self._n_own = node, on_frame, patience, n_own
        self._said: dict[str, Any] = {}  # topic → what was published last
        self._timer: Timer | None = None
        self._warned: list[str] = []
        for kind, topic in ((Vector3Stamped, "map_units"), (PointStamped, "map_origin")):
            node.create_subscription(kind, topic, partial(self._hear, topic), LATCHED)

    @property
    def frame(self) -> MapFrame | None:
        """The frame, None as long as it is not known; in true metres where nothing publishes units."""
        if "map_origin" not in self._said or self._silent():
            return None
        frame = _frame(**self._said)
        return frame if self._n_own or "map_units" in self._said else true_frame(frame)

    def expect(self) -> bool:
        """Return whether the frame is known; if not, a tile waits for it from now on."""
        if self.frame is None and self._timer is None and math.isfinite(self._patience):
            self._timer = self._node.create_timer(self._patience, self._lose_patience)
        return self.frame is not None

    def _silent(self) -> list[str]:
        """Return which topics others publish, of which nothing has come."""
        unknown = [topic for topic in ("map_origin", "map_units") if topic not in self._said]
        return [topic for topic in unknown if self._node.count_publishers(topic) > self._n_own]

    def _lose_patience(self) -> None:
        """Take the frame as it is, unless somebody is there who may still tell of it."""
        if self._timer is None:
            return  # the frame has come just now
        if silent := self._silent():
            if silent != self._warned:
                self._node.warn(f"{' and '.join(silent)} is advertised but silent: tiles wait for it")
            self._warned = silent
            return
        if "map_origin" not in self._said:
            self._node.warn(
                f"no map_origin was published for {self._patience:g} s: assuming a map frame "
                "with origin 0 and no reference system"
            )
            self._said["map_origin"] = origin_message(MapFrame())
        self._notify()

    def _hear(self, topic: str, message: Any) -> None:
        check_place(_frame(**{topic: message}))
        self._said[topic] = message
        self._notify()

    def _notify(self) -> None:
        if (frame := self.frame) is not None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            self._on_frame(frame)


def _frame(map_origin: PointStamped | None = None, map_units: Vector3Stamped | None = None) -> MapFrame:
    """Return what messages say; in metres if none tells units."""
    header, point = (map_origin.header, map_origin.point) if map_origin else (Header(), Point())
    units = map_units.vector if map_units else Vector3(x=1.0, y=1.0, z=1.0)
    return MapFrame(header.frame_id, (point.x, point.y, point.z), units.x, units.z)
