"""Tiles and rasters to sensor_msgs/PointCloud2, and tiles back."""

from __future__ import annotations

import array
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from lidar_buildings.core.model.bounds import BEYOND_TILE, are_of_tile, held_column
from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.core.scans.cloud_layout import XYZ, cast_to, columns_of, members_of_fields, taken_points
from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.ros.stamps import header_of, to_stamp

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


class CloudReading(NamedTuple):
    """What a cloud held."""

    tile: PointTile  #: the points that can be held with every column that we know
    n_dropped: int  #: rows that were left out because x, y or z was NaN or infinite
    n_beyond: int = 0  #: rows that were left out because they lie beyond what a map holds


def to_message(tile: PointTile) -> PointCloud2:
    """Put a tile into a cloud: x, y, z float32, then its columns; packed, little-endian, dense, one row."""
    layout = np.dtype([(name, "<f4") for name in XYZ] + [(n, COLUMNS[n]) for n in tile.columns])
    rows = np.empty(len(tile), dtype=layout)
    for axis, name in enumerate(XYZ):
        rows[name] = tile.points[:, axis]
    for name, column in tile.columns.items():
        rows[name] = column
    return cloud_message(tile.stamp, rows.reshape(1, -1))


def cloud_message(stamp: int, rows: NDArray[Any], *, is_dense: bool = True) -> PointCloud2:
    """Put a table of points, packed and little-endian, a field per member, into a cloud."""
    height, width = rows.shape
    message = PointCloud2(
        header=header_of(stamp),
        height=height,
        width=width,
        fields=[PointField(**one) for one in members_of_fields(rows.dtype)],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * width,
        is_dense=is_dense,
    )
    fill(message, rows)
    return message


def from_message(message: PointCloud2) -> CloudReading:
    """
    Read any cloud that has x, y and z as floats.

    Fields may come in any order, at any offset, padded, in any type and byte order, and rows may be padded
    too. Fields that we do not know are ignored. Rows whose x, y or z is not finite, or beyond what a map
    holds, are dropped and counted; other values become the nearest ones that their column holds.
    MessageError if x, y or z is missing or no float, the sizes contradict each other, or all points lie
    beyond.
    """
    columns = columns_of(message, COLUMNS)
    is_rounded = all(columns[axis].dtype.itemsize == np.float32().itemsize for axis in XYZ)
    points = taken_points(columns)
    rows = are_of_tile(points)
    n_dropped, n_beyond = len(points) - int(np.count_nonzero(rows)), 0
    if n_dropped:
        n_beyond = int(np.count_nonzero(np.isfinite(points[~rows]).all(axis=1)))
        if n_beyond == len(points):
            raise MessageError(f"no point can be held: {BEYOND_TILE}: publish coordinates of the map")
        columns = {name: values[rows] for name, values in columns.items()}
        for column in points.T:  # in place: twice the message is what float64 of float32 takes anyway
            column[: len(points) - n_dropped] = column[rows]
        points = points[: len(points) - n_dropped]
    if not is_rounded:
        for column in points.T:
            column[:] = column.astype(np.float32)
    stamp = to_stamp(message.header.stamp)
    known = {name: held_column(name, cast_to(COLUMNS[name], values)) for name, values in columns.items()}
    return CloudReading(PointTile(points, stamp=stamp, **known), n_dropped - n_beyond, n_beyond)


def fill(message: PointCloud2, rows: NDArray[Any]) -> None:
    """Give the message its bytes: of what the setter takes, only array.array is not checked byte by byte."""
    content = array.array("B")
    if rows.size:
        content.frombytes(np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data)
    message.data = content


def grid_message(stamp: int, window: RasterWindow, elevation: NDArray[np.float32]) -> PointCloud2:
    """
    Put a raster into a cloud of as many rows and columns, the northernmost row first.

    Every cell has its middle as x and y; z is NaN where the elevation is not known.
    """
    rows = np.empty(window.shape, dtype=_POINT)
    centres = window.centres(*np.indices(window.shape), (0.0, 0.0))
    rows["x"], rows["y"], rows["z"] = centres[..., 0], centres[..., 1], elevation
    return cloud_message(stamp, rows, is_dense=False)
