"""Files of which bytes are wrong or missing: clouds, bags and parameters."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import laspy
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from lidar_buildings.commands.settings import read_settings
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.placed_cloud import write_placed
from lidar_buildings.io.clouds.las import read_tile

_EDGES = np.array([0, 1, 2, 127, 128, 254, 255], np.uint8)
_N_POINTS = 50
_SCAN = "sensor_msgs/msg/PointCloud2"
_WORDS = (
    *("ground_filter", "tile_player", ".", "=", ":", "1e999", "nan", "-1", "[", "]", "{", "}", "'", '"'),
    *("&a", "*a", "!!python/object/apply:os.system", "\n", "  ", "\t", "\0", "ros__parameters", "/**"),
    *("9" * 400, "true", "null", "1_0", "0x1F", "ä", "- ", "? ", "| ", "%", "@", "#"),
)


@cache
def _folder() -> Path:
    """A folder for the files; it goes with the process."""
    folder = tempfile.TemporaryDirectory(prefix="fuzz_")
    atexit.register(folder.cleanup)
    return Path(folder.name)


def cloud_file(random: np.random.Generator) -> str:
    """
    Read a LAS or LAZ file.

    LAZ of format 6 and up is left out: lazrs takes up to 4 GB for each layer of a chunk that a file claims.
    """
    name = ("a.las", "b.las", "b.laz")[random.integers(3)]
    path = _folder() / f"case_{name}"
    path.write_bytes(_mutated(_cloud_bytes(name), random))
    return f"accepted, {'with' if len(read_tile(path)) else 'without'} points"


def bag_file(random: np.random.Generator) -> str:
    """Place the scans of a bag."""
    name = ("bag.mcap", "bag.db3", "bag.bag")[random.integers(3)]
    whole = _bag_bytes(name)
    path = _folder() / f"case_{name}"
    path.write_bytes(_mutated(whole, random))
    count = write_placed(path, _folder() / "placed.laz", BagConfig(), ScanConfig(georeferenced=True))
    return f"accepted, {'with' if count.n_points else 'without'} points"


def parameters(random: np.random.Generator) -> str:
    """Read --set and a parameter file."""
    text = "".join(_WORDS[i] for i in random.integers(0, len(_WORDS), random.integers(1, 12)))
    path = _folder() / "parameters.yaml"
    is_file = bool(random.integers(2))
    if is_file:
        whole = Path("config/pipeline.param.yaml").read_bytes()
        path.write_bytes(_mutated(whole, random) if random.integers(2) else text.encode())
    read_settings(path if is_file else None, [] if is_file else [text])
    return "accepted"


def _mutated(whole: bytes, random: np.random.Generator) -> bytes:
    """Return bytes of which some are others, some missing, and some there twice."""
    data = np.frombuffer(whole, np.uint8).copy()
    for _ in range(random.integers(1, 8)):
        at = int(random.integers(len(data)) if random.integers(2) else random.integers(min(len(data), 400)))
        data[at] = _EDGES[random.integers(len(_EDGES))] if random.integers(2) else random.integers(256)
    what = random.integers(6)
    at, n = int(random.integers(len(data))), int(random.integers(1, 64))
    if what == 0:
        data = data[:at]
    elif what == 1:
        data = np.concatenate([data[:at], data[at + n :]])
    elif what == 2:
        data = np.concatenate([data[: at + n], data[at:]])
    return data.tobytes()


def plain_cloud(folder: Path) -> Path:
    """Write a cloud with which nothing is wrong."""
    (folder / "plain.las").write_bytes(_cloud_bytes("a.las"))
    return folder / "plain.las"


@cache
def _cloud_bytes(name: str) -> bytes:
    version, form = ("1.4", 6) if name.startswith("a") else ("1.2", 1)
    header = laspy.LasHeader(version=version, point_format=form)
    header.scales = np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.xyz = np.random.default_rng(0).uniform(0, 100, (_N_POINTS, 3))
    cloud.write(_folder() / name)
    return (_folder() / name).read_bytes()


@cache
def _bag_bytes(name: str) -> bytes:
    is_ros1 = name.endswith(".bag")
    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
    path = _folder() / ("whole.bag" if is_ros1 else f"whole_{name.partition('.')[2]}")
    if is_ros1:
        writer: Any = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if name.endswith("mcap") else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        to = writer.add_connection("/points", _SCAN, typestore=types)
        for number in range(3):
            message = _scan(types.types, number, is_ros1=is_ros1)
            serialise = types.serialize_ros1 if is_ros1 else types.serialize_cdr
            writer.write(to, 10**18 + number * 10**8, serialise(message, _SCAN))
    if is_ros1:
        return path.read_bytes()
    (file,) = (one for one in path.iterdir() if one.suffix != ".yaml")
    content = file.read_bytes()
    shutil.rmtree(path)
    return content


def _scan(types: Any, number: int, *, is_ros1: bool) -> Any:
    points = np.random.default_rng(number).uniform(1, 100, (_N_POINTS, 3)).astype("<f4")
    stamp = types["builtin_interfaces/msg/Time"](10**9, number * 10**8)
    header = types["std_msgs/msg/Header"](*((0,) if is_ros1 else ()), stamp, "map")
    fields = [types["sensor_msgs/msg/PointField"](name, 4 * i, 7, 1) for i, name in enumerate("xyz")]
    sizes = SimpleNamespace(height=1, width=_N_POINTS, point_step=12, row_step=12 * _N_POINTS)
    data = points.view(np.uint8).reshape(-1)
    return types[_SCAN](
        header=header, fields=fields, is_bigendian=False, data=data, is_dense=True, **vars(sizes)
    )
