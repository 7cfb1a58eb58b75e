"""Flights over a scene through the live graph: what it publishes after each, and what `run` makes of all."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
import pyproj
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from bench.common.process_tree import cpu_of, tree_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.models.cityjson import parse_feature
from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.point_cloud import cloud_message
from lidar_buildings.ros.qos import BUILDING, EVENT, RELIABLE_SENSOR
from lidar_buildings.ros.text_messages import is_model, is_provisional

#: Points of a scan; the time between two flights [s]; how long the graph may take for one [s].
_SCAN, _TURN, _PATIENCE = 2000, 30.0, 240.0
_KEPT = ("intensity", "return_number", "number_of_returns", "scan_angle", "point_source_id", "gps_time")
_SECOND = 1_000_000_000
#: What holds no name of an input.
_FILES = ("buildings.gpkg", "city_model.obj", "city_model.dxf")


class Published(NamedTuple):
    """What the graph has published after a flight."""

    #: Name → feature, of all buildings: as solved from sums, and as made of all points.
    solved: dict[str, str]
    made: dict[str, str]
    #: Seconds from the flight's last point to the last of each; NaN for none.
    solved_after: float
    made_after: float
    cpu: float  #: processor time of the graph's processes for this flight [s]


def model_of(line: str) -> BuildingModel:
    """Return the finest solid of a feature, with how sure it is, as the stage gave them."""
    found = parse_feature(line)
    if found.solid is None:
        return BuildingModel({}, found.attributes)
    roofs = iter(found.roof_faces)
    told = tuple(next(roofs) if kind == "RoofSurface" else {} for kind in found.solid.semantics)
    return BuildingModel({found.lod: found.solid}, found.attributes, of_faces={found.lod: told})


class Listener:
    """A scanner and a viewer: sends scans to a graph of another process, hears its models and how it is."""

    def __init__(self) -> None:
        self._node = rclpy.create_node("strips")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._scan = self._node.create_publisher(PointCloud2, "scan", RELIABLE_SENSOR)
        self._node.create_subscription(String, "city_model", self._on_model, BUILDING)
        self._node.create_subscription(DiagnosticArray, "diagnostics", self._on_diagnostics, EVENT)
        self.lines: dict[str, str] = {}  # of buildings that are there
        #: Those of this flight that were solved from sums, and when the last of these, and of others, came.
        self.solved: dict[str, str] = {}
        self.times = [math.nan, math.nan]
        self._state: dict[str, str] = {}
        self._sent = 0

    def _on_model(self, message: String) -> None:
        name = json.loads(message.data).get("id", "")
        if is_provisional(message.data):
            self.solved[name], self.times[0] = message.data, time.monotonic()
        elif is_model(message.data):
            self.lines[name], self.times[1] = message.data, time.monotonic()
        else:
            self.lines.pop(name, None)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "scan_assembler: summary":
                self._state = {pair.key: pair.value for pair in status.values}

    def wait(self, is_so: Any, what: str) -> None:
        """Listen until something is so."""
        end = time.monotonic() + _PATIENCE
        while not is_so():
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() > end:
                raise TimeoutError(f"{what}: not within {_PATIENCE:g} s; the graph says {self._state}")

    def meet(self) -> None:
        """Wait for the graph."""
        self.wait(lambda: self._scan.get_subscription_count() and self._state, "no graph")

    def send(self, scans: Sequence[PointCloud2]) -> float:
        """Send a flight's scans, wait until the graph is done with them, and return when they were sent."""
        for number, scan in enumerate(scans):
            self._scan.publish(scan)
            self._sent += 1
            if number % 8 == 0:
                self._executor.spin_once(timeout_sec=0.0)
        sent, self._state = time.monotonic(), {}
        waiting = ("points_waiting", "tiles_waiting")

        def is_done() -> bool:
            state = self._state
            n_scans = int(state.get("scans", 0))
            return n_scans == self._sent and not any(int(state[name]) for name in waiting)

        self.wait(is_done, "tiles")
        self._state = {}  # what has been published comes with or before the next
        self.wait(is_done, "tiles")
        return sent

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()


