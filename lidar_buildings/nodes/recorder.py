"""Node `recorder`."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.io.bags.bag_writer import Recording, bag_folder, offered
from lidar_buildings.nodes.configs import NODE_CONFIGS, RecorderConfig
from lidar_buildings.nodes.table import topics_called
from lidar_buildings.ros import qos
from lidar_buildings.ros.diagnostics import TOPIC as DIAGNOSTICS
from lidar_buildings.ros.stage_node import StageNode

#: Period of the search for topics of others; silence after which all that was sent has come, a wide margin
#: over the way of a message; and delay of a message that is worth a warning [s].
_SEARCH, _SILENCE, _LATE = 0.1, 0.2, 10.0
#: A header of CityJSONSeq, which has a publisher of its own, and is not told twice.
_HEADER = b'{"type":"CityJSON",'


class Recorder(StageNode):
    """Writes what is published under some topics to a bag, as it came."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("recorder", NODE_CONFIGS["recorder"], **kwargs)
        config = self.parameters[RecorderConfig]
        with self.starting():
            if not config.output:
                raise ParameterError("recorder.output is empty: name a folder for the bag")
            self.recording = Recording(bag_folder(config.output))
        self._last_heard, self._lag = time.monotonic(), 0.0
        self.recording.start(self._on_written)
        self._sought = set(config.topics)
        self.summary.gauges.append(self._gauges)
        for name in config.topics:
            for topic in topics_called(name):
                if topic.qos not in ("SENSOR", "POSE"):  # sensors publish as they like, reliably or not
                    self._subscribe(name, topic.type.replace("/", "/msg/"), getattr(qos, topic.qos))
        self._search = self.create_timer(_SEARCH, self.on_search)
        self.on_search()

    @property
    def is_silent(self) -> bool:
        """Whether nothing has come for a while but diagnostics, which always do."""
        return not self.recording.n_waiting and time.monotonic() - self._last_heard > _SILENCE

    def on_search(self) -> None:
        """Subscribe to topics of others as soon as somebody publishes them, as reliably as they are sent."""
        for name in sorted(self._sought):
            if publishers := self.get_publishers_info_by_topic(name):
                profiles = [one.qos_profile for one in publishers]
                self._subscribe(name, publishers[0].topic_type, _common(profiles))
        if not self._sought:
            self._search.cancel()

    def destroy_node(self) -> None:
        """Complete the bag."""
        if hasattr(self, "recording"):
            self.recording.close()
        super().destroy_node()

    def _subscribe(self, name: str, kind: str, profile: QoSProfile) -> None:
        """Record a topic; all that comes is kept until it is written."""
        self._sought.discard(name)
        package, _, message = kind.partition("/msg/")
        try:
            message_type = getattr(import_module(f"{package}.msg"), message)
        except (ImportError, AttributeError):
            self.get_logger().error(f"{name} is not recorded: its type {kind} is not installed")
            return
        recorded = f"/{name.lstrip('/')}"
        is_latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        depth = 0 if profile.history == HistoryPolicy.KEEP_ALL else profile.depth
        several = len(topics_called(name)) > 1
        played = offered(0 if several else depth, is_latched=is_latched or several)
        self.recording.declare(recorded, kind, played)

        def take(data: bytes, info: dict[str, int]) -> None:
            if several and not is_latched and _HEADER in data[:64]:
                return
            self.recording.add(recorded, info["received_timestamp"] or time.time_ns(), data)
            if name != DIAGNOSTICS:
                self._last_heard = time.monotonic()

        wanted = QoSProfile(
            reliability=profile.reliability, durability=profile.durability, history=HistoryPolicy.KEEP_ALL
        )
        self.create_subscription(
            message_type, name, take, wanted, raw=True, event_callbacks=qos.SILENT_SUBSCRIPTION
        )

    def _on_written(self, name: str, received: int) -> None:
        """Tell how late messages are written, and what is wrong; called by the thread that writes."""
        self._lag = (time.time_ns() - received) * 1e-9
        if self._lag > _LATE:
            self.summary.warned(f"{name} is recorded with a delay of {self._lag:.0f} s: the disk is too slow")
        if self.recording.failure != self.summary.problem:
            self.summary.problem = self.recording.failure
            self.get_logger().error(self.recording.failure)

    def interrupted(self, spin_once: Callable[[float], None]) -> None:
        """Record what has come and was not taken yet."""
        self._last_heard = time.monotonic()  # messages may wait though none was taken for a while
        while not self.is_silent:
            spin_once(_SILENCE / 10)

    def _gauges(self) -> dict[str, float]:
        recording = self.recording
        return {
            "messages": recording.n_messages,
            "megabytes": recording.n_bytes * 1e-6,
            "messages_lost": sum(recording.lost.values()),
            "megabytes_waiting": recording.n_waiting * 1e-6,
            "lag": self._lag,
        }


def _common(profiles: list[QoSProfile]) -> QoSProfile:
    """Return what all publishers of a topic can give."""
    is_latched = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in profiles)
    is_reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in profiles)
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_ALL,
    )
