"""``lidar-buildings node``: one node in a process of its own, for environments without `ros2 run`."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.nodes.table import NODE_TABLE


def node_command(options: argparse.Namespace) -> int:
    """
    Run a node until it is done or interrupted; return its exit status.

    ParameterError if there is no such node, or ROS is not installed.
    """
    names = [card.name for card in NODE_TABLE]
    if options.name not in names:
        raise ParameterError(f"node {options.name}: must be one of {', '.join(names)}")
    try:
        module = import_module(f"lidar_buildings.nodes.{options.name}")
    except ModuleNotFoundError as error:
        raise ParameterError(f"node: {error.name} is not installed: pip install '.[ros]'") from error
    sys.argv = [options.name, *options.arguments]  # where ROS looks for its arguments
    return getattr(module, options.name.title().replace("_", "")).main()
