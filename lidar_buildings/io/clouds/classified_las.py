"""An input file written again with its classification and the new dimensions."""

from __future__ import annotations

import copy
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.io.clouds.cloud import Cloud, laz_backend
from lidar_buildings.io.clouds.doubts import CloudDoubts
from lidar_buildings.io.clouds.las_records import EVLR_HEADER, RawHeader, RawRecord
from lidar_buildings.io.clouds.point_columns import FIRST_EXTENDED_FORMAT, VIEW
from lidar_buildings.io.files.atomic_files import checked_file
from lidar_buildings.io.files.locations import open_binary

_EXTRA_BYTES = (b"LASF_Spec", 4)
#: One entry of the extra bytes record (LAS 1.4, table 24): data type, options, name, …, description.
_ENTRY = struct.Struct("<2xBB32s124x32s")
_NAME_AT, _NAME_SIZE = 4, 32
#: Records that would be wrong in the output: how the input was compressed, and COPC's index.
_NOT_KEPT = ((b"laszip encoded", 22204), (b"copc", 1), (b"copc", 1000))
#: Descriptors of waveforms (LAS 1.4, table 26).
_WAVEFORM_RECORDS = range(100, 356)
#: Format with waveforms → the same without; waveforms' bytes are the last of the standard ones.
_WITHOUT_WAVEFORMS = {4: 1, 5: 3, 9: 6, 10: 8}
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
#: What a file has beside that if points were seen from the street.
_VIEW = {"view": _Dimension(VIEW, "u1", 1, "1 = above, 2 = street, 3 = both")}


class OutputFormat(NamedTuple):
    """How a classified file's points and header are made from the input's."""

    header: laspy.LasHeader  #: for the writer; texts and records in it are placeholders of the true size
    records: tuple[RawRecord, ...]  #: the plain records, byte for byte; the extra bytes record completed
    #: Of an output point: the input's bytes first, whatever they are called, then the new dimensions.
    dtype: np.dtype[Any]
    left_out: slice  #: bytes of an input's point that an output's lacks


def has_far_waveforms(cloud: Cloud) -> bool:
    """Whether points refer to waveforms in another file, which is not beside the output."""
    return cloud.header.point_format.id in _WITHOUT_WAVEFORMS and bool(
        cloud.header.global_encoding.waveform_data_packets_external
    )


def is_kept(record: RawRecord, *, with_waveforms: bool = True) -> bool:
    """Whether a record of the input still holds true in the output."""
    is_descriptor = record.user_id == _EXTRA_BYTES[0] and record.record_id in _WAVEFORM_RECORDS
    is_lost = is_descriptor and not with_waveforms
    return not is_lost and (record.user_id, record.record_id) not in _NOT_KEPT


def output_format(cloud: Cloud, dimensions: Mapping[str, _Dimension]) -> OutputFormat:
    """
    Derive the output's header from the input's, with dimensions by column of the results.

    A dimension that the input has under one of the new names is written over if its type is the same, as
    `classification` is; otherwise it stays, under another name. References to waveforms in another file do
    not stay.
    """
    header = copy.deepcopy(cloud.header)
    names, missing = _names(header.point_format, dimensions.values())
    number, size = header.point_format.id, header.point_format.num_standard_bytes
    left_out = slice(size, size)
    if has_far_waveforms(cloud):
        number = _WITHOUT_WAVEFORMS[number]
        left_out = slice(laspy.PointFormat(number).num_standard_bytes, size)
        header.global_encoding.waveform_data_packets_external = False
        header.start_of_waveform_data_packet_record = 0
    point_format = laspy.PointFormat(number)
    extra = list(header.point_format.extra_dimensions)
    point_format.dimensions.extend(d._replace(name=names[d.name]) for d in extra)
    for dimension in missing:
        point_format.add_extra_dimension(laspy.ExtraBytesParams(dimension.name, dimension.kind))
    header.set_version_and_point_format(written_version(header.version, number), point_format)
    header.system_identifier = header.generating_software = ""  # laspy refuses other than ASCII
    records = _with_entries(cloud, names, missing)
    # of the same size: the true bytes are put in their place afterwards
    header.vlrs[:] = [laspy.VLR("kept", record.record_id, "", record.data) for record in records]
    return OutputFormat(header, records, point_format.dtype(), left_out)


