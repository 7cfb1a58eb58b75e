"""`lidar-buildings simulate` with a scanner on the move."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter

import laspy
import numpy as np
import pytest
from support.ros_domain import use_own_domain
from support.waiting import wait_until

from lidar_buildings.cli import command_parser
from lidar_buildings.commands.simulate_live import survey_of
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag import Bag
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.placed_cloud import write_placed
from lidar_buildings.simulation.live import Scan
from lidar_buildings.simulation.live.airborne import MOUNTING

SMALL = ("--scene", "single_house", "--density", "2", "--pulse-rate", "60000")


def rows(spoken, word):
    return [line for line in spoken.out if word in line]


def test_a_bag_and_files_of_the_same_points_are_written_without_ros(command, tmp_path):
    spoken = command("simulate", *SMALL, "--bag", tmp_path / "bag", "--output", tmp_path / "out", "--no-tf")
    assert (spoken.status, spoken.err) == (0, [])
    assert rows(spoken, f"--set scan_assembler.mounting={MOUNTING}")
    count = write_placed(
        tmp_path / "bag", tmp_path / "placed.laz", BagConfig(), ScanConfig(mounting=MOUNTING)
    )
    assert count.n_points == len(laspy.read(tmp_path / "out" / "strip_01.laz")) > 1000
    assert (tmp_path / "out" / "truth.gpkg").exists()


def test_a_vehicles_scanner_and_poses_are_as_asked_for():
    arguments = ("--scanner", "vehicle", "--beams", "64", "--top", "2", "--pose-noise", "0.02,0.1")
    options = command_parser().parse_args(["simulate", *arguments, "--details", "--scene", "dense_block"])
    survey = survey_of(options)
    (scan, *_) = (event for event in survey.events() if isinstance(event, Scan))
    assert scan.rows.shape == (64, 512)
    up = np.arctan2(scan.rows["z"], np.hypot(scan.rows["x"], scan.rows["y"]))
    assert np.rad2deg(up.max()) == pytest.approx(2.0, abs=0.01)
    assert survey.legs[0].unrest is not None
    assert survey.scene.is_detailed


def test_a_vehicle_gives_a_bag(command, tmp_path):
    arguments = ("--scanner", "vehicle", "--scene", "dense_block", "--pulse-rate", "4000")
    spoken = command("simulate", *arguments, "--bag", tmp_path / "bag")
    assert (spoken.status, spoken.err) == (0, [])
    with Bag(tmp_path / "bag") as bag:
        names = {topic.name for topic in bag.topics}
    assert names == {"/scan", "/odometry", "/tf", "/tf_static", "/clock", "/map_origin"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "give --output DIR, --live or --bag DIR"),
        (["--scanner", "vehicle"], "give --output DIR, --live or --bag DIR"),
        (["--scanner", "vehicle", "--density", "3", "--bag", "b"], "--density"),
        (["--scanner", "vehicle", "--scene", "single_house", "--bag", "b"], "no street"),
        (["--scanner", "vehicle", "--pulse-rate", "3", "--bag", "b"], "vehicle.pulse_rate = 3"),
        (["--pulse-rate", "-3", "--bag", "b"], "pulse rate = -3"),
        (["--scanner", "boat", "--bag", "b"], "'boat'"),
        (["--scanner", "vehicle", "--pose-noise", "3", "--bag", "b"], "'3'"),
        (["--beams", "64", "--output", "b"], "--beams applies only to a vehicle"),
        (["--pose-drift", "0.1,0", "--bag", "b"], "--pose-drift applies only to a vehicle"),
    ],
)
def test_what_cannot_be_simulated_gives_one_line(command, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in command.refused("simulate", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_bag_or_folder_that_is_there_is_kept(command, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "file").write_text("mine")
    assert "already exists" in command.refused("simulate", *SMALL, "--bag", tmp_path / "mine")
    assert "is not empty" in command.refused("simulate", *SMALL, "--live", "--output", tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["file"]


class Ear:
    """Hears what a virtual scanner says, in a thread of its own."""

    def __init__(self, namespace, topics):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        from lidar_buildings.commands.live_publisher import message_class
        from lidar_buildings.simulation.live.messages import LATCHED, TYPES

        self.heard, self.stamps = Counter(), []
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node("ear", context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for topic in topics:
            latched = DurabilityPolicy.TRANSIENT_LOCAL if topic in LATCHED else DurabilityPolicy.VOLATILE
            qos = QoSProfile(depth=1000, durability=latched, reliability=ReliabilityPolicy.RELIABLE)
            self._node.create_subscription(
                message_class(TYPES[topic]), topic, lambda message, topic=topic: self._on(topic, message), qos
            )
        self._thread = threading.Thread(target=self._executor.spin)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _on(self, topic, message):
        self.heard[topic] += 1
        if topic == "scan":
            self.heard["points"] += message.width * message.height
        if topic == "odometry":
            self.stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


@pytest.mark.graph
@pytest.mark.parametrize("origin", ["map_origin", "fix"])
def test_a_subscriber_hears_all_of_it_in_real_time(command, tmp_path, origin):
    pytest.importorskip("rclpy")
    use_own_domain()
    more = ("--fix",) if origin == "fix" else ()
    with Ear("live_ear", ["scan", "odometry", "/clock", origin]) as ear:
        begin = time.monotonic()
        spoken = command(
            *("simulate", "--live", "--reliable", "--namespace", "live_ear", *SMALL, *more),
            *("--output", tmp_path / "out"),
        )
        wall_time = time.monotonic() - begin
        assert (spoken.status, spoken.err) == (0, [])
        n_points = len(laspy.read(tmp_path / "out" / "strip_01.laz"))
        # what was sent has arrived, and is heard soon, topic by topic
        wait_until(lambda: ear.heard["points"] == n_points and ear.heard[origin])
        wait_until(lambda: abs(ear.heard["/clock"] - len(ear.stamps) / 2) <= 2)
        stamps = list(ear.stamps)
    assert rows(spoken, f"{n_points:,} points in {ear.heard['scan']} scans")
    seconds = (stamps[-1] - stamps[0]) * 1e-9
    assert len(stamps) == round(seconds * 200) + 1
    assert wall_time > seconds > 0.3


@pytest.mark.graph
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_and_leaves_a_whole_bag_and_whole_files(tmp_path, number):
    pytest.importorskip("rclpy")
    use_own_domain()
    slow = ("--scene", "single_house", "--density", "50", "--pulse-rate", "20000", "--live", "--no-wait")
    to = ("--bag", str(tmp_path / "bag"), "--output", str(tmp_path / "out"))
    process = subprocess.Popen(
        [sys.executable, "-m", "lidar_buildings.cli", "simulate", *slow, *to],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    # until the first scans were made
    wait_until(lambda: list((tmp_path / "out").glob(".strip_01*")) or process.poll() is not None)
    process.send_signal(number)
    out, err = process.communicate(timeout=120.0)
    assert (process.returncode, err) == (0, "")
    assert " points in " in out
    n_points = len(laspy.read(tmp_path / "out" / "strip_01.laz"))
    with Bag(tmp_path / "bag") as bag:
        told = sum(one.message.width for one in bag.messages(["/scan"]))
    assert 0 < told == n_points
    assert (tmp_path / "out" / "truth.gpkg").exists()
