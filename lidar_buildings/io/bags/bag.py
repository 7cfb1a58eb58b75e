"""Bags: what is in them, and their messages."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.bags.bag_inputs import METADATA, split_files
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
    """
    A bag that is open: a folder of rosbag2, a storage file of one (.mcap, .db3), or a bag of ROS 1 (.bag).

    `reader` reads it, as the readers of rosbags do, where it is none of theirs. InputError if it cannot be
    read.
    """

    def __init__(self, path: Path, reader: Any = None) -> None:
        self.path = path
        self._is_ros1 = path.is_file() and path.suffix.lower() == ".bag"
        self._types = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_JAZZY)
        with _reported(path):
            self._reader: Any = reader or (Reader1(path) if self._is_ros1 else Reader2(path))
            self._reader.open()

    def close(self) -> None:
        """Close it."""
        self._reader.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

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

    def _learn(self, connection: Connection) -> None:
        """Make a type known by its definition."""
        if connection.msgtype not in self._types.types:
            if not connection.msgdef.data:
                raise InputError(f"its type {connection.msgtype} is unknown, and the bag does not define it")
            is_idl = connection.msgdef.format.name == "IDL"
            defined = (
                get_types_from_idl(connection.msgdef.data)
                if is_idl
                else get_types_from_msg(connection.msgdef.data, connection.msgtype)
            )
            self._types.register({k: v for k, v in defined.items() if k not in self._types.types})

    def _read(self, connection: Connection, raw: bytes) -> Any:
        self._learn(connection)
        kind = connection.msgtype
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


_MCAP = ".mcap"
_MAGIC = b"\x89MCAP0\r\n"
#: A record's operation code and length (MCAP specification).
_RECORD = struct.Struct("<BQ")
_HEADER, _DATA_END = 0x01, 0x0F


class CutMcapReader(McapReader):
    """Reads the whole records of an MCAP file that was cut off, or never finished, up to byte `data_end`."""

    def _open(self) -> None:
        with self.path.open("rb") as file:
            self.data_start, self.data_end = whole_part(file, self.path.stat().st_size)
        self.meta_scan()
        told = self.statistics
        if not told or not told.message_count:
            raise ReaderError("it contains no complete message")
        counts = told.channel_message_counts
        self.connections = [one._replace(msgcount=counts.get(one.id, 0)) for one in self.connections]
        self.metadata = self.metadata._replace(
            duration=told.end_time - told.start_time + 1,
            start_time=told.start_time,
            end_time=told.end_time + 1,
            message_count=told.message_count,
        )


class CutBagReader:
    """
    Reads the files of a bag one after the other, of MCAP files that were cut off what is whole.

    Files without a whole message are left out. `start_time` and `end_time` are that of the first message, and
    that after the last one [ns]; `share` of the files is whole.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._files: list[McapReader | Sqlite3Reader] = []

    def open(self) -> None:
        """Open the files; ReaderError if no whole message is in them."""
        self._files = sorted(filter(None, map(_opened, self._paths)), key=lambda one: one.metadata.start_time)
        if not self._files:
            raise ReaderError("it contains no complete message")
        told = [one.metadata for one in self._files]
        self.connections = [connection for one in self._files for connection in one.connections]
        self.start_time, self.end_time = told[0].start_time, max(one.end_time for one in told)
        self.message_count = sum(one.message_count for one in told)
        whole = (
            one.data_end if isinstance(one, CutMcapReader) else one.path.stat().st_size for one in self._files
        )
        self.share = sum(whole) / max(sum(path.stat().st_size for path in self._paths), 1)

    def close(self) -> None:
        """Close them."""
        while self._files:
            self._files.pop().close()

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Read messages, as the readers of rosbags do."""
        for file in self._files:
            if own := [one for one in connections if one.owner is file]:
                yield from file.messages(own, start, stop)


def _opened(path: Path) -> McapReader | Sqlite3Reader | None:
    """Open a file as it is, else what is whole of it; None if that holds no message."""
    for kind in (McapReader, CutMcapReader) if path.suffix.lower() == _MCAP else (Sqlite3Reader,):
        reader = kind(path)
        with suppress(Exception):  # whatever is wrong with a file that was cut off
            reader.open()
            return reader
    return None


def whole_part(file: BinaryIO, size: int) -> tuple[int, int]:
    """Return from which byte to which an MCAP file holds whole records of data; ReaderError if it is none."""
    file.seek(0)
    if file.read(len(_MAGIC)) != _MAGIC:
        raise ReaderError("File magic is invalid.")
    start, end = 0, len(_MAGIC)
    while len(head := file.read(_RECORD.size)) == _RECORD.size:
        code, length = _RECORD.unpack(head)
        after = end + _RECORD.size + length
        if after > size or code == _DATA_END:
            break
        file.seek(after)
        if code == _HEADER:
            start = after
        end = after
    if not start:
        raise ReaderError("it is truncated within its header")
    return start, end


def open_bag(path: Path) -> tuple[Bag, str]:
    """
    Open a bag, of an MCAP file that was cut off what is whole; return it and why only a part can be read.

    That says which part, and is empty if all can be read. InputError if nothing can.
    """
    try:
        return Bag(path), ""
    except InputError as error:
        files, problem = [path], error
    is_unfinished = path.is_dir() and not (path / METADATA).exists()
    if path.is_dir():
        files = (split_files(path) if is_unfinished else []) or sorted(path.glob("*.mcap"))
    elif path.suffix.lower() != _MCAP:
        raise problem
    reader = CutBagReader(files)
    try:
        bag = Bag(path, reader)
    except InputError:
        raise problem from None
    if reader.share == 1.0 and is_unfinished:
        return bag, ""  # nothing but its metadata is missing
    said = str(problem).removeprefix(f"{path}: ")
    of = "the file, the first" if len(files) == 1 else f"{len(files)} files,"
    return bag, f"{said}; only complete chunks are read: {reader.share:.0%} of {of} {bag.seconds:.1f} s"
