"""
Clouds written as COPC 1.0 (https://copc.io): LAZ in the chunks of an octree that readers fetch one by one.

lazrs compresses the chunks; the tree stands here. copclib, the one library with wheels, only compresses, too,
and laspy reads such files but writes none.
"""

from __future__ import annotations

import copy
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO, NamedTuple

import laspy
import lazrs
import numpy as np
import pyproj
from laspy.vlrs.known import LasZipVlr
from numpy.typing import NDArray

from lidar_buildings import __version__
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.cloud import Cloud, CloudExtent
from lidar_buildings.io.clouds.las_crs import vertical_crs
from lidar_buildings.io.clouds.point_columns import SCAN_ANGLE_STEP, xyz_of
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.failures import reported
from lidar_buildings.io.files.locations import open_binary
from lidar_buildings.io.files.reference_systems import with_heights

_INFO_BEGIN = struct.Struct("<5d2Q")
_NODE = np.dtype(
    [("level", "<i4"), ("place", "<i4", 3), ("offset", "<u8"), ("size", "<i4"), ("count", "<i4")]
)
#: Count of an entry that stands for a page of further entries.
_PAGE = -1
#: The smallest squares by which points are counted [m]: tiles and their buffers are several times as wide.
_SQUARE = 100.0


class CopcNodes(NamedTuple):
    """The nodes of an octree that hold points."""

    level: NDArray[np.int32]  #: 0 for the root, shape (n,)
    place: NDArray[np.int32]  #: number of each along x, y and z among those of its level, shape (n, 3)
    #: Where its chunk begins in the file [bytes], and its points, shape (n,).
    offset: NDArray[np.uint64]
    count: NDArray[np.int32]
    corner: NDArray[np.float64]  #: of the root's cube, in source coordinates, shape (3,)
    side: float  #: of the root's cube

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Least and greatest x and y of each node, shape (n, 2, 2)."""
        side = self.side / 2.0**self.level
        low = self.corner[:2] + self.place[:, :2] * side[:, None]
        return np.stack([low, low + side[:, None]], axis=1)

    def touching(self, bounds: Sequence[float]) -> NDArray[np.bool_]:
        """Tell which nodes share a place with bounds (west, south, east, north)."""
        low, high = np.array(bounds, dtype=np.float64).reshape(2, 2)
        return np.asarray(((self.bounds[:, 0] <= high) & (self.bounds[:, 1] >= low)).all(axis=1))

    def squares(self, unit: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return bounds in plan, shape (n, 2, 2), and points of nodes; those below the smallest squares as one.
        """
        deepest = max(0, int(np.log2(max(self.side * unit / _SQUARE, 1.0))))
        below = np.maximum(self.level - deepest, 0)
        keys = np.column_stack([self.level - below, self.place[:, :2] >> below[:, None]])
        found, own = np.unique(keys, axis=0, return_inverse=True)
        whole = self._replace(level=found[:, 0], place=found[:, [1, 2, 2]])
        return whole.bounds, np.bincount(own.ravel(), self.count, len(found))


def read_nodes(cloud: CloudExtent) -> CopcNodes | None:
    """
    Read the hierarchy of a file, None if it is none of COPC, or its hierarchy not that of all its points.

    InputError if the file cannot be read.
    """
    if not cloud.raw.vlrs or not cloud.raw.vlrs[0].is_a(b"copc", 1):
        return None
    *middle, half, _, start, size = _INFO_BEGIN.unpack_from(cloud.raw.vlrs[0].data)
    pages, seen, found = [(start, size)], set(), [np.empty(0, _NODE)]
    with reported(cloud.path), open_binary(cloud.path) as file:
        while pages:
            start, size = pages.pop()
            if start in seen or size % _NODE.itemsize or not 0 < size <= cloud.state[0] - start:
                return None
            seen.add(start)
            file.seek(start)
            entries = np.frombuffer(file.read(size), _NODE)
            is_page = entries["count"] == _PAGE
            pages += [(int(one["offset"]), int(one["size"])) for one in entries[is_page]]
            found.append(entries[entries["count"] > 0])
    nodes = np.concatenate(found)
    if nodes["count"].sum() != cloud.point_count:
        return None
    columns = (nodes[name] for name in ("level", "place", "offset", "count"))
    return CopcNodes(*columns, np.array(middle) - half, 2.0 * half)


