"""Bags of a virtual scanner that moves, rolls and turns over known points."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation
from support.scan_messages import SECOND, T0, cloud_of, header, odometry, transforms, xyzw

from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.placed_cloud import write_placed

#: Lever arm [m] and boresight angles [deg] of the scanner on the vehicle.
MOUNTING = (0.4, -0.2, 1.1, 2.0, -1.5, 0.7)
#: Storage → how it is written.
STORAGES = {
    "mcap": (StoragePlugin.MCAP, None),
    "mcap_message": (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "sqlite3": (StoragePlugin.SQLITE3, None),
    "sqlite3_message": (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "sqlite3_file": (StoragePlugin.SQLITE3, CompressionMode.FILE),
    "ros1": None,
}
SCAN_TYPE, ODOMETRY_TYPE = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry"
ORIGIN_TYPE = "geometry_msgs/msg/PointStamped"
TF_TYPE = "tf2_msgs/msg/TFMessage"
#: How the scanner is mounted, as parameters say it.
MOUNTED = ScanConfig(mounting=",".join(map(str, MOUNTING)))


def placed(tmp_path, bag, config=MOUNTED, choice=None):
    """Place a bag; return the LAZ file that comes of it, and what is told of it."""
    path = tmp_path / "placed.laz"
    count = write_placed(bag, path, choice or BagConfig(), config)
    return laspy.read(path), count


def vehicle(seconds):
    """Where the vehicle is at some times: position and attitude; smooth, and rolling."""
    seconds = np.asarray(seconds, dtype=float)
    place = np.column_stack([20.0 * seconds, 3.0 * np.sin(seconds), 0.5 * np.cos(seconds)])
    angles = np.column_stack([5.0 * np.sin(2 * seconds), 3.0 * np.cos(seconds), 10.0 * seconds])
    return place, Rotation.from_euler("xyz", angles, degrees=True)


def mounted():
    """Position and attitude of the scanner on the vehicle."""
    return np.array(MOUNTING[:3]), Rotation.from_euler("xyz", MOUNTING[3:], degrees=True)


def truth(n_points=5000, seconds=1.0, seed=1):
    """Points in the map and when they are measured [s]."""
    random = np.random.default_rng(seed)
    times = np.sort(random.uniform(0.0, seconds, n_points))
    return random.uniform([-30, -30, -5], [30, 30, 10], (n_points, 3)), times


def seen(points, times):
    """The points as the scanner sees them at their times."""
    place, attitude = vehicle(times)
    arm, boresight = mounted()
    return boresight.inv().apply(attitude.inv().apply(points - place) - arm)


class BagWriter:
    """Writes messages given as plain values."""

    def __init__(self, path: Path, storage: str = "mcap") -> None:
        self.path = path
        self.is_ros1 = STORAGES[storage] is None
        self.types = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_JAZZY)
        if self.is_ros1:
            edges = "geometry_msgs/TransformStamped[] transforms"
            self.types.register(get_types_from_msg(edges, TF_TYPE))
            self.path = path.with_suffix(".bag")
            self.writer = Writer1(self.path)
        else:
            plugin, mode = STORAGES[storage]
            self.writer = Writer2(path, version=9, storage_plugin=plugin)
            if mode is not None:
                self.writer.set_compression(mode, CompressionFormat.ZSTD)
        self.writer.open()
        self.connections = {}

    def write(self, topic, kind, time, message):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.types)
        serialise = self.types.serialize_ros1 if self.is_ros1 else self.types.serialize_cdr
        self.writer.write(self.connections[topic], time, serialise(message, kind))

    def close(self):
        self.writer.close()

    def header(self, time, frame):
        return header(time, frame)

    def tf(self, *edges):
        return transforms(*((*edge, attitude.as_quat()) for *edge, attitude in edges))

    def odometry(self, time, frame, child, place, attitude):
        return odometry(time, place, attitude.as_quat(), frame, child)

    def cloud(self, time, frame, points, offsets=None, **changes):
        dtype = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
        if offsets is not None:
            dtype.append(("t", "<u4"))
        rows = np.zeros(len(points), dtype)
        rows["x"], rows["y"], rows["z"] = np.asarray(points).T
        rows["intensity"] = np.arange(len(points)) % 200
        if offsets is not None:
            rows["t"] = offsets
        return self.cloud_of(time, frame, rows, **changes)

    def cloud_of(self, time, frame, rows, **changes):
        """A cloud with a field per member of a structured array."""
        return cloud_of(time, frame, rows, **{"data": rows.view(np.uint8).reshape(-1)} | changes)

    def origin(self, crs, x, y, z):
        return SimpleNamespace(header=header(T0, crs), point=xyzw((x, y, z)))


def write_drive(
    path, storage="mcap", poses="odometry", pose_rate=200.0, n_points=5000, seconds=1.0, pose_times=None
):
    """
    Write scans of a tenth of a second and the vehicle's poses; return the bag's path and the truth.

    `poses`: ``odometry`` (of the vehicle, mounting not told), ``tf`` (mounting in /tf_static) or ``none``.
    """
    points, times = truth(n_points, seconds)
    bag = BagWriter(path, storage)
    end = seconds + 2.0 / pose_rate
    if poses == "tf":
        static = bag.tf((T0, "base", "lidar", mounted()[0], mounted()[1]))
        bag.write("/tf_static", TF_TYPE, T0, static)
    pose_times = np.arange(0.0, end, 1.0 / pose_rate) if pose_times is None else pose_times
    events = [(second, "pose") for second in pose_times]
    events += [(second + 0.1, "scan") for second in np.arange(0.0, seconds, 0.1)]
    for second, what in sorted(events):
        now = T0 + round(second * SECOND)
        place, attitude = (one[0] for one in vehicle([second]))
        if what == "scan":
            begin = second - 0.1
            own = (times >= begin) & (times < begin + 0.1)
            begin = T0 + round(begin * SECOND)
            offsets = np.rint(times[own] * SECOND).astype(np.int64) - (begin - T0)
            cloud = bag.cloud(begin, "lidar", seen(points[own], times[own]), np.maximum(offsets, 0))
            bag.write("/points", SCAN_TYPE, now, cloud)
        elif poses == "odometry":
            bag.write("/odometry", ODOMETRY_TYPE, now, bag.odometry(now, "odom", "base", place, attitude))
        elif poses == "tf":
            bag.write("/tf", TF_TYPE, now, bag.tf((now, "odom", "base", place, attitude)))
    bag.close()
    return SimpleNamespace(path=bag.path, points=points, times=times)


def write_chain(path, links, seconds=10.0, n_points=4000, change=None):
    """
    Write scans of a tenth of a second, and a chain of frames that move along x; return the bag and the truth.

    `links` is (parent, child) → (seconds of its poses, its speed [m/s]), down to ``lidar``; the first two of
    them lead from ``map`` to it, others beside are told, too. `change` may change the times of a scan's
    points, uint32 nanoseconds since its stamp, by its number.
    """
    points, times = truth(n_points, seconds)
    bag, speed = BagWriter(path), sum(speed for _, speed in list(links.values())[:2])
    still = Rotation.identity()
    events = [(second, edge) for edge, (own, _) in links.items() for second in own]
    events += [(second + 0.1, None) for second in np.arange(0.0, seconds, 0.1)]
    for number, (second, edge) in enumerate(sorted(events, key=lambda one: (one[0], str(one[1])))):
        now = T0 + round(second * SECOND)
        if edge is not None:
            bag.write("/tf", TF_TYPE, now, bag.tf((now, *edge, (links[edge][1] * second, 0.0, 0.0), still)))
            continue
        begin = T0 + round((second - 0.1) * SECOND)
        own = (times >= second - 0.1) & (times < second)
        offsets = np.maximum(np.rint(times[own] * SECOND).astype(np.int64) - (begin - T0), 0).astype(
            np.uint32
        )
        moved = points[own] - np.column_stack([speed * times[own], np.zeros((2, own.sum())).T])
        offsets = offsets if change is None else change(offsets, number)
        bag.write("/points", SCAN_TYPE, now, bag.cloud(begin, "lidar", moved, offsets))
    bag.close()
    return SimpleNamespace(path=bag.path, points=points, times=times)


def with_profile(path, profile, encodings=()):
    """Write an MCAP file again beside it, with another profile and topics of other encodings; return that."""
    target = path.with_name(f"{path.stem}_again.mcap")
    with open(path, "rb") as file, open(target, "wb") as out:
        writer, ids = Writer(out), {}
        writer.start(profile)
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in ids:
                one = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, one)
            time = message.log_time
            writer.add_message(ids[channel.id], time, message.data, message.publish_time, message.sequence)
        for encoding in encodings:
            one = writer.register_schema("foxglove.PointCloud", encoding, b"")
            writer.add_message(writer.register_channel(f"/{encoding}", encoding, one), T0, b"", T0)
        writer.finish()
    return target
