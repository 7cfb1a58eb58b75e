"""
Clouds written as COPC 1.0 (https://copc.io): LAZ in the chunks of an octree that readers fetch one by one.

lazrs compresses the chunks; the tree stands here. copclib, the one library with wheels, only compresses, too,
and laspy reads such files but writes none.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

import laspy
import lazrs
import numpy as np
import pyproj
from laspy.vlrs.known import LasZipVlr
from numpy.typing import NDArray

from lidar_buildings import __version__
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import xyz_of
from lidar_buildings.io.clouds.las_crs import vertical_crs
from lidar_buildings.io.clouds.octree import SAMPLE_BITS, Cube, Node, cells_of, nodes_of
from lidar_buildings.io.clouds.point_columns import SCAN_ANGLE_STEP
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.reference_systems import with_heights

#: Point format of the input → the one that COPC allows and that has its dimensions.
_FORMATS = {0: 6, 1: 6, 2: 7, 3: 7, 6: 6, 7: 7, 8: 8}
#: Points that are held at a time, one cell of the tree (some 300 MB).
_LARGEST = 4_000_000
#: Deepest level whose cells are counted for that.
_DEEPEST_CELLS = 7
_INFO = struct.Struct("<5d2Q2d88x")
_ENTRY = struct.Struct("<4iQ2i")
_EVLR = struct.Struct("<2x16sHQ32s")
#: Where the info record's data begin: behind the header and its own (COPC 1.0).
_INFO_AT = 375 + 54


def write_copc(cloud: Cloud, path: Path) -> None:
    """
    Write a cloud's points in the order of an octree, with all dimensions and plain records.

    The points go through a temporary file beside it, cell by cell of the tree, so that memory holds those of
    one. Formats 0 to 3 become 6 or 7. InputError or OutputError if the cloud has waveforms or cannot be read
    to its end, or the output not be written.
    """
    if cloud.header.point_format.id not in _FORMATS:
        raise InputError(f"{cloud.path}: has waveforms, which COPC cannot hold: set model_writer.copc=false")
    with atomic_file(path) as temporary, TemporaryFile(dir=path.parent) as scratch:
        header = _header(cloud)
        cube = Cube.around(cloud.mins, cloud.maxs) if cloud.point_count else Cube(np.zeros(3), 1.0)
        cells = _Cells.of(cloud, cube)
        _sort(cloud, header, cube, cells, scratch)
        with open(temporary, "wb+") as file:
            _write(file, header, cube, _chunks(scratch, header, cube, cells))


@dataclass(frozen=True, eq=False)
class _Cells:
    """Nodes of one level, each with few enough points, in the order of their codes."""

    depth: int
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, cloud: Cloud, cube: Cube) -> _Cells:
        counts = np.zeros(8**_DEEPEST_CELLS, dtype=np.int64)
        for chunk in cloud.chunks():
            own = cells_of(cube.codes(xyz_of(chunk)), _DEEPEST_CELLS)
            counts += np.bincount(own, minlength=len(counts))
        at_level = [counts.reshape(8**depth, -1).sum(axis=1) for depth in range(_DEEPEST_CELLS + 1)]
        depth = next((d for d, own in enumerate(at_level) if own.max() <= _LARGEST), _DEEPEST_CELLS)
        return cls(depth, at_level[depth])


def _header(cloud: Cloud) -> laspy.LasHeader:
    """Return the output's header without counts; its first record is the info, its second is lazrs's."""
    header = cloud.header.copy()
    point_format = laspy.PointFormat(_FORMATS[header.point_format.id])
    point_format.dimensions.extend(header.point_format.extra_dimensions)
    header.set_version_and_point_format(laspy.header.Version(1, 4), point_format)
    header.partial_reset()
    header.start_of_waveform_data_packet_record = 0
    header.system_identifier, header.generating_software = "", f"lidar_buildings {__version__}"
    header.are_points_compressed = True
    kept = [one for one in header.vlrs if one.user_id not in ("copc", "laszip encoded")]
    vlr = lazrs.LazVlr.new_for_compression(point_format.id, point_format.num_extra_bytes, True)
    info = laspy.VLR("copc", 1, "COPC info", bytes(_INFO.size))
    header.vlrs[:] = [info, LasZipVlr(vlr.record_data()), *kept]
    if cloud.crs.name:
        vertical = vertical_crs(cloud.raw.vlrs + cloud.raw.evlrs)
        name = cloud.crs.name if vertical is None else with_heights(cloud.crs.name, vertical)
        header.add_crs(pyproj.CRS.from_user_input(name))
    return header


def _sort(cloud: Cloud, header: laspy.LasHeader, cube: Cube, cells: _Cells, scratch: BinaryIO) -> None:
    """Put the points into a file cell by cell, each cell's in the order of the cloud; count them."""
    size = header.point_format.size
    ends = np.cumsum(cells.counts) - cells.counts
    for chunk in cloud.chunks():
        points = _converted(chunk, header.point_format)
        header.grow(points)
        own = cells_of(cube.codes(xyz_of(chunk)), cells.depth)
        order = np.argsort(own, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(own[order])) + 1):
            cell = own[rows[0]]
            scratch.seek(int(ends[cell]) * size)
            scratch.write(points.array[rows].tobytes())
            ends[cell] += len(rows)


