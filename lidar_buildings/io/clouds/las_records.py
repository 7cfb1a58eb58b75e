"""
A LAS file's header and variable length records as raw bytes.

laspy reads the header's fields; here stand only the checks that must come before it (it trusts counts and
offsets), and the records byte for byte, which laspy parses and writes anew.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.find_inputs import what_else
from lidar_buildings.io.files.locations import open_binary

SIGNATURE = b"LASF"
#: Bytes of the oldest header; every version begins with these fields.
SMALLEST_HEADER = 227
#: Sizes of a record's own header, plain and extended.
VLR_HEADER, EVLR_HEADER = 54, 60
#: Extended records larger than this are not looked into: waveforms, point hierarchies [bytes].
LARGEST_READ_EVLR = 1 << 20
#: Bit of the global encoding: waveforms stand in this file (LAS 1.3).
WAVEFORMS_INSIDE = 0x02
#: Bit of the point format that says LAZ.
COMPRESSED = 0x80
#: LAZ compressor without chunks, hence without chunk table.
POINTWISE = 1
#: Of a LAZ record: how points are compressed, and points per chunk (LASzip specification).
_LASZIP = struct.Struct("<H10xI")
#: Points per chunk where each has its own number; at most so many else, unless a file is one chunk.
_VARIABLE, _LARGEST_CHUNK = 2**32 - 1, 10_000_000
#: A chunk begins with a point as it is, of so many bytes at least.
_SMALLEST_CHUNK = 20

_AGAIN = "download or export it again"


@dataclass(frozen=True)
class RawRecord:
    """One (extended) variable length record."""

    user_id: bytes  #: without its trailing zeros
    record_id: int
    head: bytes  #: its own header, as it stands in the file
    #: Where its data lie in the file [bytes].
    start: int
    size: int
    data: bytes  #: the data; empty for extended records larger than `LARGEST_READ_EVLR`

    def is_a(self, user_id: bytes, record_id: int) -> bool:
        """Whether it is the record of this user and number."""
        return self.user_id == user_id and self.record_id == record_id


@dataclass(frozen=True)
class RawHeader:
    """What stands at a LAS file's beginning, and its extended records."""

    block: bytes
    #: In file order.
    vlrs: tuple[RawRecord, ...]
    evlrs: tuple[RawRecord, ...]
    offset: int  #: where point data begin [bytes]

    @property
    def minor_version(self) -> int:
        """4 of "1.4"."""
        return self.block[25]

    @property
    def global_encoding(self) -> int:
        """The header's flags."""
        return self._number("<H", 6)

    @property
    def has_equal_chunks(self) -> bool:
        """Whether chunks hold equal numbers of points; those of COPC do not."""
        laszip = [record.data for record in self.vlrs if record.is_a(b"laszip encoded", 22204)]
        return not laszip or _LASZIP.unpack_from(laszip[0])[1] != _VARIABLE

    @property
    def record_size(self) -> int:
        """Bytes of one uncompressed point."""
        return self._number("<H", 105)

    @property
    def point_count(self) -> int:
        """Number of points that the header promises."""
        count = self._number("<Q", 247) if self.minor_version >= 4 and len(self.block) >= 255 else 0
        return count or self._number("<I", 107)

    @property
    def waveform_start(self) -> int:
        """Where the waveform record begins, 0 if it is not in this file [bytes]."""
        inside = self.minor_version >= 3 and self.global_encoding & WAVEFORMS_INSIDE
        return self._number("<Q", 227) if inside and len(self.block) >= 235 else 0

    def _number(self, kind: str, at: int) -> int:
        return int(struct.unpack_from(kind, self.block, at)[0])


