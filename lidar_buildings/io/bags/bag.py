"""Bags: what is in them, and their messages."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.failures import one_line

CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
#: What ROS 1 called it before.
_OLD_TRANSFORMS = "tf/msg/tfMessage"
POINT = "geometry_msgs/msg/PointStamped"
VECTOR = "geometry_msgs/msg/Vector3Stamped"
FIX = "sensor_msgs/msg/NavSatFix"
_SECOND = 1_000_000_000


class BagTopic(NamedTuple):
    """A topic of a bag, and what its first message tells."""

    #: As in ROS 2: ``/points``, ``sensor_msgs/msg/PointCloud2``.
    name: str
    type: str
    n_messages: int  #: how many
    rate: float  #: messages a second, over the whole bag; 0 for a single one
    #: Of its header, and of odometry; empty where it has none.
    frame: str = ""
    child_frame: str = ""
    n_points: int | None = None  #: points of the first cloud
    fields: tuple[str, ...] = ()  #: the cloud's fields
    problem: str = ""  #: why the message cannot be read, empty if it can

    def __str__(self) -> str:
        parts = [self.type, f"{self.n_messages} message{'s' * (self.n_messages != 1)}"]
        parts += [f"{self.rate:.3g} Hz"] if self.rate else []
        if self.frame:
            child = f" → {self.child_frame}" if self.child_frame else ""
            parts.append(f"frame {self.frame}{child}")
        if self.n_points is not None:
            parts.append(f"first cloud of {self.n_points:,} points ({' '.join(self.fields)})")
        if self.problem:
            parts.append(f"not readable: {self.problem}")
        return f"{self.name}: {', '.join(parts)}"


class BagMessage(NamedTuple):
    """A message of a bag, with the time when it was recorded [ns]."""

    topic: str
    type: str
    time: int
    message: Any


class Bag:
    """An open bag: a folder of rosbag2, a file of one (.mcap, .db3), or of ROS 1 (.bag); or InputError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._is_ros1 = path.is_file() and path.suffix.lower() == ".bag"
        self._types = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_JAZZY)
        with _reported(path):
            self._reader: Any = Reader1(path) if self._is_ros1 else Reader2(path)
            self._reader.open()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    @property
    def topics(self) -> list[BagTopic]:
        """All topics, by name; `topic_contents` looks at their messages."""
        counts: dict[tuple[str, str], int] = {}
        for one in self._reader.connections:
            key = (str(one.topic), _kind_of(one))
            counts[key] = counts.get(key, 0) + (one.msgcount or 0)
        seconds = self.seconds
        return [
            BagTopic(name, kind, n, (n - 1) / seconds if n > 1 and seconds else 0.0)
            for (name, kind), n in sorted(counts.items())
        ]

    @property
    def start(self) -> int | None:
        """When its first message was recorded [ns], None if it has none."""
        return int(self._reader.start_time) if self._reader.message_count else None

    @property
    def seconds(self) -> float:
        """Time from its first to its last message [s]."""
        return max(self._reader.end_time - 1 - self._reader.start_time, 0) / _SECOND if self.start else 0.0

    def messages(
        self, topics: Collection[str], start: float = 0.0, duration: float = 0.0
    ) -> Iterator[BagMessage]:
        """
        Read messages of topics in the order in which they were recorded; InputError if one cannot be read.

        `start` is so long after the beginning of the bag, `duration` so much of it; 0: to its end [s].
        """
        chosen = [one for one in self._reader.connections if one.topic in topics]
        begin = self._reader.start_time + round(start * _SECOND)
        end = begin + round(duration * _SECOND) if duration else None
        if not chosen:
            return
        with _reported(self.path):
            for connection, time, raw in self._reader.messages(chosen, begin, end):
                yield BagMessage(connection.topic, _kind_of(connection), time, self._read(connection, raw))

    def _read(self, connection: Connection, raw: bytes) -> Any:
        kind, definition = connection.msgtype, connection.msgdef
        if kind not in self._types.types:
            if not definition.data:
                raise InputError(f"its type {kind} is unknown, and the bag does not define it")
            if definition.format.name == "IDL":
                defined = get_types_from_idl(definition.data)
            else:
                defined = get_types_from_msg(definition.data, kind)
            self._types.register({k: v for k, v in defined.items() if k not in self._types.types})
        if self._is_ros1:
            return self._types.deserialize_ros1(raw, kind)
        # of a view fields are views: the points are not copied
        return self._types.deserialize_cdr(memoryview(raw), kind)  # type: ignore[arg-type]


def _kind_of(connection: Connection) -> str:
    """Return the type of a connection's messages, as ROS 2 calls it; a damaged bag may have none."""
    return TRANSFORMS if connection.msgtype == _OLD_TRANSFORMS else str(connection.msgtype)


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Turn whatever goes wrong in reading a bag into one line."""
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except FileNotFoundError as error:
        raise InputError(f"{path}: {one_line(error)}: check the path") from error
    except Exception as error:
        raise InputError(
            f"{path}: cannot be read as a bag ({one_line(error)}): `ros2 bag reindex` or `mcap recover` "
            "repairs a truncated one"
        ) from error


def topic_contents(bag: Bag) -> list[BagTopic]:
    """Look at the first message of every topic of an open bag."""
    return [_looked_at(bag, topic) if topic.n_messages else topic for topic in bag.topics]


def _looked_at(bag: Bag, topic: BagTopic) -> BagTopic:
    try:
        message = next(bag.messages([topic.name])).message
    except (InputError, StopIteration) as error:
        return topic._replace(problem=str(error).removeprefix(f"{bag.path}: ") or "it contains no messages")
    one = next(iter(getattr(message, "transforms", ())), message)  # of /tf the first edge
    topic = topic._replace(
        frame=str(getattr(getattr(one, "header", None), "frame_id", "")),
        child_frame=str(getattr(one, "child_frame_id", "")),
    )
    if topic.type != CLOUD:
        return topic
    fields = tuple(field.name for field in message.fields)
    return topic._replace(n_points=message.width * message.height, fields=fields)