def _converted(chunk: laspy.ScaleAwarePointRecord, point_format: laspy.PointFormat) -> Any:
    """Return points in the output's format."""
    points = laspy.PackedPointRecord.from_point_record(chunk, point_format)
    if "scan_angle_rank" in chunk.point_format.dimension_names:
        steps = np.asarray(chunk["scan_angle_rank"]) / SCAN_ANGLE_STEP
        points["scan_angle"] = np.rint(steps).astype(np.int16)
    return points


def _chunks(
    scratch: BinaryIO, header: laspy.LasHeader, cube: Cube, cells: _Cells
) -> Iterator[tuple[Node, NDArray[Any]]]:
    """Yield each node's points; nodes above the cells when the last of their cells has been read."""
    above: dict[Node, list[NDArray[Any]]] = {}
    dtype = header.point_format.dtype()
    scratch.seek(0)
    for cell in np.flatnonzero(cells.counts).tolist():
        for node in sorted(above):
            if cell >> 3 * (cells.depth - node.level) != node.code:
                yield node, np.concatenate(above.pop(node))
        points = np.frombuffer(scratch.read(int(cells.counts[cell]) * dtype.itemsize), dtype)
        steps = np.column_stack([points[name] for name in "XYZ"])
        codes = cube.codes(steps * header.scales + header.offsets)
        for node, rows in nodes_of(codes, cells.depth):
            if node.level < cells.depth:
                above.setdefault(node, []).append(points[rows])
            else:
                yield node, points[rows]
    for node in sorted(above):
        yield node, np.concatenate(above[node])


def _write(
    file: BinaryIO, header: laspy.LasHeader, cube: Cube, chunks: Iterable[tuple[Node, NDArray[Any]]]
) -> None:
    """Write header, chunks, and the tree behind them."""
    header.write_to(file, encoding_errors="ignore")
    vlr = lazrs.LazVlr(header.vlrs[1].record_data)
    compressor = lazrs.LasZipCompressor(file, vlr)
    compressor.reserve_offset_to_chunk_table()
    nodes = []
    for node, points in chunks:
        compressor.compress_many(points.tobytes())
        compressor.finish_current_chunk()
        nodes.append((node, len(points)))
    compressor.done()
    file.seek(header.offset_to_point_data)
    sizes = [size for _, size in lazrs.read_chunk_table(file, vlr)]
    at = header.offset_to_point_data + struct.calcsize("<q")
    entries = []
    for (node, count), size in zip(nodes, sizes, strict=False):
        entries.append(_ENTRY.pack(node.level, *node.place, at, size, count))
        at += size
    page = b"".join(sorted(entries))
    header.start_of_first_evlr, header.number_of_evlrs = file.seek(0, 2), 1
    file.write(_EVLR.pack(b"copc", 1000, len(page), b"COPC hierarchy") + page)
    _finish(file, header, cube, len(page))


def _finish(file: BinaryIO, header: laspy.LasHeader, cube: Cube, page_size: int) -> None:
    """Write the header again, with counts and bounds, and the info record."""
    times = (header.min_gps_time, header.max_gps_time)
    file.seek(0)
    header.write_to(file, ensure_same_size=True, encoding_errors="ignore")
    info = _INFO.pack(
        *(cube.corner + cube.side / 2.0), cube.side / 2.0, cube.side / 2**SAMPLE_BITS,
        header.start_of_first_evlr + _EVLR.size, page_size, *(times if header.point_count else (0.0, 0.0)),
    )  # fmt: skip
    file.seek(_INFO_AT)
    file.write(info)
