# SPDX-License-Identifier: Apache-2.0
"""The whole graph on a live feed: lidar_buildings.launch.py with scan_assembler as the source of tiles."""

from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

_GRAPH = PathJoinSubstitution([FindPackageShare("lidar_buildings"), "launch", "lidar_buildings.launch.py"])


def generate_launch_description() -> LaunchDescription:
    """Describe the launch; ``--show-args`` lists its arguments."""
    source = PythonLaunchDescriptionSource(_GRAPH)
    return LaunchDescription(
        [IncludeLaunchDescription(source, launch_arguments={"source": "scan_assembler"}.items())]
    )
