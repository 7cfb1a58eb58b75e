"""The kinds of cloud: a file by its header, and one that was opened and checked."""

from __future__ import annotations

import logging
import multiprocessing
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.io.clouds.find_inputs import InputFile, check_unchanged
from lidar_buildings.io.clouds.las_crs import SourceCrs
from lidar_buildings.io.clouds.las_records import RawHeader
from lidar_buildings.io.files.failures import captured_panics, reported
from lidar_buildings.io.files.locations import open_binary

#: What stands before the first chunk: where the table of chunks is [bytes].
_BEFORE_CHUNKS = 8

# what laspy logs of a failing file is said again in the one line of the InputError
for _name in ("laspy.lasreader", "laspy.header"):
    logging.getLogger(_name).addFilter(lambda record: record.levelno < logging.ERROR)


def laz_backend() -> laspy.LazBackend:
    """Return the parallel backend, or the sequential one in a fork, which lacks the threads of lazrs."""
    is_of_a_pool = multiprocessing.parent_process() is not None
    return laspy.LazBackend.Lazrs if is_of_a_pool else laspy.LazBackend.LazrsParallel


@contextmanager
def open_reader(path: Path) -> Iterator[tuple[Any, Any]]:
    """
    Open a reader with the backend of this process, or the sequential one for files without a chunk table.

    The second item is a context for each read: the sequential backend may panic on damaged or very old files.
    """
    backend = laz_backend()
    try:
        reader = laspy.open(open_binary(path), laz_backend=backend, read_evlrs=False)
        guard: Any = nullcontext if backend is laspy.LazBackend.LazrsParallel else captured_panics
        if reader.header.point_count:
            _ = reader.point_source  # raises here where the parallel backend cannot serve
    except (laspy.errors.LaspyException, RuntimeError, ValueError):
        reader = laspy.open(open_binary(path), laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False)
        guard = captured_panics
    with reader:
        yield reader, guard


class ChunkReader:
    """Reads some points of an open file after others; of chunks in between not a byte."""

    def __init__(self, file: BinaryIO, header: laspy.LasHeader) -> None:
        self._file, self._header, self._next = file, header, 0
        self._record = header.vlrs.get("LasZipVlr")[0].record_data
        file.seek(header.offset_to_point_data)
        self._table = lazrs.read_chunk_table(file, lazrs.LazVlr(self._record))
        counts, sizes = np.array(self._table, dtype=np.int64).reshape(-1, 2).T
        #: First point of each chunk, and where it begins in the file; the last is what is behind all.
        self.first: NDArray[np.int64] = np.concatenate([[0], np.cumsum(counts)])
        self.begin: NDArray[np.int64] = np.concatenate([[0], np.cumsum(sizes)])
        self.begin += header.offset_to_point_data + _BEFORE_CHUNKS

    def seek(self, point: int) -> None:
        """Go to a point."""
        self._next = point

    def read_points(self, count: int) -> laspy.ScaleAwarePointRecord:
        """Read the next points, at most as many as there are."""
        header, start = self._header, self._next
        end = self._next = int(min(start + count, self.first[-1]))
        chunk, behind = np.searchsorted(self.first, [start, end], side="right") - 1
        behind += end > self.first[behind]
        self._file.seek(self.begin[chunk])
        packed = self._file.read(int(self.begin[behind] - self.begin[chunk]))
        points = np.empty(int(self.first[behind] - self.first[chunk]) * header.point_format.size, np.uint8)
        self._decompress(packed, points, self._table[chunk:behind])
        record = laspy.PackedPointRecord.from_buffer(points, header.point_format)
        rows = record.array[start - self.first[chunk] : end - self.first[chunk]]
        return laspy.ScaleAwarePointRecord(rows, header.point_format, header.scales, header.offsets)

    def _decompress(self, packed: bytes, points: NDArray[np.uint8], table: list[tuple[int, int]]) -> None:
        """Decompress chunks, by several threads but in a process that may not have those of lazrs."""
        if laz_backend() is laspy.LazBackend.LazrsParallel:
            lazrs.decompress_points_with_chunk_table(packed, self._record, points, table)
            return
        alone = BytesIO()  # the chunks as if they were the points of a whole file
        alone.write(struct.pack("<q", _BEFORE_CHUNKS + len(packed)) + packed)
        lazrs.write_chunk_table(alone, table, lazrs.LazVlr(self._record))
        alone.seek(0)
        lazrs.LasZipDecompressor(alone, self._record).decompress_many(points)


