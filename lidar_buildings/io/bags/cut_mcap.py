"""MCAP files without an end: what is whole of them, which rosbags refuses to read."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import McapReader

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.bags.bag import Bag

_MAGIC = b"\x89MCAP0\r\n"
#: A record's operation code and length (MCAP specification).
_RECORD = struct.Struct("<BQ")
_HEADER, _DATA_END = 0x01, 0x0F


class CutMcapReader(McapReader):
    """
    Reads the whole records of an MCAP file that was cut off, or never finished.

    Attributes
    ----------
    data_end : int
        Byte up to which the file is whole.
    """

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

    @property
    def start_time(self) -> int:
        """Time of the first message [ns]."""
        return self.metadata.start_time

    @property
    def end_time(self) -> int:
        """Time after the last message [ns]."""
        return self.metadata.end_time

    @property
    def message_count(self) -> int:
        """Messages that are whole."""
        return self.metadata.message_count


def whole_part(file: BinaryIO, size: int) -> tuple[int, int]:
    """
    Return from which byte to which an MCAP file holds whole records of data.

    Raises
    ------
    ReaderError
        If it is no MCAP file.
    """
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
    Open a bag; of an MCAP file that was cut off what is whole.

    Returns
    -------
    bag : Bag
        It is open.
    problem : str
        Why only a part of it can be read, and which; empty if all can.

    Raises
    ------
    InputError
        If nothing of it can be read.
    """
    try:
        return Bag(path), ""
    except InputError as error:
        storage, problem = _storage_of(path), error
    if storage is None:
        raise problem
    reader = CutMcapReader(storage)
    try:
        bag = Bag(path, reader)
    except InputError:
        raise problem from None
    share = reader.data_end / max(storage.stat().st_size, 1)
    said = str(problem).removeprefix(f"{path}: ")
    return bag, f"{said}; read is what is whole: {share:.0%} of the file, the first {bag.seconds:.1f} s"


def _storage_of(path: Path) -> Path | None:
    """Return the only MCAP file of a bag, or the file itself; None if it has none or several."""
    files = list(path.glob("*.mcap")) if path.is_dir() else [path]
    return files[0] if len(files) == 1 and files[0].suffix.lower() == ".mcap" else None
