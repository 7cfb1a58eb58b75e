"""Writing bags of rosbag2."""

from __future__ import annotations

import os
import queue
import threading
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any

from rosbags import interfaces
from rosbags.interfaces import Connection, Qos, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_typestore

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.atomic_files import writing
from lidar_buildings.io.files.failures import one_line

#: The format of rosbag2 that ROS 2 Jazzy writes.
_VERSION = 9
_FOR_EVER = QosTime(9_223_372_036, 854_775_807)


def offered(depth: int, *, is_latched: bool) -> Qos:
    """
    Return what `ros2 bag play` is to offer under a topic: reliable, so many messages kept, 0 for all.

    Latched ones are given to those that come late, too.
    """
    return Qos(
        interfaces.QosHistory.KEEP_LAST if depth else interfaces.QosHistory.KEEP_ALL,
        depth,
        interfaces.QosReliability.RELIABLE,
        interfaces.QosDurability.TRANSIENT_LOCAL if is_latched else interfaces.QosDurability.VOLATILE,
        _FOR_EVER,
        _FOR_EVER,
        interfaces.QosLiveliness.AUTOMATIC,
        _FOR_EVER,
        False,
    )


class BagWriter:
    """
    A bag (MCAP) that is being written, a folder that must not be there; schemas of the messages are inside.

    Topics that are `latched` are given to latecomers, too. OutputError if there is something of that name, or
    it cannot be written.
    """

    def __init__(self, path: Path, latched: Collection[str] = ()) -> None:
        self.path = path
        self._latched = latched
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        if path.exists():
            raise OutputError(f"{path}: already exists: choose another name for the bag, or remove it")
        self._writer = Writer(path, version=_VERSION, storage_plugin=StoragePlugin.MCAP)
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


_MCAP = ".mcap"
#: Bytes of messages that may wait for the disk.
MOST_WAITING = 500_000_000


class Recording:
    """
    A bag that is made with its first message, a folder that must not be there.

    What is too much for the disk is left out: so many bytes may wait; a single message may be larger. `lost`
    leads from a topic to the messages that were left out, or came after the bag could not be written any
    more; `failure` is why it cannot be written, or not all of it, empty if it can. OutputError if something
    of that name is there, or no folder can be made there.
    """

    def __init__(self, path: Path, most_waiting: int = MOST_WAITING) -> None:
        self.path = path
        self.n_messages = self.n_bytes = 0
        self.lost: Counter[str] = Counter()
        self.failure = ""
        self._has_ended = False
        self._topics: dict[str, tuple[str, Qos]] = {}
        self._bag: BagWriter | None = None
        self._most, self._n_taken, self._n_left = most_waiting, 0, 0
        self._waiting: queue.SimpleQueue[tuple[str, int, bytes | None] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        if path.exists():
            raise OutputError(f"{path}: already exists: choose another name for the bag, or remove it")
        above = next(one for one in path.absolute().parents if one.exists())
        if not above.is_dir() or not os.access(above, os.W_OK):
            raise OutputError(f"{path}: cannot be written: {above} is not a writable folder")

    def declare(self, name: str, kind: str, qos: Qos) -> None:
        """Say of what type a topic is, and how it is to be played, before its first message."""
        self._topics[name] = kind, qos

    def start(self, on_written: Callable[[str, int], None]) -> None:
        """Begin to write in a thread, which calls `on_written` with topic and time [ns] of each message."""
        self._thread = threading.Thread(target=self._run, args=(on_written,), name="recording", daemon=True)
        self._thread.start()

    @property
    def n_waiting(self) -> int:
        """Bytes that wait."""
        return self._n_taken - self._n_left

    def add(self, name: str, time: int, data: bytes) -> None:
        """Take a message (CDR) that came at a time [ns]."""
        has_room = not self.n_waiting or self.n_waiting + len(data) <= self._most
        self._n_taken += len(data) * has_room
        self._waiting.put((name, time, data if has_room else None))

    def close(self) -> None:
        """Complete the bag when all that was taken is written, and take no more."""
        if self._thread is not None:
            self._waiting.put(None)
            self._thread.join()
            self._thread = None
        if self._bag is not None:
            try:
                self._bag.close()
            except OutputError as error:
                self._give_up(error)
            self._bag = None

    def _run(self, on_written: Callable[[str, int], None]) -> None:
        while (message := self._waiting.get()) is not None:
            name, time, data = message
            if data is None:
                self.lost[name] += 1
                slow = f"{self.path}: the disk is too slow: some messages are dropped"
                self.failure = self.failure or slow
            else:
                self._write(name, time, data)
                self._n_left += len(data)
            on_written(name, time)

    def _write(self, name: str, time: int, data: bytes) -> None:
        """Write a message; once that fails, only count it."""
        if self._has_ended:
            self.lost[name] += 1
            return
        try:
            if self._bag is None:
                self._bag = BagWriter(self.path)
                for topic, (kind, qos) in self._topics.items():
                    self._bag.add_topic(topic, kind, qos)
            self._bag.write_serialised(name, self._topics[name][0], time, data)
        except OutputError as error:
            self._give_up(error)
            self.lost[name] += 1
            return
        self.n_messages += 1
        self.n_bytes += len(data)

    def _give_up(self, error: OutputError) -> None:
        why = one_line(error.__cause__ or error)
        self.failure = (
            f"{self.path}: can no longer be written ({why}): complete chunks remain; "
            "`mcap recover` repairs it"
        )
        if self._bag is not None:
            self._bag.abandon()
            self._bag = None
        self._has_ended = True


def bag_folder(name: str | Path) -> Path:
    """Return the folder of a bag that a user calls so: ``flight`` for ``flight.mcap``, a file within it."""
    path = Path(name)
    return path.with_suffix("") if path.suffix.lower() == _MCAP else path