def read_raw_header(path: Path) -> RawHeader:
    """Read and check header and records; InputError if it is no LAS file, or its header cannot be true."""
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path}: is empty (0 bytes): {_AGAIN}")
    with open_binary(path) as file:
        begin = file.read(SMALLEST_HEADER)
        if begin[:4] != SIGNATURE:
            what = what_else(path) or (
                "is not a LAS or LAZ file (does not begin with LASF): give a .las or .laz file"
            )
            raise InputError(f"{path}: {what}")
        if len(begin) < SMALLEST_HEADER:
            raise InputError(f"{path}: is truncated within its header: {_AGAIN}")
        header_size, offset, n_vlrs = struct.unpack_from("<HII", begin, 94)
        if not SMALLEST_HEADER <= header_size <= offset:
            raise InputError(
                f"{path}: its header is damaged or was never finished "
                f"(point data would begin at byte {offset}): {_AGAIN}"
            )
        if offset > size:
            raise InputError(f"{path}: is truncated before its first point: {_AGAIN}")
        if n_vlrs * VLR_HEADER > offset - header_size:
            raise InputError(f"{path}: its header is damaged ({n_vlrs} records cannot fit in it): {_AGAIN}")
        file.seek(0)
        block = file.read(header_size)
        vlrs = _records(file, n_vlrs, extended=False, end=offset)
        header = RawHeader(block, vlrs, (), offset)
        _check_length(path, file, header, size)
        if header.minor_version < 4 or len(block) < 247:
            return header
        start, count = struct.unpack_from("<QI", block, 235)
        if not count or start < offset or start + count * EVLR_HEADER > size:
            return header  # their place cannot be true
        file.seek(start)
        return replace(header, evlrs=_records(file, count, extended=True, end=size))


def _check_length(path: Path, file: BinaryIO, header: RawHeader, size: int) -> None:
    """Refuse a file that ends before its last point, or claims what it has no room for."""
    if not header.point_count:
        return
    if not header.block[104] & COMPRESSED:
        held = (size - header.offset) // max(header.record_size, 1)
        if held < header.point_count:
            raise InputError(f"{path}: is truncated ({held} of {header.point_count} points): {_AGAIN}")
        return
    laszip = [record.data for record in header.vlrs if record.is_a(b"laszip encoded", 22204)]
    if not laszip or len(laszip[0]) < _LASZIP.size:
        raise InputError(f"{path}: its LAZ record is missing or damaged: {_AGAIN}")
    kind, chunk_size = _LASZIP.unpack_from(laszip[0])
    if kind == POINTWISE:
        return
    file.seek(header.offset)
    table = int.from_bytes(file.read(8), "little", signed=True)
    if table == -1:  # written as a stream: its place stands at the file's end
        file.seek(-8, os.SEEK_END)
        table = int.from_bytes(file.read(8), "little", signed=True)
    if not header.offset + 8 <= table <= size - 8:
        raise InputError(f"{path}: is truncated (its chunk table is missing): {_AGAIN}")
    file.seek(table + 4)
    n_chunks = int.from_bytes(file.read(4), "little")
    # lazrs takes memory for what these say, and where there is not so much the process ends
    if n_chunks * _SMALLEST_CHUNK > size or max(header.point_count, _LARGEST_CHUNK) < chunk_size != _VARIABLE:
        raise InputError(f"{path}: is damaged ({n_chunks} chunks of {chunk_size} points): {_AGAIN}")


def _records(file: BinaryIO, count: int, *, extended: bool, end: int) -> tuple[RawRecord, ...]:
    """Read records from where the file stands, up to `end`."""
    found = []
    for _ in range(count):
        head = file.read(size := EVLR_HEADER if extended else VLR_HEADER)
        if len(head) < size:
            break
        user_id, record_id = struct.unpack_from("<16sH", head, 2)
        (length,) = struct.unpack_from("<Q" if extended else "<H", head, 20)
        start = file.tell()
        if start + length > end:
            break
        data = b"" if extended and length > LARGEST_READ_EVLR else file.read(length)
        file.seek(start + length)
        found.append(RawRecord(user_id.split(b"\0")[0], record_id, head, start, length, data))
    return tuple(found)
