"""Points to sensor_msgs/PointCloud2 and back: the only place that knows how a cloud is laid out."""

from __future__ import annotations

import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.ros.errors import MessageError
from lidar_buildings.ros.stamps import header_of, to_stamp

_DATATYPES: dict[int, np.dtype[Any]] = {
    PointField.INT8: np.dtype("i1"),
    PointField.UINT8: np.dtype("u1"),
    PointField.INT16: np.dtype("<i2"),
    PointField.UINT16: np.dtype("<u2"),
    PointField.INT32: np.dtype("<i4"),
    PointField.UINT32: np.dtype("<u4"),
    PointField.FLOAT32: np.dtype("<f4"),
    PointField.FLOAT64: np.dtype("<f8"),
}
_CODES = {dtype: code for code, dtype in _DATATYPES.items()}
_XYZ = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class CloudReading:
    """
    What a cloud held.

    Attributes
    ----------
    tile : PointTile
        The finite points with every column that we know.
    n_dropped : int
        How many rows were left out because x, y or z was NaN or infinite.
    """

    tile: PointTile
    n_dropped: int


def to_message(tile: PointTile) -> PointCloud2:
    """Put a tile into a cloud: x, y, z float32, then its columns; packed, little-endian, dense, one row."""
    layout = np.dtype([(name, "<f4") for name in _XYZ] + [(n, COLUMNS[n]) for n in tile.columns])
    rows = np.empty(len(tile), dtype=layout)
    for axis, name in enumerate(_XYZ):
        rows[name] = tile.points[:, axis]
    for name, column in tile.columns.items():
        rows[name] = column
    return cloud_message(tile.stamp, rows.reshape(1, -1))


def cloud_message(stamp: int, rows: NDArray[Any], *, is_dense: bool = True) -> PointCloud2:
    """
    Put a table of points into a cloud.

    Parameters
    ----------
    stamp : int
        The tile's key [ns].
    rows : structured ndarray of shape (height, width)
        Packed and little-endian; a field per member.
    is_dense : bool
        Whether no value is NaN.
    """
    height, width = rows.shape
    message = PointCloud2(
        header=header_of(stamp),
        height=height,
        width=width,
        fields=_fields_of(rows.dtype),
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * width,
        is_dense=is_dense,
    )
    _fill(message, rows)
    return message


def from_message(message: PointCloud2) -> CloudReading:
    """
    Read any cloud that has x, y and z as floats.

    Fields may come in any order, at any offset, padded, in any type and byte order, and rows may be padded
    too. Fields that we do not know are ignored. Rows whose x, y or z is not finite are dropped and counted.

    Raises
    ------
    MessageError
        If x, y or z is missing or no float, or the sizes contradict each other.
    """
    columns = _columns_of(message)
    xyz = [columns.pop(name) for name in _XYZ]
    points = np.column_stack([np.asarray(values, dtype=np.float64) for values in xyz])
    # What float32 cannot hold would become infinite in the tile.
    finite = np.isfinite(points) & (np.abs(points) <= np.finfo(np.float32).max)
    rows = finite.all(axis=1)
    n_dropped = len(points) - int(np.count_nonzero(rows))
    if n_dropped:
        points, columns = points[rows], {name: values[rows] for name, values in columns.items()}
    stamp = to_stamp(message.header.stamp)
    known = {name: _cast(values, COLUMNS[name]) for name, values in columns.items()}
    return CloudReading(PointTile(points, stamp=stamp, **known), n_dropped)


def _fill(message: PointCloud2, rows: NDArray[Any]) -> None:
    """
    Give the message its bytes without copying them.

    The generated setter accepts nothing but array.array without walking over every byte in Python, which
    takes a second per million points; the converter to the middleware takes any buffer.
    """
    content = rows.reshape(-1).view(np.uint8) if rows.size else np.zeros(0, dtype=np.uint8)
    if hasattr(message, "_data"):
        message._data = content
        return
    copied = array.array("B")
    copied.frombytes(memoryview(content))
    message.data = copied


