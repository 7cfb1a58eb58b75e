"""MCAP files without an end: what is whole of them, which rosbags refuses to read."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import Connection
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.bags import METADATA, split_files
from lidar_buildings.io.bags.bag import Bag

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
            raise ReaderError("no whole message is in it")
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
            raise ReaderError("no whole message is in it")
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
        raise ReaderError("it ends in its header")
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
    return bag, f"{said}; read is what is whole: {reader.share:.0%} of {of} {bag.seconds:.1f} s"