def scans_of(flight: PointTile) -> list[PointCloud2]:
    """Return a flight as clouds of points that lie in the map already, in the order of their times."""
    layout = [*((axis, "<f4") for axis in "xyz"), *((name, COLUMNS[name]) for name in _KEPT)]
    rows = np.empty(len(flight), layout)
    rows["x"], rows["y"], rows["z"] = flight.points.T
    for name in _KEPT:
        rows[name] = getattr(flight, name)
    order = np.argsort(flight.gps_time, kind="stable")
    rows = rows[order]
    parts = np.split(rows, range(_SCAN, len(rows), _SCAN))
    return [cloud_message(round(float(one["gps_time"][0]) * _SECOND), one.reshape(1, -1)) for one in parts]


def write_flights(flights: Sequence[PointTile], frame: MapFrame, folder: Path) -> None:
    """Write each flight as a LAZ file."""
    folder.mkdir()
    for number, flight in enumerate(flights):
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = np.full(3, 0.001), np.asarray(frame.origin)
        header.add_crs(pyproj.CRS(frame.crs))
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
        las = laspy.LasData(header)
        las.x, las.y, las.z = frame.to_source(flight.points).T
        for name in ("intensity", "return_number", "number_of_returns", "point_source_id", "gps_time"):
            las[name] = getattr(flight, name)
        las.scan_angle = np.round(flight.scan_angle / 0.006).astype(np.int16)
        las.write(str(folder / f"flight_{number + 1}.laz"))


@contextmanager
def graph(output: Path, frame: MapFrame, settings: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run `lidar-buildings live` in a process of its own; it writes its files when the block ends."""
    place = ",".join(f"{one:.3f}" for one in frame.origin)
    given = ["scan_assembler.georeferenced=true", f"scan_assembler.map_crs={frame.crs}"]
    given += [f"scan_assembler.map_position={place}", *settings]
    words = ["live", "--reliable", "--output", str(output), *(w for one in given for w in ("--set", one))]
    with open(output.with_suffix(".log"), "wb") as log:
        process = subprocess.Popen([sys.executable, "-m", "lidar_buildings.cli", *words], stderr=log)
        try:
            yield process
            process.send_signal(signal.SIGINT)
            if process.wait(_PATIENCE):
                raise RuntimeError(f"live ended with status {process.returncode}: {log.name}")
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()


def flown(
    flights: Sequence[PointTile], frame: MapFrame, output: Path, settings: Sequence[str]
) -> Iterator[Published]:
    """Fly, and yield after each flight what was published; then `output` has the files."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # another's graph is not heard
    prepare_middleware(carries_scans=True)
    rclpy.init(args=[])
    listener = Listener()
    try:
        with graph(output, frame, settings) as process:
            listener.meet()
            for flight in flights:
                before, cpu = dict(listener.lines), cpu_of(tree_of(process.pid))
                listener.solved, listener.times = {}, [math.nan, math.nan]
                sent = listener.send(scans_of(flight))
                cpu, after = cpu_of(tree_of(process.pid)) - cpu, [at - sent for at in listener.times]
                yield Published(before | listener.solved, dict(listener.lines), *after, cpu)
    finally:
        listener.close()
        rclpy.shutdown()


def run_on(flights: Sequence[PointTile], frame: MapFrame, output: Path, settings: Sequence[str]) -> None:
    """Let `run` make files of the same points."""
    points = output.with_name("points")
    write_flights(flights, frame, points)
    words = [word for one in settings for word in ("--set", one)]
    command = [sys.executable, "-m", "lidar_buildings.cli", "run", str(points), "--output", str(output)]
    subprocess.run([*command, *words], check=True, capture_output=True)


def are_equal(one: Path, other: Path) -> bool:
    """Whether the layers of two results and models of two results are the same, byte for byte."""
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in _FILES)