@contextmanager
def _open_chunks(path: Path, header: laspy.LasHeader) -> Iterator[tuple[ChunkReader, Any]]:
    with open_binary(path) as file:
        yield ChunkReader(file, header), captured_panics


_Extent = TypeVar("_Extent", bound="CloudExtent")
#: Points read at a time: about 60 MB with all that is made of them.
CHUNK = 500_000


@dataclass(frozen=True, eq=False)
class CloudExtent:
    """A LAS, LAZ or COPC file by its header."""

    path: Path
    raw: RawHeader  #: header and records byte for byte
    crs: SourceCrs  #: what it says of its coordinates
    #: Bounds in source coordinates; NaN if the file holds no point. Shape (3,).
    mins: NDArray[np.float64]
    maxs: NDArray[np.float64]
    state: tuple[int, int]  #: size [bytes] and time of the last change [ns] when it was opened
    #: What its header or its first points say that can hardly be so.
    remarks: tuple[Remark, ...] = field(default=(), kw_only=True)

    @property
    def point_count(self) -> int:
        """Number of points."""
        return self.raw.point_count

    def in_frame(self: _Extent, frame: MapFrame) -> _Extent:
        """Return the cloud with the units of its survey's frame."""
        units = {"horizontal_unit": frame.horizontal_unit, "vertical_unit": frame.vertical_unit}
        return replace(self, crs=replace(self.crs, **units))

    @property
    def units(self) -> NDArray[np.float64]:
        """Metres per source unit, per axis."""
        return np.array([self.crs.horizontal_unit, self.crs.horizontal_unit, self.crs.vertical_unit])


@dataclass(frozen=True, eq=False)
class Cloud(CloudExtent):
    """A checked file, with the `header` of laspy; its bounds hold, unlike those in some headers."""

    header: laspy.LasHeader
    kept: Path | None = None  #: where its points are decoded, once they have been read

    @property
    def input_file(self) -> InputFile:
        """What a run notes of it."""
        (west, south, _), (east, north, _) = (bounds * self.units for bounds in (self.mins, self.maxs))
        area = (float(west), float(south), float(east), float(north)) if self.point_count else None
        return InputFile(self.path, self.point_count, self.state, self.kept, self.remarks, area)

    @property
    def point_count(self) -> int:
        """Number of points."""
        return int(self.header.point_count)

    def chunks(
        self, size: int = CHUNK, first: int = 0, last: int | None = None
    ) -> Iterator[laspy.ScaleAwarePointRecord]:
        """Read points, `size` at a time; InputError if one cannot be read, or the file was changed."""
        run = first, self.point_count if last is None else last
        yield from (points for _, points in self.runs([run], size))

    def runs(
        self, runs: Sequence[tuple[int, int]], size: int = CHUNK
    ) -> Iterator[tuple[int, laspy.ScaleAwarePointRecord]]:
        """
        Read points from one to another (exclusive), time and again, as `chunks` and with its errors.

        Yields the place in the file of the first point, and at most `size` points.
        """
        check_unchanged(self.input_file)
        if self.kept is not None and self.kept.exists():
            form, scaling = self.header.point_format, (self.header.scales, self.header.offsets)
            for done, end in runs:
                for first in range(done, end, size):
                    at, n = first * form.size, min(size, end - first)
                    rows = np.fromfile(self.kept, form.dtype(), n, offset=at)
                    yield first, laspy.ScaleAwarePointRecord(rows, form, *scaling)
            check_unchanged(self.input_file)
            return
        is_plain = self.raw.has_equal_chunks or all(first == 0 for first, _ in runs)
        opened = open_reader(self.path) if is_plain else _open_chunks(self.path, self.header)
        with reported(self.path), opened as (reader, guard):
            for done, end in runs:
                if done:
                    with guard():
                        reader.seek(done)
                while done < end:
                    with guard():
                        points = reader.read_points(min(size, end - done))
                    if len(points) == 0:
                        raise InputError(
                            f"{self.path}: is truncated ({done} of {self.point_count} points): copy it again"
                        )
                    yield done, points
                    done += len(points)
        check_unchanged(self.input_file)
