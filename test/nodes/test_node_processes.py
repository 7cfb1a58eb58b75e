"""What a user sees of a node that cannot start: one line, exit status 2, no traceback."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from support.cloud_files import random_cloud
from support.node_bench import wait_until
from support.ros_domain import use_own_domain

from lidar_buildings.ros.node_state import TOPIC, state_of
from lidar_buildings.ros.qos import LATCHED_EVENT

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[2]


def command(node, *arguments):
    use_own_domain()
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    program = f"from lidar_buildings.commands.node import node_process; exit(node_process('{node}'))"
    return [sys.executable, "-c", program, *arguments], os.environ | {"PYTHONPATH": path}


def run(node, *arguments):
    line, environment = command(node, *arguments)
    return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)


def assert_one_line(result, *words):
    assert result.returncode == 2, result.stderr
    lines = [line for line in result.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, result.stderr
    for word in words:
        assert word in lines[0]


def test_an_unknown_parameter_is_named_with_the_nearest_one(tmp_path):
    result = run("ground_filter", "--ros-args", "-p", "ground_distanse:=0.5")
    assert_one_line(result, "ground_filter.ground_distanse", "did you mean ground_distance?")


@pytest.mark.parametrize("content", [None, "a: [", "just text"])
def test_a_parameter_file_that_cannot_be_read_is_one_line(tmp_path, content):
    file = tmp_path / "mine.yaml"
    if content is not None:
        file.write_text(content)
    result = run("plane_fitter", "--ros-args", "--params-file", str(file))
    assert_one_line(result, "mine.yaml")


def test_a_player_without_input_says_what_to_do():
    assert_one_line(run("tile_player"), "no input: give at least one LAS or LAZ file")


def test_a_writer_refuses_a_folder_that_is_not_empty(tmp_path):
    cloud = tmp_path / "cloud.laz"
    random_cloud(20).write(cloud)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("keep me")
    given = ["-p", f"input:=['{cloud}']", "-p", f"output:={tmp_path / 'out'}"]
    assert_one_line(run("model_writer", "--ros-args", *given), "is not empty", "--overwrite")
    assert (tmp_path / "out" / "mine.txt").read_text() == "keep me"


def is_caught(pid, number):
    """Whether a process has a handler for a signal."""
    caught = Path(f"/proc/{pid}/status").read_text().split("SigCgt:")[1].split()[0]
    return bool(int(caught, 16) >> (number - 1) & 1)


def wait_until_it_spins(name, context):
    """Wait until a node has said that it is there, which it does last before it spins."""
    listener = Node("listener", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    heard = set()
    listener.create_subscription(
        String, TOPIC, lambda message: heard.add(state_of(message).node), LATCHED_EVENT
    )
    wait_until(lambda: executor.spin_once(timeout_sec=0.1) or name in heard)
    executor.shutdown()
    listener.destroy_node()


def assert_ends_quietly(process, number):
    process.send_signal(number)
    process.send_signal(number)  # as a launch system does
    _, errors = process.communicate(timeout=120)
    assert errors == ""
    assert process.returncode == 0


@contextmanager
def started(node):
    line, environment = command(node)
    with subprocess.Popen(line, env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_interrupted_ends_quietly(number, context):
    with started("outline_regulariser") as process:
        wait_until_it_spins("outline_regulariser", context)
        assert_ends_quietly(process, number)


def test_a_node_that_is_interrupted_while_it_starts_ends_quietly():
    with started("outline_regulariser") as process:
        wait_until(lambda: is_caught(process.pid, signal.SIGTERM))
        assert_ends_quietly(process, signal.SIGTERM)


@pytest.mark.parametrize("missing", ["rclpy", "numba"])
def test_a_library_that_is_missing_is_one_line(missing):
    (python, option, program, *_), environment = command("ground_filter")
    line = [python, option, f"import sys; sys.modules[{missing!r}] = None; {program}"]
    result = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert_one_line(result, "node ground_filter", missing)
