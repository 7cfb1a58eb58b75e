"""An input file written again with its classification and the new dimensions."""

from __future__ import annotations

import copy
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.io.clouds.cloud import Cloud, laz_backend
from lidar_buildings.io.clouds.doubts import CloudDoubts
from lidar_buildings.io.clouds.las_records import EVLR_HEADER, RawHeader, RawRecord
from lidar_buildings.io.clouds.point_columns import FIRST_EXTENDED_FORMAT
from lidar_buildings.io.files.atomic_files import checked_file
from lidar_buildings.io.files.locations import open_binary

_EXTRA_BYTES = (b"LASF_Spec", 4)
#: One entry of the extra bytes record (LAS 1.4, table 24): data type, options, name, …, description.
_ENTRY = struct.Struct("<2xBB32s124x32s")
_NAME_AT, _NAME_SIZE = 4, 32
#: Records that would be wrong in the output: how the input was compressed, and COPC's index.
_NOT_KEPT = ((b"laszip encoded", 22204), (b"copc", 1), (b"copc", 1000))
#: The oldest version that laspy writes; it differs from LAS 1.0 in its number alone.
_OLDEST = 1


class _Dimension(NamedTuple):
    """A dimension that the output has more than the input."""

    name: str
    kind: str
    las_type: int
    description: str


#: Column of the results → dimension of the file; LAS type numbers by LAS 1.4, table 25.
DIMENSIONS = {
    "height_above_ground": _Dimension("HeightAboveGround", "<f4", 9, "height above ground, unit of z"),
    "facade": _Dimension("Facade", "u1", 1, "1 = below a roof, 2 = bare wall"),
    "building_id": _Dimension("BuildingId", "<u4", 5, "0 = none"),
    "plane_id": _Dimension("PlaneId", "<u2", 3, "0 = none, within the building"),
    "edge": _Dimension("EdgeLabel", "u1", 1, "1 = on a roof's edge"),
}


class OutputFormat(NamedTuple):
    """How a classified file's points and header are made from the input's."""

    header: laspy.LasHeader  #: for the writer; texts and records in it are placeholders of the true size
    records: tuple[RawRecord, ...]  #: the plain records, byte for byte; the extra bytes record completed
    #: Of an output point: the input's bytes first, whatever they are called, then the new dimensions.
    dtype: np.dtype[Any]


def is_kept(record: RawRecord) -> bool:
    """Whether a record of the input still holds true in the output."""
    return (record.user_id, record.record_id) not in _NOT_KEPT


def output_format(cloud: Cloud) -> OutputFormat:
    """
    Derive the output's header from the input's.

    A dimension that the input has under one of the new names is written over if its type is the same, as
    `classification` is; otherwise it stays, under another name.
    """
    header = copy.deepcopy(cloud.header)
    names, missing = _names(header.point_format)
    point_format = laspy.PointFormat(header.point_format.id)
    extra = list(header.point_format.extra_dimensions)
    point_format.dimensions.extend(d._replace(name=names[d.name]) for d in extra)
    for dimension in missing:
        point_format.add_extra_dimension(laspy.ExtraBytesParams(dimension.name, dimension.kind))
    header.set_version_and_point_format(written_version(header), point_format)
    header.system_identifier = header.generating_software = ""  # laspy refuses other than ASCII
    records = _with_entries(cloud, names, missing)
    # of the same size: the true bytes are put in their place afterwards
    header.vlrs[:] = [laspy.VLR("kept", record.record_id, "", record.data) for record in records]
    return OutputFormat(header, records, point_format.dtype())


def _names(point_format: laspy.PointFormat) -> tuple[dict[str, str], list[_Dimension]]:
    """Return the output's name of each of the input's extra dimensions, and the new ones that it lacks."""
    kinds = {d.name: np.dtype(d.type_str()) for d in point_format.extra_dimensions}
    scaled = {d.name for d in point_format.extra_dimensions if d.is_scaled}
    names = {name: name for name in kinds}
    missing = []
    for dimension in DIMENSIONS.values():
        if kinds.get(dimension.name) == np.dtype(dimension.kind) and dimension.name not in scaled:
            continue
        missing.append(dimension)
        if dimension.name in names:
            numbered = (f"{dimension.name}_{n}" for n in range(1, len(kinds) + 2))
            names[dimension.name] = next(free for free in numbered if free not in kinds)
    return names, missing


def written_version(header: laspy.LasHeader) -> laspy.header.Version:
    """Return the input's version, or the lowest above it that laspy may write with the point format."""
    major, minor = header.version.major, max(header.version.minor, _OLDEST)
    allowed = laspy.point.dims.VERSION_TO_POINT_FMT
    while header.point_format.id not in allowed.get(f"{major}.{minor}", ()):
        minor += 1
    return laspy.header.Version(major, minor)


