"""Clouds as drivers send them, and what may become of them on the way: plain objects, from a seed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

#: Driver → fields: name, number of the type, in the order in which it sends them.
LAYOUTS: dict[str, tuple[tuple[str, int], ...]] = {
    "velodyne": (("x", 7), ("y", 7), ("z", 7), ("intensity", 7), ("ring", 4), ("time", 7)),
    "ouster": (("x", 7), ("y", 7), ("z", 7), ("intensity", 7), ("t", 6), ("reflectivity", 4), ("range", 6)),
    "livox": (("x", 7), ("y", 7), ("z", 7), ("intensity", 7), ("tag", 2), ("line", 2), ("timestamp", 8)),
    "hesai": (("x", 7), ("y", 7), ("z", 7), ("intensity", 7), ("timestamp", 8), ("ring", 4)),
    "robosense": (("x", 7), ("y", 7), ("z", 7), ("intensity", 2), ("ring", 4), ("timestamp", 8)),
    "riegl": (
        *(("x", 8), ("y", 8), ("z", 8), ("intensity", 4), ("return_number", 2), ("number_of_returns", 2)),
        *(("classification", 2), ("scan_angle", 3), ("point_source_id", 4), ("gps_time", 8)),
    ),
    "tile": (("x", 7), ("y", 7), ("z", 7), ("intensity", 7), ("buffer", 2), ("source", 4), ("index", 6)),
}
_TYPES = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_NAMES = ("x", "y", "z", "t", "time", "intensity", "gps_time", "scan_angle", "buffer", "", "x\0", "ü" * 40)
#: Numbers at which sizes go wrong.
_EDGES = (0, 1, 2, 3, 4, 7, 8, 12, 16, 255, 65_535, 2**31 - 1, 2**31, 2**32 - 1)
_VALUES = (np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e-320, 3.5e38, 1e300, 2.0**53, 1.7e9, 1.7e18)
_MAX_POINTS = 12
_SECOND = 1_000_000_000


def random_cloud(random: np.random.Generator) -> Any:
    """Return a cloud of a driver; most have something wrong."""
    cloud = _driver_cloud(random)
    for _ in range(random.integers(0, 4)):
        _CHANGES[random.integers(len(_CHANGES))](cloud, random)
    return cloud


def _driver_cloud(random: np.random.Generator) -> Any:
    names = list(LAYOUTS)
    layout = LAYOUTS[names[random.integers(len(names))]]
    pad = int(random.integers(0, 5))
    is_big = bool(random.integers(8) == 0)
    fields, step = [], 0
    for name, kind in layout:
        fields.append(SimpleNamespace(name=name, offset=step, datatype=kind, count=1))
        step += np.dtype(_TYPES[kind]).itemsize + pad
    height = int(random.integers(1, 4)) if random.integers(4) == 0 else 1
    width = int(random.integers(0, _MAX_POINTS))
    data = random.integers(0, 256, width * height * step, dtype=np.uint8)
    cloud = SimpleNamespace(
        header=_header(random),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=is_big,
        point_step=step,
        row_step=step * width,
        data=data,
        is_dense=bool(random.integers(2)),
    )
    if random.integers(4):
        _fill(cloud, random)
    return cloud


def _fill(cloud: Any, random: np.random.Generator) -> None:
    """Give the fields values as scanners have them, of which some are none."""
    n = cloud.width * cloud.height
    if not n:
        return
    rows = cloud.data.reshape(n, cloud.point_step)
    stamp = cloud.header.stamp.sec + cloud.header.stamp.nanosec / _SECOND
    for one in cloud.fields:
        kind = np.dtype(_TYPES[one.datatype]).newbyteorder(">" if cloud.is_bigendian else "<")
        values = random.uniform(0, 100, n)
        if one.name in ("timestamp", "gps_time"):
            values = stamp + np.linspace(0, 0.1, n)
        elif one.name in ("t", "time"):
            values = np.linspace(0, 0.1, n) * (_SECOND if kind.kind == "u" else 1)
        if kind.kind == "f" and random.integers(3) == 0:
            values[random.integers(n)] = _VALUES[random.integers(len(_VALUES))]
        with np.errstate(all="ignore"):
            column = values.astype(kind)
        rows[:, one.offset : one.offset + kind.itemsize] = column.view(np.uint8).reshape(n, -1)


def _header(random: np.random.Generator) -> Any:
    seconds = (0, 1, -1, 1_700_000_000, 1_700_000_000, 1_700_000_001, 2**31 - 1, -(2**31))
    parts = (0, 1, 999_999_999, 500_000_000, 500_000_000, 2**32 - 1)
    stamp = SimpleNamespace(
        sec=seconds[random.integers(len(seconds))], nanosec=parts[random.integers(len(parts))]
    )
    frames = ("lidar", "lidar", "/lidar", "map", "base", "", "../../etc", "a" * 300)
    return SimpleNamespace(stamp=stamp, frame_id=frames[random.integers(len(frames))])


def _size(old: int, random: np.random.Generator) -> int:
    around = (old + 1, max(old - 1, 0), old * 2, old // 2)
    choices = (*_EDGES, *around)
    return choices[random.integers(len(choices))] % 2**32


def _change_size(cloud: Any, random: np.random.Generator) -> None:
    name = ("height", "width", "point_step", "row_step")[random.integers(4)]
    setattr(cloud, name, _size(getattr(cloud, name), random))


def _change_field(cloud: Any, random: np.random.Generator) -> None:
    if not cloud.fields:
        return
    one = cloud.fields[random.integers(len(cloud.fields))]
    what = random.integers(4)
    if what == 0:
        one.offset = _size(one.offset, random)
    elif what == 1:
        one.datatype = int(random.integers(0, 256)) if random.integers(2) else int(random.integers(0, 10))
    elif what == 2:
        one.count = _size(one.count, random)
    else:
        one.name = _NAMES[random.integers(len(_NAMES))]


def _change_fields(cloud: Any, random: np.random.Generator) -> None:
    what = random.integers(3)
    if what == 0 and cloud.fields:
        del cloud.fields[random.integers(len(cloud.fields))]
    elif what == 1 and cloud.fields:
        cloud.fields.append(cloud.fields[random.integers(len(cloud.fields))])
    else:
        cloud.fields = [cloud.fields[i] for i in random.permutation(len(cloud.fields))]


def _change_length(cloud: Any, random: np.random.Generator) -> None:
    n = min(_size(len(cloud.data), random), 4096)
    cloud.data = np.resize(cloud.data, n) if len(cloud.data) else np.zeros(n, np.uint8)


def _change_bytes(cloud: Any, random: np.random.Generator) -> None:
    if len(cloud.data):
        at = random.integers(0, len(cloud.data), 4)
        cloud.data[at] = random.choice(np.array([0, 1, 127, 128, 255], np.uint8), 4)


def _change_order(cloud: Any, random: np.random.Generator) -> None:
    cloud.is_bigendian = not cloud.is_bigendian


def _change_container(cloud: Any, random: np.random.Generator) -> None:
    cloud.data = bytes(cloud.data) if random.integers(2) else memoryview(bytes(cloud.data))


_CHANGES = (
    *(_change_size, _change_size, _change_field, _change_field, _change_fields),
    *(_change_length, _change_bytes, _change_order),
)
#: What ends the changes, since it takes the bytes' mutability: of half the clouds.
LAST_CHANGE = _change_container
