"""The virtual scanner as a ROS node that publishes in real time."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import closing
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_sensor_data

from lidar_buildings.ros import qos
from lidar_buildings.ros.point_cloud import fill
from lidar_buildings.simulation.live import BodyPose, MovingSurvey, Scan
from lidar_buildings.simulation.live.messages import (
    LATCHED,
    ODOMETRY,
    SCAN,
    TF,
    TYPES,
    LiveMessages,
    Pace,
    PlayReport,
    Told,
    ahead,
)

#: Events that are made ready ahead: two seconds of 200 poses and 10 scans.
DEPTH = 420
#: Who subscribes to scans is given so long to subscribe to poses, too [s].
_FOR_POSES = 2.0
#: How often it is looked for a subscriber, and how long the last messages may take [s].
_TICK, _LAST = 0.02, 5.0


def message_class(kind: str) -> Any:
    """Return the class of a type such as ``std_msgs/msg/Header`` or ``std_msgs/Header``."""
    package, *_, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def make_message(kind: str, **members: Any) -> Any:
    """Return a message of a type; a cloud takes any array for its data, without copying it."""
    data = members.pop("data", None) if kind == "sensor_msgs/msg/PointCloud2" else None
    message = message_class(kind)(**members)
    if data is not None:
        fill(message, data)
    return message


class LivePublisher:
    """
    Publishes a survey in an initialised context; see `LiveMessages`, without tf2_msgs there is no /tf.

    /tf, /tf_static and /clock have no namespace. If it is reliable, scans are sent again when they get lost.
    `report` says how it was played so far.
    """

    def __init__(
        self,
        survey: MovingSurvey,
        context: rclpy.Context,
        namespace: str = "",
        *,
        with_tf: bool = True,
        with_fix: bool = False,
        is_reliable: bool = False,
    ) -> None:
        self.has_tf = with_tf and find_spec("tf2_msgs") is not None  # PyPI has none
        self.report = PlayReport()
        self._survey = survey
        self._messages = LiveMessages(survey, make_message, with_tf=self.has_tf, with_fix=with_fix)
        self._node = rclpy.create_node(
            "virtual_scanner", context=context, namespace=namespace, start_parameter_services=False
        )
        self._publishers: dict[str, Publisher] = {
            topic: self._node.create_publisher(
                message_class(TYPES[topic]), topic, _profile(topic, is_reliable=is_reliable)
            )
            for topic in self._messages.topics
        }
        for told in self._messages.opening():
            self._tell(told)

    @property
    def scan_topic(self) -> str:
        """The scans' topic with its namespace."""
        return self._publishers[SCAN].topic_name

    def wait(self) -> None:
        """Return when somebody subscribes to the scans, and has had time to do so to the poses."""
        while not self._publishers[SCAN].get_subscription_count():
            time.sleep(_TICK)
        until = time.monotonic() + _FOR_POSES
        poses = [one for topic, one in self._publishers.items() if topic in (ODOMETRY, TF)]
        while time.monotonic() < until and not any(one.get_subscription_count() for one in poses):
            time.sleep(_TICK)

    def play(self, events: Iterable[Scan | BodyPose]) -> None:
        """Publish scans and poses, each when its time has come; a thread of its own reads `events` ahead."""
        pace = Pace(self.report, 2.0 / self._survey.pose_rate)
        messages = ((event, list(self._messages.of(event))) for event in events)
        with closing(ahead(messages, DEPTH)) as made:
            for event, tidings in made:
                pace.wait_for(event.sent)
                for told in tidings:
                    self._tell(told)
                if isinstance(event, Scan):
                    self.report.n_scans += 1
                    self.report.n_points += len(event.truth.points)

    def close(self) -> None:
        """Wait until what is sent reliably has arrived, and leave the graph."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=_LAST))
        self._node.destroy_node()

    def _tell(self, told: Told) -> None:
        self._publishers[told.topic].publish(told.message)


def _profile(topic: str, *, is_reliable: bool) -> QoSProfile:
    if topic == SCAN:
        return qos.RELIABLE_SENSOR if is_reliable else qos_profile_sensor_data
    return qos.LATCHED if topic in LATCHED else qos.RELIABLE_POSE
