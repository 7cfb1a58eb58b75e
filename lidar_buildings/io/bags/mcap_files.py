"""MCAP files that rosbags refuses: without a profile, with ROS 1 messages, or with others among them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from mcap.reader import McapReader, make_reader
from mcap.records import Schema
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)

_FORMATS = {
    "ros1msg": MessageDefinitionFormat.MSG,
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}


class McapFiles:
    """The messages of some MCAP files, one after the other, as `rosbags.rosbag2.Reader` has them."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._files = ExitStack()
        self._readers: list[McapReader] = []
        self.connections: list[Connection] = []
        self.start_time = self.end_time = self.message_count = 0

    def open(self) -> None:
        """Open all files, and find out what is in them; an error of mcap, or OSError, if one is none."""
        self._readers = [make_reader(self._files.enter_context(path.open("rb"))) for path in self._paths]
        found: dict[tuple[str, str], Connection] = {}
        counts: Counter[tuple[str, str]] = Counter()
        times: list[int] = []
        for reader in self._readers:
            summary = reader.get_summary()
            if summary is not None and summary.statistics is not None:
                told, statistics = summary.statistics.channel_message_counts, summary.statistics
                channels = [
                    (summary.schemas.get(one.schema_id), one, told.get(one.id, 0))
                    for one in summary.channels.values()
                ]
                if statistics.message_count:
                    times += [statistics.message_start_time, statistics.message_end_time]
            else:
                channels = []
                for schema, channel, message in reader.iter_messages(log_time_order=False):
                    channels.append((schema, channel, 1))
                    times.append(message.log_time)
            for schema, channel, n in channels:
                one = _connection(len(found), schema, channel.topic, channel.message_encoding, self)
                key = (one.topic, one.msgtype)
                found.setdefault(key, one)
                counts[key] += n
        self.connections = [one._replace(msgcount=counts[key]) for key, one in found.items()]
        self.start_time, self.end_time = min(times, default=0), max(times, default=-1) + 1
        self.message_count = counts.total()

    def close(self) -> None:
        """Close the files."""
        self._files.close()

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Read messages of some topics as they are, with the time when they were recorded [ns]."""
        wanted = {(one.topic, one.msgtype): one for one in connections}
        for reader in self._readers:
            topics = [one.topic for one in connections]
            for schema, channel, message in reader.iter_messages(topics, start, stop):
                key = (channel.topic, _type_of(schema))
                if key in wanted:
                    yield wanted[key], message.log_time, message.data


def _connection(number: int, schema: Schema | None, topic: str, encoding: str, owner: object) -> Connection:
    kind = _FORMATS.get(schema.encoding if schema else "", MessageDefinitionFormat.NONE)
    text = schema.data.decode() if schema and kind != MessageDefinitionFormat.NONE else ""
    ext = ConnectionExtRosbag2(encoding, [])
    return Connection(number, topic, _type_of(schema), MessageDefinition(kind, text), "", 0, ext, owner)


def _type_of(schema: Schema | None) -> str:
    """Return the name of a type as ROS 2 writes it."""
    name = schema.name if schema else ""
    is_ros1 = schema is not None and schema.encoding == "ros1msg"
    return name.replace("/", "/msg/", 1) if is_ros1 and "/msg/" not in name else name