def _with_entries(
    cloud: Cloud, names: dict[str, str], missing: Sequence[_Dimension]
) -> tuple[RawRecord, ...]:
    """Return the input's records with entries for the bytes that none describes, and for what is new."""
    own = cloud.header.point_format
    documented = [d for d in own.extra_dimensions if d.description != "Un-registered ExtraBytes"]
    undocumented = cloud.raw.record_size - own.num_standard_bytes - sum(d.num_bytes for d in documented)
    kept = [record for record in cloud.raw.vlrs if is_kept(record)]
    place = next((i for i, record in enumerate(kept) if record.is_a(*_EXTRA_BYTES)), None)
    data = kept[place].data if place is not None and documented else b""
    data = b"".join(_renamed(data[at : at + _ENTRY.size], names) for at in range(0, len(data), _ENTRY.size))
    for start in range(0, undocumented, 255):
        size = min(255, undocumented - start)
        data += _ENTRY.pack(0, size, f"ExtraBytes{start or ''}".encode(), b"undocumented in the input")
    for dimension in missing:
        data += _ENTRY.pack(dimension.las_type, 0, dimension.name.encode(), dimension.description.encode())
    user_id, record_id = _EXTRA_BYTES
    head = kept[place].head if place is not None else struct.pack("<2x16sHH32s", user_id, record_id, 0, b"")
    entries = RawRecord(user_id, record_id, head, 0, len(data), data)
    if place is None:
        return (*kept, entries)
    return (*kept[:place], entries, *kept[place + 1 :])


def _renamed(entry: bytes, names: dict[str, str]) -> bytes:
    name = entry[_NAME_AT : _NAME_AT + _NAME_SIZE].split(b"\0")[0].decode(errors="replace")
    if names.get(name, name) == name:
        return entry
    renamed = names[name].encode()[:_NAME_SIZE].ljust(_NAME_SIZE, b"\0")
    return entry[:_NAME_AT] + renamed + entry[_NAME_AT + _NAME_SIZE :]


#: Bits of the class in the class byte of point formats 0 to 5; above stand the flags.
_LEGACY_CLASS = 0x1F
#: Formats with waveforms beside scanner channels; lazrs mixes up their waveforms when the channel changes.
_WAVEFORM_FORMATS = (9, 10)
_COPY_BLOCK = 1 << 20

# places in the header (LAS 1.4, table 3)
_SYSTEM, _DAY_END = 26, 94
_HEADER_SIZE = 94
_LEGACY_COUNTS = 107

#: Returns the results of the input's rows first to last, as `point_results.RESULT`.
ResultRows = Callable[[int, int], NDArray[Any]]


def suffix_for(cloud: Cloud) -> str:
    """Return the output's ending: ``.laz``, or ``.las`` for formats whose waveforms LAZ may not keep."""
    return ".las" if cloud.header.point_format.id in _WAVEFORM_FORMATS else ".laz"


def write_classified(
    cloud: Cloud, rows: ResultRows, path: Path, doubts: CloudDoubts | None = None
) -> NDArray[np.int64]:
    """
    Write every point of the input in its order, with all its dimensions and records; return points per class.

    Points that no tile gave back (`known` = 0) keep their class and have no height (NaN); points that the
    file withholds keep their class. `rows` gives the results of a range of points, into which it is written
    that points which `doubts` finds beyond its frame are noise. InputError or OutputError if the input cannot
    be read to its end, or the output not be written.
    """
    out = output_format(cloud)
    per_class = np.zeros(256, dtype=np.int64)
    with checked_file(path) as file:
        writer = laspy.LasWriter(
            file, out.header, do_compress=path.suffix == ".laz", laz_backend=laz_backend(), closefd=False
        )
        first = 0
        for chunk in cloud.chunks():
            results = rows(first, first + len(chunk))
            if doubts is not None and (beyond := doubts.add(chunk)) is not None:
                results["known"][beyond] = 1
                results["classification"][beyond] = PointClass.LOW_NOISE
                results["height_above_ground"][beyond] = np.nan
            points = _classified(chunk, results, out, cloud)
            per_class += np.bincount(_classes(points, cloud), minlength=256)
            writer.write_points(laspy.PackedPointRecord(points, writer.header.point_format))
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
    given = chunk.array.view(np.uint8).reshape(len(points), -1)
    points.view(np.uint8).reshape(len(points), -1)[:, :size] = given
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
    for record in out.records:
        file.write(record.head[:20] + struct.pack("<H", len(record.data)) + record.head[22:] + record.data)
    is_legacy = header.point_format.id < FIRST_EXTENDED_FORMAT and header.point_count < 2**32
    if header.version.minor >= 4 and is_legacy:
        file.seek(_LEGACY_COUNTS)
        file.write(struct.pack("<6I", header.point_count, *header.number_of_points_by_return[:5].tolist()))
