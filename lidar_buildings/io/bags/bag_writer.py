"""Writing bags of rosbag2."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Any

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_typestore

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.atomic_files import writing

#: Storage → rosbags' plugin.
STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
#: What is compressed → rosbags' mode; with zstd.
COMPRESSIONS = {"": None, "message": CompressionMode.MESSAGE, "file": CompressionMode.FILE}
#: The format of rosbag2 that ROS 2 Jazzy writes.
_VERSION = 9
_FOR_EVER = QosTime(9_223_372_036, 854_775_807)


def offered(depth: int, *, is_latched: bool) -> Qos:
    """
    Return what `ros2 bag play` is to offer under a topic: reliable, so many messages kept, 0 for all.

    Latched ones are given to those that come late, too.
    """
    return Qos(
        QosHistory.KEEP_LAST if depth else QosHistory.KEEP_ALL,
        depth,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        _FOR_EVER,
        _FOR_EVER,
        QosLiveliness.AUTOMATIC,
        _FOR_EVER,
        False,
    )


class BagWriter:
    """
    A bag that is being written, a folder that must not be there; schemas of the messages are inside.

    `storage` is a key of `STORAGES`, `compression` one of `COMPRESSIONS`; topics that are `latched` are given
    to latecomers, too. OutputError if there is something of that name, or it cannot be written.
    """

    def __init__(
        self, path: Path, storage: str = "mcap", compression: str = "", latched: Collection[str] = ()
    ) -> None:
        self.path = path
        self._latched = latched
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        if path.exists():
            raise OutputError(f"{path}: is there already: choose another name for the bag, or remove it")
        self._writer = Writer(path, version=_VERSION, storage_plugin=STORAGES[storage])
        mode = COMPRESSIONS[compression]
        if mode is not None:
            self._writer.set_compression(mode, CompressionFormat.ZSTD)
        with writing(path, (OSError, WriterError)):
            self._writer.open()

    def close(self) -> None:
        """Complete the bag."""
        with writing(self.path):
            self._writer.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def make(self, kind: str, **members: Any) -> Any:
        """Return a message of a type (``std_msgs/msg/Header``); all of its members must be given."""
        return self._types.types[kind](**members)

    def abandon(self) -> None:
        """Leave the bag as it is, without an end: it cannot be written any more."""
        with suppress(OSError):
            self._writer.abort()

    def add_topic(self, topic: str, kind: str, qos: Qos | None) -> None:
        """Say of what type a topic is, and how it is to be played."""
        self._connections[topic] = self._writer.add_connection(
            topic, kind, typestore=self._types, offered_qos_profiles=(qos,) if qos else ()
        )

    def write(self, topic: str, kind: str, time: int, message: Any) -> None:
        """Write a message of rosbags with the time when it was received [ns]."""
        self.write_serialised(topic, kind, time, self._types.serialize_cdr(message, kind))

    def write_serialised(self, topic: str, kind: str, time: int, data: bytes | memoryview) -> None:
        """Write a message as it went over the network (CDR)."""
        with writing(self.path):
            if topic not in self._connections:
                self.add_topic(topic, kind, offered(1, is_latched=True) if topic in self._latched else None)
            self._writer.write(self._connections[topic], time, data)
