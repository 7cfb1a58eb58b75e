"""An input file written again with its classification and the new dimensions."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.clouds.classified_header import (
    DIMENSIONS,
    OutputFormat,
    is_kept,
    output_format,
    with_length,
)
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las_reader import laz_backend
from lidar_buildings.io.clouds.las_records import EVLR_HEADER, RawHeader
from lidar_buildings.io.clouds.point_columns import FIRST_EXTENDED_FORMAT
from lidar_buildings.io.files.atomic_files import checked_file
from lidar_buildings.io.files.locations import open_binary

#: Bits of the class in the class byte of point formats 0 to 5; above stand the flags.
_LEGACY_CLASS = 0x1F
#: Formats with waveforms beside scanner channels; lazrs mixes up their waveforms when the channel changes.
_WAVEFORM_FORMATS = (9, 10)
_CHANNEL_BITS = 0x30
_COPY_BLOCK = 1 << 20

# places in the header (LAS 1.4, table 3)
_SYSTEM, _DAY_END = 26, 94
_HEADER_SIZE = 94
_LEGACY_COUNTS = 107

#: Returns the results of the input's rows first to last, as `point_results.RESULT`.
ResultRows = Callable[[int, int], NDArray[Any]]


def suffix_for(cloud: Cloud) -> str:
    """Return the output's ending: ``.laz``, or ``.las`` for the rare waveforms that LAZ would not keep."""
    if cloud.header.point_format.id not in _WAVEFORM_FORMATS:
        return ".laz"
    channels = {
        int(c) for chunk in cloud.chunks() for c in np.unique(chunk["classification_flags"] & _CHANNEL_BITS)
    }
    return ".laz" if len(channels) <= 1 else ".las"


def write_classified(
    cloud: Cloud,
    rows: ResultRows,
    path: Path,
    on_chunk: Callable[[int, NDArray[Any]], None] = lambda first, points: None,
) -> NDArray[np.int64]:
    """
    Write every point of the input in its order, with all its dimensions and records; return points per class.

    Points that no tile gave back (`known` = 0) keep their class and have no height (NaN); points that the
    file withholds keep their class. `rows` gives the results of a range of points; `on_chunk` is told, part
    by part, the place of the first point and the points as they are written. InputError or OutputError if the
    input cannot be read to its end, or the output not be written.
    """
    out = output_format(cloud)
    per_class = np.zeros(256, dtype=np.int64)
    with checked_file(path) as file:
        writer = laspy.LasWriter(
            file, out.header, do_compress=path.suffix == ".laz", laz_backend=laz_backend(), closefd=False
        )
        first = 0
        for chunk in cloud.chunks():
            points = _classified(chunk, rows(first, first + len(chunk)), out, cloud)
            per_class += np.bincount(_classes(points, cloud), minlength=256)
            writer.write_points(laspy.PackedPointRecord(points, writer.header.point_format))
            on_chunk(first, points)
            first += len(chunk)
        _finish(writer, file, cloud)
        _restore_header(file, cloud.raw, out, writer.header)
        file.flush()
    return per_class


def _classified(
    chunk: laspy.ScaleAwarePointRecord, results: NDArray[Any], out: OutputFormat, cloud: Cloud
) -> NDArray[Any]:
    points = np.zeros(len(chunk), out.dtype)
    size = chunk.array.dtype.itemsize
    points.view(np.uint8).reshape(len(points), -1)[:, :size] = chunk.array.view(np.uint8).reshape(
        len(points), -1
    )
    known = results["known"].astype(bool)
    decided = known & ~np.asarray(chunk.withheld, dtype=bool)
    if cloud.header.point_format.id < FIRST_EXTENDED_FORMAT:
        byte = points["raw_classification"]
        classes = results["classification"] & _LEGACY_CLASS
        points["raw_classification"] = np.where(decided, byte & ~np.uint8(_LEGACY_CLASS) | classes, byte)
    else:
        points["classification"] = np.where(decided, results["classification"], points["classification"])
    for column, dimension in DIMENSIONS.items():
        points[dimension.name] = results[column]
    height = results["height_above_ground"] / np.float32(cloud.crs.vertical_unit)
    points[DIMENSIONS["height_above_ground"].name] = np.where(known, height, np.float32(np.nan))
    return points


def _classes(points: NDArray[Any], cloud: Cloud) -> NDArray[np.uint8]:
    if cloud.header.point_format.id < FIRST_EXTENDED_FORMAT:
        return np.asarray(points["raw_classification"] & _LEGACY_CLASS)
    return np.asarray(points["classification"])


def _finish(writer: laspy.LasWriter, file: Any, cloud: Cloud) -> None:
    """End the points, copy the extended records behind them, and write the final header."""
    writer.point_writer.done()
    writer.done = True
    header = writer.header
    kept = [record for record in cloud.raw.evlrs if is_kept(record)]
    starts = {}
    with open_binary(cloud.path) as source:
        for record in kept:
            starts[record.start - EVLR_HEADER] = file.seek(0, 2)
            _copy(source, file, record.start - EVLR_HEADER, EVLR_HEADER + record.size)
        waveforms = cloud.raw.waveform_start
        if waveforms and waveforms not in starts:  # LAS 1.3: an extended record that no count announces
            starts[waveforms] = file.seek(0, 2)
            _copy(source, file, waveforms, cloud.path.stat().st_size - waveforms)
    if kept:
        header.number_of_evlrs = len(kept)
        header.start_of_first_evlr = min(starts[record.start - EVLR_HEADER] for record in kept)
    if waveforms:
        header.start_of_waveform_data_packet_record = starts[waveforms]
    writer.close()


def _copy(source: BinaryIO, file: Any, start: int, size: int) -> None:
    source.seek(start)
    while size > 0 and (block := source.read(min(size, _COPY_BLOCK))):
        file.write(block)
        size -= len(block)


def _restore_header(file: BinaryIO, raw: RawHeader, out: OutputFormat, header: laspy.LasHeader) -> None:
    """Put the input's bytes where laspy wrote its own reading of them."""
    file.seek(_HEADER_SIZE)
    (header_size,) = struct.unpack("<H", file.read(2))
    file.seek(_SYSTEM)
    file.write(raw.block[_SYSTEM:_DAY_END])  # system, software, date: as they are, whatever their encoding
    file.seek(header_size)
    file.write(b"".join(with_length(record) for record in out.records))
    is_legacy = header.point_format.id < FIRST_EXTENDED_FORMAT and header.point_count < 2**32
    if header.version.minor >= 4 and is_legacy:
        file.seek(_LEGACY_COUNTS)
        file.write(struct.pack("<6I", header.point_count, *header.number_of_points_by_return[:5].tolist()))