def _names(
    point_format: laspy.PointFormat, dimensions: Iterable[_Dimension]
) -> tuple[dict[str, str], list[_Dimension]]:
    """Return the output's name of each of the input's extra dimensions, and the new ones that it lacks."""
    kinds = {d.name: np.dtype(d.type_str()) for d in point_format.extra_dimensions}
    scaled = {d.name for d in point_format.extra_dimensions if d.is_scaled}
    names = {name: name for name in kinds}
    missing = []
    for dimension in dimensions:
        if kinds.get(dimension.name) == np.dtype(dimension.kind) and dimension.name not in scaled:
            continue
        missing.append(dimension)
        if dimension.name in names:
            numbered = (f"{dimension.name}_{n}" for n in range(1, len(kinds) + 2))
            names[dimension.name] = next(free for free in numbered if free not in kinds)
    return names, missing


def written_version(given: laspy.header.Version, point_format: int) -> laspy.header.Version:
    """Return the input's version, or the lowest above it that laspy may write with the point format."""
    major, minor = given.major, max(given.minor, _OLDEST)
    allowed = laspy.point.dims.VERSION_TO_POINT_FMT
    while point_format not in allowed.get(f"{major}.{minor}", ()):
        minor += 1
    return laspy.header.Version(major, minor)


def _with_entries(
    cloud: Cloud, names: dict[str, str], missing: Sequence[_Dimension]
) -> tuple[RawRecord, ...]:
    """Return the input's records with entries for the bytes that none describes, and for what is new."""
    own = cloud.header.point_format
    documented = [d for d in own.extra_dimensions if d.description != "Un-registered ExtraBytes"]
    undocumented = cloud.raw.record_size - own.num_standard_bytes - sum(d.num_bytes for d in documented)
    with_waveforms = not has_far_waveforms(cloud)
    kept = [record for record in cloud.raw.vlrs if is_kept(record, with_waveforms=with_waveforms)]
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
    keeps = cloud.header.point_format.id in _WAVEFORM_FORMATS and not has_far_waveforms(cloud)
    return ".las" if keeps else ".laz"


#: Header bounds that points exceed by so much are wrong: headers round to millimetres [m].
_BOUNDS_TOLERANCE = 1.0
#: Classes that a provider gives → those that this package gives to the same; and which share of so many
#: points may get others before that is said.
_COMPARED = {
    PointClass.GROUND: (PointClass.GROUND, PointClass.WATER, PointClass.ROAD_SURFACE),
    PointClass.BUILDING: (PointClass.BUILDING,),
}
_OTHER_SHARE, _N_COMPARED = 0.2, 1000


