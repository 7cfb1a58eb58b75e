"""
Which nodes of a graph run on which machine. It needs no ROS.

A launch of ROS 2 starts processes of its own host alone: started on each, it takes its nodes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from pathlib import Path

import yaml

from lidar_buildings.core.model.errors import InputError, ParameterError


def nodes_of(machine: str, path: str | Path, nodes: Collection[str]) -> set[str]:
    """
    Return which nodes a machine has, of a YAML file ``machine: [node, node]``, replicas with their numbers.

    InputError if the file cannot be read; ParameterError if it has no such machine, or a node of the graph is
    not on exactly one.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise InputError(
            f"{path}: cannot be read ({' '.join(str(error).split())}): check the file"
        ) from error
    if not isinstance(content, dict) or not all(isinstance(one, list) for one in content.values()):
        raise InputError(f"{path}: must have a list of nodes for each machine, as 'disks: [tile_player]'")
    if machine not in content:
        raise ParameterError(
            f"machine: {machine}: {path} has {', '.join(map(str, content))}: give machine:=NAME"
        )
    counts = Counter(str(node) for of_machine in content.values() for node in of_machine)
    if unknown := sorted(counts.keys() - set(nodes)):
        raise ParameterError(f"{path}: {unknown[0]}: the graph has {', '.join(nodes)}")
    if wrong := [node for node in nodes if counts[node] != 1]:
        raise ParameterError(f"{path}: {wrong[0]}: must be on one machine, and is on {counts[wrong[0]]}")
    return {str(node) for node in content[machine]}
