"""Bags: what is in them, and their messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.bags.scan_types import LIVOX, LIVOX_TEXT, as_cloud
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
#: Files that hold the messages of a bag of ROS 2, and how one of them begins and ends.
_STORAGES, _MCAP_MAGIC = (".mcap", ".db3"), b"\x89MCAP0\r\n"


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


#: Topics that are asked one by one; of more, messages at the begin of the bag are read, so many for each.
_MANY, _PER_TOPIC = 50, 5


class Bag:
    """
    An open bag: a folder of rosbag2, a file of one (.mcap, .db3), or of ROS 1 (.bag); or InputError.

    `unreadable` counts the messages by topic that could not be read, and were left out; `why_unreadable` says
    what is wrong with the last one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.unreadable: Counter[str] = Counter()
        self.why_unreadable = ""
        with _reported(path):
            self._reader = _opened(path)
        self._stores = {
            kind: get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_JAZZY)
            for kind in {_encoding_of(one) for one in self._reader.connections} & {"ros1", "cdr"}
        }

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
                kind = self._known(connection)
                try:
                    message = self._read(connection, kind, raw)
                except Exception as error:
                    self.unreadable[connection.topic] += 1
                    self.why_unreadable = f"{connection.topic}: {one_line(error)}"
                    continue
                yield BagMessage(connection.topic, _kind_of(connection), time, message)

    def _known(self, connection: Connection) -> str:
        """Return a type whose definition is known; InputError if it is not."""
        kind, definition, encoding = connection.msgtype, connection.msgdef, _encoding_of(connection)
        if encoding not in self._stores:
            what = encoding or "in no known way"
            raise InputError(f"its messages are encoded {what}: only messages of ROS are read")
        store = self._stores[encoding]
        if kind in store.types:
            return kind
        if kind in LIVOX:
            defined = get_types_from_msg(LIVOX_TEXT.format(package=kind.split("/")[0]), kind)
        elif not definition.data:
            raise InputError(f"its type {kind} is unknown, and the bag does not define it")
        elif definition.format.name == "IDL":
            defined = get_types_from_idl(definition.data)
        else:
            defined = get_types_from_msg(definition.data, kind)
        store.register({k: v for k, v in defined.items() if k not in store.types})
        return kind

    def _read(self, connection: Connection, kind: str, raw: bytes) -> Any:
        encoding = _encoding_of(connection)
        if encoding == "ros1":
            message = self._stores[encoding].deserialize_ros1(raw, kind)
        else:  # of a view fields are views: the points are not copied
            message = self._stores[encoding].deserialize_cdr(memoryview(raw), kind)  # type: ignore[arg-type]
        return as_cloud(message) if kind in LIVOX else message


def _encoding_of(connection: Connection) -> str:
    """Return how messages are encoded: as in ROS 2 (cdr), as in ROS 1, or otherwise."""
    ext = connection.ext
    return ext.serialization_format if isinstance(ext, ConnectionExtRosbag2) else "ros1"


def _kind_of(connection: Connection) -> str:
    """Return the type of a connection's messages, as ROS 2 calls it; a damaged bag may have none."""
    if connection.msgtype in LIVOX:
        return CLOUD
    return TRANSFORMS if connection.msgtype == _OLD_TRANSFORMS else str(connection.msgtype)


def _opened(path: Path) -> Any:
    """Return an open reader; another than that of rosbags for what that refuses by headers alone."""
    is_ros1 = path.is_file() and path.suffix.lower() == ".bag"
    reader: Any = Reader1(path) if is_ros1 else Reader2(path)
    try:
        reader.open()
    except Exception:
        files = [] if is_ros1 else _files_of(path)
        if files and all(one.suffix.lower() == ".mcap" for one in files):
            from lidar_buildings.io.bags.mcap_files import McapFiles  # seldom needed

            reader = McapFiles(files)
        elif path.is_dir() and len(files) == 1:  # its description does not fit its only file
            reader = Reader2(files[0])
        else:
            raise
        if any(map(_is_cut_off, files)):
            raise
        reader.open()
    return reader


def _files_of(path: Path) -> list[Path]:
    """Return the files that hold messages, by name."""
    return (
        sorted(one for one in path.iterdir() if one.suffix.lower() in _STORAGES) if path.is_dir() else [path]
    )


def _is_cut_off(path: Path) -> bool:
    """Whether a file begins as one of a bag does, and lacks its end."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        begin = file.read(4096)
        file.seek(max(size - len(_MCAP_MAGIC), 0))
        end = file.read()
    if begin.startswith(_MCAP_MAGIC):
        return end != _MCAP_MAGIC
    if begin.startswith(b"SQLite format 3"):
        page, n_pages = int.from_bytes(begin[16:18], "big"), int.from_bytes(begin[28:32], "big")
        return size < (65_536 if page == 1 else page) * n_pages
    index = begin.find(b"index_pos=") + len(b"index_pos=")
    return begin.startswith(b"#ROSBAG") and not 0 < int.from_bytes(begin[index : index + 8], "little") <= size


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
        with suppress(OSError):
            if any(map(_is_cut_off, _files_of(path))):
                raise InputError(
                    f"{path}: cannot be read as a bag ({one_line(error)}): it is cut off: `ros2 bag reindex` "
                    "or `mcap recover` repairs it"
                ) from error
        raise InputError(
            f"{path}: cannot be read as a bag ({one_line(error)}): it is damaged, or none: copy it again"
        ) from error


def topic_contents(bag: Bag) -> list[BagTopic]:
    """Look at the first message of every topic of an open bag; of very many only near its begin."""
    topics = bag.topics
    known: dict[str, Any] = {}
    if len(topics) > _MANY:  # to ask for each takes time for each of the others
        names = {topic.name for topic in topics}
        for one in islice(bag.messages(names), _PER_TOPIC * len(names)):
            known.setdefault(one.topic, one.message)
            if len(known) == len(names):
                break
    found, n_asked = [], 0
    for topic in topics:
        n_asked += topic.n_messages > 0 and topic.name not in known
        if topic.n_messages and n_asked > _MANY and topic.name not in known:
            topic = topic._replace(problem="its first message is far from the begin of the bag")
        elif topic.n_messages:
            topic = _looked_at(bag, topic, known.get(topic.name))
        found.append(topic)
    return found


def _looked_at(bag: Bag, topic: BagTopic, message: Any = None) -> BagTopic:
    try:
        if message is None:
            message = next(bag.messages([topic.name])).message
    except (InputError, StopIteration) as error:
        why = str(error).removeprefix(f"{bag.path}: ") or bag.why_unreadable.removeprefix(f"{topic.name}: ")
        return topic._replace(problem=why or "it contains no messages")
    one = next(iter(getattr(message, "transforms", ())), message)  # of /tf the first edge
    topic = topic._replace(
        frame=str(getattr(getattr(one, "header", None), "frame_id", "")),
        child_frame=str(getattr(one, "child_frame_id", "")),
    )
    if topic.type != CLOUD:
        return topic
    fields = tuple(field.name for field in message.fields)
    return topic._replace(n_points=message.width * message.height, fields=fields)