class ClassifiedCloud:
    """What was written: `per_class`, points of each class, shape (256,), and what the input says wrongly."""

    def __init__(self, cloud: Cloud) -> None:
        self.per_class = np.zeros(256, dtype=np.int64)
        self._cloud = cloud
        self._n_given, self._n_same = np.zeros((2, len(_COMPARED)), dtype=np.int64)
        self._beyond = 0.0  # [m]

    def add(self, chunk: laspy.ScaleAwarePointRecord, classes: NDArray[np.uint8]) -> None:
        """Take points of the input, and their classes in the output."""
        self.per_class += np.bincount(classes, minlength=256)
        given = np.asarray(chunk.classification)
        for number, (one, same) in enumerate(_COMPARED.items()):
            own = given == one
            self._n_given[number] += np.count_nonzero(own)
            self._n_same[number] += np.count_nonzero(np.isin(classes[own], same))
        ends = np.array([[chunk.array[name].min(), chunk.array[name].max()] for name in "XYZ"], np.float64)
        places = np.sort(ends * chunk.scales[:, None] + chunk.offsets[:, None], axis=1)
        limits, units = self._cloud, self._cloud.units
        beyond = np.stack([limits.mins - places[:, 0], places[:, 1] - limits.maxs]) * units
        self._beyond = max(self._beyond, float(beyond.max()))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What the input says that is not so, or left out of the output."""
        told, path = [], self._cloud.path
        if self._beyond > _BOUNDS_TOLERANCE:
            text = (
                f"{path}: points lie up to {self._beyond:.1f} m outside the bounds in its header: buildings "
                "there may be cut where files meet: write the header anew"
            )
            told.append(Remark("header_bounds", text))
        counts = zip(_COMPARED, self._n_given.tolist(), self._n_same.tolist(), strict=True)
        for one, n_given, n_same in counts:
            if n_given >= _N_COMPARED and n_given - n_same > _OTHER_SHARE * n_given:
                share = 100.0 * (n_given - n_same) / n_given
                text = (
                    f"{path}: {share:.0f} % of its {n_given:,} points of class {one.value} "
                    f"({one.name.lower()}) have another class in the result: compare both in places (classes "
                    "of the input do not count; ground_filter.kept_classes says which do)"
                )
                told.append(Remark("other_classes", text))
        if has_far_waveforms(self._cloud):
            text = f"{path}: its waveforms are in another file: the classified cloud refers to none"
            told.append(Remark("waveforms_left_out", text))
        return tuple(told)


def write_classified(
    cloud: Cloud,
    rows: ResultRows,
    path: Path,
    doubts: CloudDoubts | None = None,
    *,
    has_views: bool = False,
) -> ClassifiedCloud:
    """
    Write every point of the input in its order, with all its dimensions and records.

    Points that no tile gave back (`known` = 0) keep their class and have no height (NaN); points that the
    file withholds keep their class. `rows` gives the results of a range of points, into which it is written
    that points which `doubts` finds beyond its frame are noise; with `has_views` from where each was seen.
    InputError or OutputError if the input cannot
    be read to its end, or the output not be written.
    """
    dimensions = DIMENSIONS | _VIEW if has_views else DIMENSIONS
    out, written = output_format(cloud, dimensions), ClassifiedCloud(cloud)

    def classified() -> Iterator[NDArray[Any]]:
        first = 0
        for chunk in cloud.chunks():
            results = rows(first, first + len(chunk))
            if doubts is not None and (beyond := doubts.add(chunk)) is not None:
                results["known"][beyond] = 1
                results["classification"][beyond] = PointClass.LOW_NOISE
                results["height_above_ground"][beyond] = np.nan
            points = _classified(chunk, results, out, cloud, dimensions)
            written.add(chunk, _classes(points, cloud))
            yield points
            first += len(chunk)

    _write(cloud, out, classified(), path)
    return written


def write_changed(cloud: Cloud, change: Callable[[laspy.ScaleAwarePointRecord], None], path: Path) -> None:
    """
    Write every point of the input in its order, with all its dimensions and records, changed in place.

    InputError or OutputError as by `write_classified`.
    """
    out = output_format(cloud, {})

    def changed() -> Iterator[NDArray[Any]]:
        for chunk in cloud.chunks():
            change(chunk)
            yield _copied(chunk, out)

    _write(cloud, out, changed(), path)


def _write(cloud: Cloud, out: OutputFormat, blocks: Iterable[NDArray[Any]], path: Path) -> None:
    with checked_file(path) as file:
        writer = laspy.LasWriter(
            file, out.header, do_compress=path.suffix == ".laz", laz_backend=laz_backend(), closefd=False
        )
        for points in blocks:
            writer.write_points(laspy.PackedPointRecord(points, writer.header.point_format))
        _finish(writer, file, cloud)
        _restore_header(file, cloud.raw, out, writer.header)
        file.flush()


def _copied(chunk: laspy.ScaleAwarePointRecord, out: OutputFormat) -> NDArray[Any]:
    points = np.zeros(len(chunk), out.dtype)
    given = chunk.array.view(np.uint8).reshape(len(points), -1)
    written = points.view(np.uint8).reshape(len(points), -1)
    first, behind = out.left_out.start, out.left_out.stop
    written[:, :first] = given[:, :first]
    written[:, first : given.shape[1] - behind + first] = given[:, behind:]
    return points


def _classified(
    chunk: laspy.ScaleAwarePointRecord,
    results: NDArray[Any],
    out: OutputFormat,
    cloud: Cloud,
    dimensions: Mapping[str, _Dimension],
) -> NDArray[Any]:
    points = _copied(chunk, out)
    known = results["known"].astype(bool)
    decided = known & ~np.asarray(chunk.withheld, dtype=bool)
    if cloud.header.point_format.id < FIRST_EXTENDED_FORMAT:
        byte = points["raw_classification"]
        classes = results["classification"] & _LEGACY_CLASS
        points["raw_classification"] = np.where(decided, byte & ~np.uint8(_LEGACY_CLASS) | classes, byte)
    else:
        points["classification"] = np.where(decided, results["classification"], points["classification"])
    for column, dimension in dimensions.items():
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
    with_waveforms = not has_far_waveforms(cloud)
    kept = [record for record in cloud.raw.evlrs if is_kept(record, with_waveforms=with_waveforms)]
    starts = {}
    with open_binary(cloud.path) as source:
        for record in kept:
            starts[record.start - EVLR_HEADER] = file.seek(0, 2)
            _copy(source, file, record.start - EVLR_HEADER, EVLR_HEADER + record.size)
        waveforms = cloud.raw.waveform_start if with_waveforms else 0
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
