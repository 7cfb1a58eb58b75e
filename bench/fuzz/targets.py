"""What is fed: each target takes chance, makes a case of it and returns what became of it."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from bench.fuzz.clouds import LAST_CHANGE, random_cloud
from bench.fuzz.extremes import EXTREMES
from bench.fuzz.files import bag_file, cloud_file, parameters
from lidar_buildings.core.model.bounds import MAX_COORDINATE
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.tile import COLUMNS
from lidar_buildings.core.scans.cloud_layout import columns_of
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import MAX_POINTS, ScanPlacer

Target = Callable[[np.random.Generator], str]
OK = "accepted"
_FORMATS = {7: "f", 8: "d"}
_NUMBERS = (0.0, 1.0, -1.0, 5.0, 1e-200, 1e9, 1e308, np.nan, np.inf, -np.inf)


class WrongError(Exception):
    """Something was accepted that is not what the message says."""


def read_cloud(random: np.random.Generator) -> str:
    """Read a cloud, and compare a point with its bytes."""
    cloud = _cloud(random)
    columns = columns_of(cloud, COLUMNS)
    n = cloud.width * cloud.height
    if any(len(values) != n for values in columns.values()):
        raise WrongError("columns are not as long as the cloud")
    if n:
        _check_point(cloud, columns, int(random.integers(n)))
    return OK if n else "accepted, empty"


def _check_point(cloud: Any, columns: dict[str, Any], number: int) -> None:
    row, column = divmod(number, cloud.width)
    begin = row * cloud.row_step + column * cloud.point_step
    order = ">" if cloud.is_bigendian else "<"
    for axis in "xyz":
        one = next(field for field in cloud.fields if field.name == axis)
        (value,) = struct.unpack_from(order + _FORMATS[one.datatype], bytes(cloud.data), begin + one.offset)
        if not np.array_equal(columns[axis][number], np.float64(value), equal_nan=True):
            raise WrongError(f"{axis} of point {number} is {columns[axis][number]}, not {value}")


def message_to_tile(random: np.random.Generator) -> str:
    """Turn a message of rclpy into a tile."""
    from lidar_buildings.ros.point_cloud import from_message

    tile = from_message(as_ros(_cloud(random))).tile
    if not np.isfinite(tile.points).all():
        raise WrongError("a point of a tile is not finite")
    return OK


def as_ros(cloud: Any) -> Any:
    """Return a cloud as a message of rclpy."""
    from builtin_interfaces.msg import Time
    from sensor_msgs.msg import PointCloud2, PointField
    from std_msgs.msg import Header

    stamp = Time(sec=cloud.header.stamp.sec, nanosec=cloud.header.stamp.nanosec)
    message = PointCloud2(header=Header(stamp=stamp, frame_id=cloud.header.frame_id))
    message.fields = [
        PointField(name=one.name, offset=one.offset, datatype=one.datatype % 256, count=one.count)
        for one in cloud.fields
    ]
    for name in ("height", "width", "is_bigendian", "point_step", "row_step", "is_dense"):
        setattr(message, name, getattr(cloud, name))
    message.data = bytes(cloud.data)
    return message


@cache
def _placers() -> list[ScanPlacer]:
    """Placers that live on from case to case, as in a node."""
    kinds: tuple[dict[str, Any], ...] = ({}, {"georeferenced": True}, {"mounting": "1,2,3,4,5,6"})
    return [ScanPlacer(ScanConfig(**one)) for one in kinds]


def place_scan(random: np.random.Generator) -> str:
    """Give a placer that has seen much a pose, or a scan; what it places is finite and near the Earth."""
    placer = _placers()[random.integers(3)]
    for _ in range(random.integers(0, 3)):
        _add_pose(placer, random)
    try:
        placer.add_scan(_cloud(random))
    finally:
        for one in placer.placed():
            if not (np.abs(one.points) <= 4 * MAX_COORDINATE).all():
                raise WrongError("a placed point is not on Earth")
            if any(len(values) != len(one.points) for values in (one.times, *one.columns.values())):
                raise WrongError("columns are not as long as the points")
    if placer.n_waiting > MAX_POINTS:
        raise WrongError("more wait than may")
    return OK


def _add_pose(placer: ScanPlacer, random: np.random.Generator) -> None:
    place, attitude = _numbers(random, 3), _numbers(random, 4)
    if random.integers(2):
        attitude = [0.0, 0.0, 0.0, 1.0]
    position, rotation = (
        SimpleNamespace(**dict(zip("xyzw", values, strict=False))) for values in (place, attitude)
    )
    frames = ("odom", "base", "lidar", "/lidar", "map", "", f"frame{random.integers(2000)}")
    header = _cloud(random).header
    header.frame_id = frames[random.integers(len(frames))]
    child = frames[random.integers(len(frames))]
    if random.integers(2):
        pose = SimpleNamespace(pose=SimpleNamespace(position=position, orientation=rotation))
        placer.add_odometry(SimpleNamespace(header=header, child_frame_id=child, pose=pose))
        return
    moved = SimpleNamespace(translation=position, rotation=rotation)
    edge = SimpleNamespace(header=header, child_frame_id=child, transform=moved)
    placer.add_transforms(SimpleNamespace(transforms=[edge]), is_static=bool(random.integers(2)))


def _numbers(random: np.random.Generator, n: int) -> list[float]:
    return [_NUMBERS[i] if random.integers(2) else random.normal() for i in random.integers(0, 10, n)]


def _cloud(random: np.random.Generator) -> Any:
    cloud = random_cloud(random)
    if random.integers(2):
        LAST_CHANGE(cloud, random)
    return cloud


def ring_message(random: np.random.Generator) -> str:
    """Give rings to a collector and make outlines of what it closes."""
    from geometry_msgs.msg import Point32, Polygon, PolygonInstance, PolygonInstanceStamped

    from lidar_buildings.ros.polygons import RingCollector, outlines_of
    from lidar_buildings.ros.stamps import header_of

    collector = RingCollector()
    stamps = (0, 1000, 2**31 * 10**9 - 1, -(2**31) * 10**9)
    for _ in range(random.integers(1, 6)):
        n = int(random.choice([0, 0, 1, 2, 3, 4, 50]))
        with np.errstate(over="ignore"):
            points = [Point32(**dict(zip("xyz", _float32(random), strict=True))) for _ in range(n)]
        number = int(random.choice([-1, -1, 0, 1, 2, 2**63 - 1, -(2**63)]))
        polygon = PolygonInstance(polygon=Polygon(points=points), id=number)
        header = header_of(stamps[random.integers(4)])
        with suppress(LidarBuildingsError):
            closed = collector.add(PolygonInstanceStamped(header=header, polygon=polygon))
            if closed is not None:
                outlines_of(closed)
    return OK


def _float32(random: np.random.Generator) -> list[float]:
    return [float(np.float32(one)) if abs(one) < 3e38 else 0.0 for one in _numbers(random, 3)]


_TEXTS = (
    *("", "null", "[]", "{}", '"stamp"', "[" * 5000, '{"a":' * 5000, "\0", '{"a":1}', '{"1":[]}'),
    *('{"stamp":Infinity}', '{"stamp":NaN}', '{"stamp":1e999}', '{"stamp":' + "9" * 5000 + "}"),
    *('{"stamp":[1]}', '{"stamp":1,"bounds":[1,2]}', '{"stamp":1,"bounds":7}', '{"stamp":1,"is_over":true}'),
    *('{"stamp":1,"point_spacing":-1}', '{"stamp":1,"point_spacing":"a"}', '{"stamp":1,"dark_limit":{}}'),
    '{"node":"a","life":"b","state":"taken","stamp":Infinity}',
    '{"node":[],"life":{},"state":1,"stamp":1}',
    '{"stamp":1,"outlines":{"1":{"sigma":NaN,"max_offset":null,"bias":0.1,"status":"ok","reason":""}}}',
    '{"stamp":1,"outlines":{"a":{}}}',
    *('{"type":"CityJSONFeature"', '{"type":"CityJSONFeature"}'),
    '{"type":"CityJSONFeature","id":"../x","CityObjects":{"../x":{"attributes":{"building_id":1e999}}}}',
    '{"type":"CityJSONFeature","id":[],"CityObjects":{},"vertices":[]}',
)


def json_text(random: np.random.Generator) -> str:
    """Read what topics of JSON may say: tile_info, tile_receipt, outline_quality, city_model."""
    from std_msgs.msg import String

    from lidar_buildings.io.models.cityjson import load_feature
    from lidar_buildings.ros.node_state import state_of
    from lidar_buildings.ros.text_messages import qualities_of
    from lidar_buildings.ros.tile_info import infos_of

    text = _TEXTS[random.integers(len(_TEXTS))]
    if text and random.integers(2):
        letters = list(text[:200])
        letters[random.integers(len(letters))] = chr(random.integers(1, 128))
        text = "".join(letters)
    if random.integers(10) == 0:
        text = json.dumps({"stamp": random.normal() * 10.0 ** random.integers(-300, 300), "node": text})
    readers: tuple[Callable[[String], Any], ...] = (
        *(state_of, qualities_of, infos_of),
        lambda message: load_feature(message.data),
    )
    readers[random.integers(len(readers))](String(data=text))
    return OK


#: Name → target, and what share of the cases it gets.
TARGETS: dict[str, tuple[Target, float]] = {
    "PointCloud2, plain": (read_cloud, 0.7),
    "PointCloud2, rclpy": (message_to_tile, 0.1),
    "scans and poses": (place_scan, 0.2),
    "rings": (ring_message, 0.02),
    "JSON": (json_text, 0.05),
    "LAS and LAZ": (cloud_file, 0.01),
    "bags": (bag_file, 0.005),
    "parameters": (parameters, 0.002),
    **EXTREMES,
}
