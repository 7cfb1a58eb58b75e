"""One node in a process of its own: ``lidar-buildings node``, and the executables of a ROS workspace."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import yaml

from lidar_buildings.commands.versions import check_versions
from lidar_buildings.core.model.errors import ExitStatus, InputError, LidarBuildingsError, ParameterError
from lidar_buildings.nodes.table import NODE_TABLE

_OPTION = "--params-file"


def node_command(options: argparse.Namespace) -> int:
    """Run a node, return its exit status; LidarBuildingsError if there is no such node or library."""
    names = [card.name for card in NODE_TABLE]
    if options.name not in names:
        raise ParameterError(f"node {options.name}: must be one of {', '.join(names)}")
    sys.argv = [options.name, *options.arguments]  # where ROS looks for its arguments
    return _run(options.name)


def node_process(name: str = "") -> int:
    """Run the node after which the executable is named; 2, and one line on stderr, if it cannot run."""
    try:
        check_versions()
        return _run(name or Path(sys.argv[0]).name)
    except LidarBuildingsError as error:
        sys.stderr.write(" ".join(str(error).split()) + "\n")
        return ExitStatus.WRONG_USE


def _run(name: str) -> int:
    try:
        from lidar_buildings.nodes.graph import node_class
        from lidar_buildings.ros.runner import run_node

        kind = node_class(name)
    except ImportError as error:
        raise LidarBuildingsError(
            f"node {name}: {error}: source a ROS 2 workspace, or pip install '.[ros]' in the sources"
        ) from error
    check_parameter_files(sys.argv)
    return run_node(kind)


def check_parameter_files(arguments: Sequence[str]) -> None:
    """Read every file that ``--params-file`` names; InputError if one is not of the form that ROS takes."""
    for path in (Path(value) for option, value in pairwise(arguments) if option == _OPTION):
        try:
            # parsed, not constructed: launch files tag lists as Python's tuples, which ROS takes as lists
            content = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}: give {_OPTION} a readable YAML file") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            place = " ".join(str(error).split())
            raise InputError(f"{path}: not valid YAML ({place}): compare pipeline.param.yaml") from error
        if content is not None and not isinstance(content, yaml.MappingNode):
            raise InputError(f"{path}: no node names at its top: compare pipeline.param.yaml")
