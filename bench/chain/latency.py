"""
From a tile's last point to its last model: one tile sent into a graph that runs and waits.

    python -m bench.chain.latency POINTS REPEATS FILE ...

The nodes are those of a run without player and writer, in one process. The tile is a square from the middle
of the files. The clock starts when its points are an array in memory, and ends when the sender hears that its
models are published. Prints a line of JSON.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.chain.stages import processor_time
from bench.common.clouds import read_files
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes.table import nodes_until
from lidar_buildings.ros.middleware import prepare_middleware

if TYPE_CHECKING:
    from lidar_buildings.pipeline.building_pool import BuildingPool

LAST = "building_model"
#: Until the first tile comes through: it is sent again as long as not all nodes have found each other [s].
FIRST = 15.0
#: No tile takes longer [s].
TIMEOUT = 600.0
SECOND = 1_000_000_000


def middle_tile(tile: PointTile, n_points: int) -> PointTile:
    """Return the square about the middle of a tile that holds so many points."""
    xy = tile.points[:, :2]
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    return tile.select(np.sort(np.argsort(abs(xy - middle).max(axis=1), kind="stable")[:n_points]))


def measure(tile: PointTile, frame: MapFrame, repeats: int) -> dict[str, Any]:
    """Start the graph, send a tile until one comes through, then as often as asked for."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    prepare_middleware()
    from lidar_buildings.pipeline.building_pool import BuildingPool  # after the middleware was prepared

    with BuildingPool() as pool:  # before ROS starts its threads
        return _measure(tile, frame, repeats, pool)


def _measure(tile: PointTile, frame: MapFrame, repeats: int, pool: BuildingPool) -> dict[str, Any]:
    import rclpy

    from lidar_buildings.nodes.graph import make_node
    from lidar_buildings.ros.composition import Composition

    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    place = {"context": context, "namespace": f"bench_{os.getpid()}"}
    settings = {"flow_control": {"publish_tile_done": True}}
    nodes = [make_node(name, settings, pool, **place) for name in nodes_until(LAST)[1:-1]]
    composition = Composition(*nodes)
    composition.start()
    sender = Sender(frame, place)
    try:
        while sender.seconds_of(tile, FIRST) is None:
            pass
        cpu = processor_time()
        seconds = [sender.seconds_of(tile, TIMEOUT) for _ in range(repeats)]
        cpu = processor_time() - cpu
    finally:
        composition.stop()
        sender.close()
    return {"points": len(tile), "seconds": seconds, "cpu": cpu / repeats}


class Sender:
    """Takes the player's place: sends tiles and hears when they are done."""

    def __init__(self, frame: MapFrame, place: dict[str, Any]) -> None:
        from geometry_msgs.msg import PointStamped, Vector3Stamped
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import Header, String

        from lidar_buildings.nodes.map_frames import origin_message, units_message
        from lidar_buildings.ros.qos import CLOUD, LATCHED, LATCHED_HISTORY

        self._node = Node("sender", **place)
        self._points = self._node.create_publisher(PointCloud2, "points", CLOUD)
        self._info = self._node.create_publisher(String, "tile_info", LATCHED)
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._node.create_subscription(Header, "tile_done", self._done.put, LATCHED_HISTORY)
        self._latched = [
            (self._node.create_publisher(kind, topic, LATCHED), message)
            for kind, topic, message in (
                (Vector3Stamped, "map_units", units_message(frame)),
                (PointStamped, "map_origin", origin_message(frame)),
            )
        ]
        for publisher, message in self._latched:
            publisher.publish(message)
        executor = SingleThreadedExecutor(context=place["context"])
        executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, args=(executor,), daemon=True)
        self._thread.start()
        self._stamp = SECOND

    def seconds_of(self, tile: PointTile, timeout: float) -> float | None:
        """Send a tile; return the time until it is done, None if it is not in time [s]."""
        from lidar_buildings.ros.point_cloud import to_message
        from lidar_buildings.ros.stamps import to_stamp
        from lidar_buildings.ros.tile_info import info_message

        self._stamp += SECOND
        tile = replace(tile, stamp=self._stamp)
        started = time.perf_counter()
        self._info.publish(info_message(tile))
        self._points.publish(to_message(tile))
        while (left := started + timeout - time.perf_counter()) > 0:
            try:
                done = self._done.get(timeout=left)
            except queue.Empty:
                break
            if to_stamp(done.stamp) == self._stamp:
                return time.perf_counter() - started
        return None

    def close(self) -> None:
        """Wait for the thread, which ends with the context."""
        self._thread.join()
        self._node.destroy_node()

    @staticmethod
    def _spin(executor: Any) -> None:
        from rclpy.executors import ExternalShutdownException

        with suppress(ExternalShutdownException):
            executor.spin()


def main(arguments: Sequence[str]) -> None:
    """Measure one tile of the files."""
    n_points, repeats, *files = arguments
    tile, frame = read_files([Path(file) for file in files])
    print(json.dumps(measure(middle_tile(tile, int(n_points)), frame, int(repeats))))


if __name__ == "__main__":
    main(sys.argv[1:])
