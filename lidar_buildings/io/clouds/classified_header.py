"""The header of a classified file: the input's own, with four dimensions more."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import laspy
import numpy as np

from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las_records import RawRecord

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


@dataclass(frozen=True, eq=False)
class OutputFormat:
    """How a classified file's points and header are made from the input's."""

    #: To be given to the writer; texts and records in it are placeholders of the true size.
    header: laspy.LasHeader
    records: tuple[RawRecord, ...]  #: the plain records, byte for byte; the extra bytes record completed
    #: Of an output point: the input's bytes first, whatever they are called, then the new dimensions.
    dtype: np.dtype[Any]


def is_kept(record: RawRecord) -> bool:
    """Whether a record of the input still holds true in the output."""
    return not any(record.is_a(*identity) for identity in _NOT_KEPT)


def output_format(cloud: Cloud) -> OutputFormat:
    """
    Derive the output's header from the input's.

    A dimension that the input has under one of the new names is written over if its type is the same, as
    `classification` is; otherwise it stays, under another name.
    """
    header = cloud.header.copy()
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
            names[dimension.name] = _free_name(dimension.name, kinds)
    return names, missing


def _free_name(name: str, taken: Any) -> str:
    return next(free for n in range(1, len(taken) + 2) if (free := f"{name}_{n}") not in taken)


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
    """Return an entry under the output's name of its dimension."""
    name = entry[_NAME_AT : _NAME_AT + _NAME_SIZE].split(b"\0")[0].decode(errors="replace")
    if names.get(name, name) == name:
        return entry
    renamed = names[name].encode()[:_NAME_SIZE].ljust(_NAME_SIZE, b"\0")
    return entry[:_NAME_AT] + renamed + entry[_NAME_AT + _NAME_SIZE :]


def with_length(record: RawRecord) -> bytes:
    """Return a plain record as it stands in a file."""
    return record.head[:20] + struct.pack("<H", len(record.data)) + record.head[22:] + record.data