def _fields_of(layout: np.dtype[Any]) -> list[PointField]:
    return [
        PointField(name=name, offset=offset, datatype=_CODES[dtype], count=1)
        for name, (dtype, offset) in ((n, layout.fields[n][:2]) for n in layout.names)
    ]


def _columns_of(message: PointCloud2) -> dict[str, NDArray[Any]]:
    """Return the fields that we know as views into the message, x, y and z among them."""
    if message.width * message.height == 0:
        fields = {name: np.dtype("<f4") for name in _XYZ}
        fields.update({f.name: COLUMNS[f.name] for f in message.fields if f.name in COLUMNS})
        return {name: np.zeros(0, dtype=dtype) for name, dtype in fields.items()}
    layout = _layout_of(message)
    row_step = _checked_row_step(message)
    rows = np.ndarray(
        (message.height, message.width),
        dtype=layout,
        buffer=memoryview(message.data),
        strides=(row_step, message.point_step),
    )
    return {name: rows[name].reshape(-1) for name in layout.names}


def _layout_of(message: PointCloud2) -> np.dtype[Any]:
    """Return the dtype of one point, of the known fields alone."""
    offsets: dict[str, int] = {}
    formats: dict[str, np.dtype[Any]] = {}
    for one in message.fields:
        if one.name in offsets or (one.name not in COLUMNS and one.name not in _XYZ):
            continue
        formats[one.name] = _format_of(one, message)
        offsets[one.name] = one.offset
    missing = [name for name in _XYZ if name not in offsets]
    if missing:
        has = ", ".join(one.name for one in message.fields) or "none"
        raise MessageError(f"the cloud has no field {' or '.join(missing)} (its fields: {has})")
    return np.dtype(
        {
            "names": list(offsets),
            "formats": list(formats.values()),
            "offsets": list(offsets.values()),
            "itemsize": message.point_step,
        }
    )


def _format_of(one: PointField, message: PointCloud2) -> np.dtype[Any]:
    """Return a field's dtype in the message's byte order, or say why it cannot be read."""
    dtype = _DATATYPES.get(one.datatype)
    if dtype is None:
        raise MessageError(f"field {one.name} has the unknown datatype {one.datatype}: must be 1 to 8")
    if one.name in _XYZ and dtype.kind != "f":
        raise MessageError(f"field {one.name} is {dtype.name}: must be float32 or float64")
    if one.count > 1:
        raise MessageError(f"field {one.name} has {one.count} values a point: must be 1")
    if one.offset + dtype.itemsize > message.point_step:
        end = one.offset + dtype.itemsize
        raise MessageError(f"field {one.name} ends at byte {end} of a point of {message.point_step}")
    return dtype.newbyteorder(">") if message.is_bigendian else dtype


def _checked_row_step(message: PointCloud2) -> int:
    """Return the bytes from row to row, or say which size contradicts which."""
    packed = message.width * message.point_step
    row_step = packed if message.height == 1 and message.row_step == 0 else message.row_step
    if row_step < packed:
        raise MessageError(
            f"row_step is {row_step}: must be at least width × point_step = {message.width} × "
            f"{message.point_step} = {packed}"
        )
    if len(message.data) != row_step * message.height:
        raise MessageError(
            f"the cloud has {len(message.data)} bytes of data: must be row_step × height = "
            f"{row_step} × {message.height} = {row_step * message.height}"
        )
    return row_step


def _cast(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Turn a field's values into our type; what it cannot hold becomes its nearest value, NaN becomes 0."""
    if dtype.kind == "f" or np.can_cast(values.dtype, dtype):
        with np.errstate(over="ignore"):
            return values.astype(dtype)
    limits = np.iinfo(dtype)
    whole = np.nan_to_num(values, nan=0.0, posinf=limits.max, neginf=limits.min)
    return np.clip(whole, limits.min, limits.max).astype(dtype)
