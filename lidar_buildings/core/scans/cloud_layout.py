"""The layout of sensor_msgs/PointCloud2: from its bytes to columns, whatever library has read the message."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError

#: sensor_msgs/PointField's numbers of types.
DATATYPES: dict[int, np.dtype[Any]] = {
    number: np.dtype(name)
    for number, name in enumerate(("i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8"), start=1)
}
_CODES = {dtype: number for number, dtype in DATATYPES.items()}
XYZ = ("x", "y", "z")


class Field(Protocol):
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int


class Cloud(Protocol):
    """sensor_msgs/PointCloud2, of rclpy or of rosbags."""

    height: int
    width: int
    fields: Any
    is_bigendian: bool
    point_step: int
    row_step: int
    data: Any


def members_of_fields(rows: np.dtype[Any]) -> Iterator[dict[str, Any]]:
    """Yield the members of a PointField for each member of a dtype."""
    for name in rows.names or ():
        dtype, offset = rows.fields[name][:2]  # type: ignore[index]
        yield {"name": name, "offset": offset, "datatype": _CODES[dtype], "count": 1}


def columns_of(cloud: Cloud, wanted: Collection[str]) -> dict[str, NDArray[Any]]:
    """
    Return x, y, z and the wanted fields that a cloud has, as views into it, shape (n,).

    Fields may come in any order, at any offset, padded, in any type and byte order, and rows may be padded.
    MessageError if x, y or z is missing or no float, or the sizes contradict each other.
    """
    if cloud.width * cloud.height == 0:
        empty = {one.name: np.zeros(0, DATATYPES.get(one.datatype, "<f4")) for one in cloud.fields}
        return {name: np.zeros(0, "<f4") for name in XYZ} | {n: c for n, c in empty.items() if n in wanted}
    row_step = _checked_row_step(cloud)  # first: what follows relies on sizes that are those of the data
    layout = _layout_of(cloud, wanted)
    rows = np.ndarray(
        (cloud.height, cloud.width),
        dtype=layout,
        buffer=memoryview(cloud.data),
        strides=(row_step, cloud.point_step),
    )
    return {name: rows[name].reshape(-1) for name in layout.names or ()}


def taken_points(columns: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    """Take x, y and z out of the columns; return them, shape (n, 3)."""
    points = np.empty((len(columns["x"]), 3))
    with np.errstate(invalid="ignore"):  # of what is no number there are kinds at which the processor stops
        for axis, name in enumerate(XYZ):
            points[:, axis] = columns.pop(name)
    return points


def cast_to(dtype: np.dtype[Any], values: NDArray[Any]) -> NDArray[Any]:
    """Turn values into a type; what it cannot hold becomes its nearest value, NaN becomes 0."""
    with np.errstate(over="ignore", invalid="ignore"):
        if dtype.kind == "f" or np.can_cast(values.dtype, dtype):
            return values.astype(dtype)
        whole = values.astype(np.float64)  # float32 rounds the largest uint32 up, beyond it
    limits = np.iinfo(dtype)
    whole = np.nan_to_num(whole, nan=0.0, posinf=limits.max, neginf=limits.min)
    return np.clip(whole, limits.min, limits.max).astype(dtype)


def _layout_of(cloud: Cloud, wanted: Collection[str]) -> np.dtype[Any]:
    offsets: dict[str, int] = {}
    formats: dict[str, np.dtype[Any]] = {}
    for one in cloud.fields:
        if one.name in offsets or (one.name not in wanted and one.name not in XYZ):
            continue
        formats[one.name] = _format_of(one, cloud)
        offsets[one.name] = one.offset
    missing = [name for name in XYZ if name not in offsets]
    if missing:
        has = ", ".join(one.name for one in cloud.fields) or "none"
        raise MessageError(f"the cloud has no field {' or '.join(missing)} (its fields: {has})")
    return np.dtype(
        {
            "names": list(offsets),
            "formats": list(formats.values()),
            "offsets": list(offsets.values()),
            "itemsize": cloud.point_step,
        }
    )


def _format_of(one: Field, cloud: Cloud) -> np.dtype[Any]:
    """Return a field's dtype in the message's byte order, or say why it cannot be read."""
    dtype = DATATYPES.get(one.datatype)
    if dtype is None:
        raise MessageError(f"field {one.name} has the unknown datatype {one.datatype}: must be 1 to 8")
    if one.name in XYZ and dtype.kind != "f":
        raise MessageError(f"field {one.name} is {dtype.name}: must be float32 or float64")
    if one.count > 1:
        raise MessageError(f"field {one.name} has {one.count} values a point: must be 1")
    if one.offset + dtype.itemsize > cloud.point_step:
        end = one.offset + dtype.itemsize
        raise MessageError(f"field {one.name} ends at byte {end} of a point of {cloud.point_step}")
    return dtype.newbyteorder(">") if cloud.is_bigendian else dtype


def _checked_row_step(cloud: Cloud) -> int:
    """Return the bytes from row to row, or say which size contradicts which."""
    packed = cloud.width * cloud.point_step
    row_step = packed if cloud.height == 1 and cloud.row_step == 0 else cloud.row_step
    if row_step < packed:
        raise MessageError(
            f"row_step is {row_step}: must be at least width × point_step = {cloud.width} × "
            f"{cloud.point_step} = {packed}"
        )
    if len(cloud.data) != row_step * cloud.height:
        raise MessageError(
            f"the cloud has {len(cloud.data)} bytes of data: must be row_step × height = "
            f"{row_step} × {cloud.height} = {row_step * cloud.height}"
        )
    return row_step
