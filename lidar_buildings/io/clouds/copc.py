"""The octree of COPC files (https://copc.io): which points have to be read for a part of them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.clouds.cloud import CloudExtent
from lidar_buildings.io.files.failures import reported
from lidar_buildings.io.files.locations import open_binary

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
        """Return bounds in plan, shape (n, 2, 2), and points of nodes; the smallest joined to squares."""
        deepest = max(0, int(np.log2(max(self.side * unit / _SQUARE, 1.0))))
        below = np.maximum(self.level - deepest, 0)
        keys = np.column_stack([self.level - below, self.place[:, :2] >> below[:, None]])
        found, own = np.unique(keys, axis=0, return_inverse=True)
        whole = self._replace(level=found[:, 0], place=found[:, [1, 2, 2]])
        return whole.bounds, np.bincount(own.ravel(), self.count, len(found))


def read_nodes(cloud: CloudExtent) -> CopcNodes | None:
    """Read a COPC file's hierarchy, None if it has none of all its points; InputError if it is unreadable."""
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
