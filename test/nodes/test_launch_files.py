"""Both launch files, with stubs for nodes; they run where launch is, as in a ROS workspace."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest
from support.source_tree import ROOT

from lidar_buildings.nodes.table import NODE_TABLE

pytest.importorskip("launch_ros")

#: As `ros2 launch lidar_buildings FILE ARGUMENTS`.
PROGRAM = """
import sys
from launch import LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
service = LaunchService(noninteractive=True)
given = [one.split(":=", 1) for one in sys.argv[2:]]
graph = IncludeLaunchDescription(PythonLaunchDescriptionSource(sys.argv[1]), launch_arguments=given)
service.include_launch_description(graph)
sys.exit(service.run())
"""
#: A source ends at once, other nodes at SIGINT; a writer has finished its files when `done` is there.
STUB = """#!/bin/sh
name=$(basename $0)
echo $$ >> $STUBS/$name.pids
[ $name = "$WRONG" ] && exit 2
[ $name = tile_player ] && exit 0
trap 'interrupted=1' INT
while [ -z "$interrupted" ]; do
  [ $name = model_writer ] && [ -e $STUBS/done ] && exit 0
  sleep 0.05
done
[ $name = model_writer ] && sleep ${SLOW:-0} && touch $STUBS/files
exit 0
"""


class Launched:
    """A launch of stubs."""

    def __init__(self, folder, file, *arguments, **environment):
        self.folder = folder
        prefix = folder / "prefix"
        executables, shared = prefix / "lib/lidar_buildings", prefix / "share/lidar_buildings"
        index = prefix / "share/ament_index/resource_index/packages"
        for one in (executables, shared, index):
            one.mkdir(parents=True)
        (index / "lidar_buildings").touch()
        for one in ("launch", "config"):
            (shared / one).symlink_to(ROOT / one)
        for card in NODE_TABLE:
            (executables / card.name).write_text(STUB)
            (executables / card.name).chmod(0o755)
        own = {
            "AMENT_PREFIX_PATH": str(prefix),
            "STUBS": str(folder),
            "ROS_LOG_DIR": str(folder),
            **environment,
        }
        command = [sys.executable, "-c", PROGRAM, str(ROOT / "launch" / file), *arguments]
        self.process = subprocess.Popen(
            command, env=os.environ | own, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    def pids(self, name, n=1):
        """Return the processes of a node, once there have been so many."""
        until = time.monotonic() + 120
        file = self.folder / f"{name}.pids"
        while not file.exists() or len(file.read_text().split()) < n:
            assert time.monotonic() < until, f"{name} was not started {n} times"
            time.sleep(0.05)
        return [int(one) for one in file.read_text().split()]

    def end(self):
        """Return what was printed, when all has ended and nothing is left over."""
        said, _ = self.process.communicate(timeout=120)
        for file in self.folder.glob("*.pids"):
            for pid in file.read_text().split():
                assert not os.path.exists(f"/proc/{pid}"), file.stem
        return said


def test_a_node_that_dies_is_started_again_and_one_that_has_finished_is_not(tmp_path):
    arguments = ("input:=a.laz", f"output:={tmp_path}/result", "respawn:=true")
    launched = Launched(tmp_path, "lidar_buildings.launch.py", *arguments)
    os.kill(launched.pids("plane_fitter")[0], signal.SIGKILL)
    launched.pids("plane_fitter", 2)
    launched.pids("model_writer")
    (tmp_path / "done").touch()
    said = launched.end()
    assert len(launched.pids("tile_player")) == 1
    assert len(re.findall("process has died", said)) == 1


def test_wrong_parameters_end_the_launch_even_if_nodes_that_die_are_started_again(tmp_path):
    arguments = ("input:=a.laz", f"output:={tmp_path}/result", "respawn:=true")
    launched = Launched(tmp_path, "lidar_buildings.launch.py", *arguments, WRONG="roof_selector")
    launched.end()
    assert len(launched.pids("roof_selector")) == 1


def test_a_writer_has_longer_than_five_seconds_to_finish_its_files(tmp_path):
    launched = Launched(tmp_path, "live.launch.py", f"output:={tmp_path}/result", SLOW="7")
    for card in NODE_TABLE:
        if card.name not in ("tile_player", "recorder"):
            launched.pids(card.name)
    launched.process.send_signal(signal.SIGINT)
    assert "SIGTERM" not in launched.end()
    assert (tmp_path / "files").exists()