def runs_touching(cloud: CloudExtent, bounds: Sequence[float]) -> list[tuple[int, int]]:
    """
    Return which points of a file have to be read for those in bounds, as first ones and ends of runs.

    Of COPC these are the nodes that touch west, south, east and north, of others all. InputError if the file
    cannot be read.
    """
    if not cloud.point_count or (cloud.maxs[:2] < bounds[:2]).any() or (cloud.mins[:2] > bounds[2:]).any():
        return []
    nodes = read_nodes(cloud)
    if nodes is None:
        return [(0, cloud.point_count)]
    order = np.argsort(nodes.offset)
    ends = np.cumsum(nodes.count[order], dtype=np.int64)
    is_near = np.concatenate([[False], nodes.touching(bounds)[order], [False]])
    begins, stops = (np.flatnonzero(is_near[1:] & ~is_near[:-1]), np.flatnonzero(~is_near[1:] & is_near[:-1]))
    return [
        (int(ends[a] - nodes.count[order[a]]), int(ends[b - 1])) for a, b in zip(begins, stops, strict=True)
    ]


#: Bits of a coordinate within the tree's cube: three of them fit 63.
BITS = 21
#: A node's points lie in cells of its side divided by two to this power, one in each.
SAMPLE_BITS = 7
#: Level of the deepest nodes: their cells have all bits.
DEEPEST = BITS - SAMPLE_BITS
#: A node with fewer points than this has no children: about what one request of a reader fetches.
_LEAF = 20_000


class Cube(NamedTuple):
    """The cube of the root: its lower corner and its side."""

    corner: NDArray[np.float64]
    side: float

    @classmethod
    def around(cls, low: NDArray[np.float64], high: NDArray[np.float64]) -> Cube:
        """Return the smallest cube around a box that has its lower corner, which is where copclib puts it."""
        return cls(low, float((high - low).max()) or 1.0)

    def codes(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the Morton codes of places, shape (n, 3): the bits of x, y and z in turns, x lowest."""
        steps = np.floor((places - self.corner) * (2.0**BITS / self.side)).astype(np.int64)
        x, y, z = (_spread(column) for column in np.clip(steps, 0, 2**BITS - 1).T)
        return x | y << 1 | z << 2


def cells_of(codes: NDArray[np.int64], level: int) -> NDArray[np.int64]:
    """Return the codes of the nodes of a level in which places lie that have these codes."""
    return codes >> 3 * (BITS - level)


class Node(NamedTuple):
    """A node: its level, 0 for the root, and its Morton code among those of the level."""

    level: int
    code: int

    @property
    def place(self) -> tuple[int, int, int]:
        """Number of the node along x, y and z."""
        x, y, z = (_gathered(self.code >> axis) for axis in range(3))
        return x, y, z


def nodes_of(codes: NDArray[np.int64], depth: int) -> Iterator[tuple[Node, NDArray[np.intp]]]:
    """
    Yield the nodes of points of one cell of the tree, or of some of it, and the rows of each.

    From the root down each node takes a point of each of its cells, the one with the lowest Morton code at
    the level `depth`; where few are left, all of them. Nodes above may have further points elsewhere, and are
    no leaves.
    """
    order = np.argsort(codes, kind="stable")
    left, levels = codes[order], np.full(len(codes), DEEPEST)
    rows = np.arange(len(codes))
    for level in range(DEEPEST):
        if level >= depth:
            starts, sizes = _runs(cells_of(left, level))
            is_taken = np.repeat(sizes < _LEAF, sizes)
        else:
            is_taken = np.zeros(len(left), dtype=bool)
        starts, _ = _runs(cells_of(left, level + SAMPLE_BITS))
        is_taken[starts] = True
        levels[rows[is_taken]] = level
        left, rows = left[~is_taken], rows[~is_taken]
    own = codes[order] >> 3 * (BITS - levels)
    by_node = np.lexsort((own, levels))
    starts, sizes = _runs(own[by_node] << 4 | levels[by_node])
    for start, size in zip(starts.tolist(), sizes.tolist(), strict=True):
        members = by_node[start : start + size]
        yield Node(int(levels[members[0]]), int(own[members[0]])), order[members]


def _runs(values: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where runs of equal values begin, and their lengths."""
    if not len(values):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    return starts, np.diff(starts, append=len(values))


def _spread(bits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Put two zeros between any two bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):  # fmt: skip
        bits = (bits | bits << shift) & mask
    return bits


def _gathered(code: int) -> int:
    """Return the number of every third bit."""
    return sum((code >> 3 * bit & 1) << bit for bit in range(BITS))


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
        raise InputError(f"{cloud.path}: has waveforms, which COPC cannot store: set model_writer.copc=false")
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
    header = copy.deepcopy(cloud.header)
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
