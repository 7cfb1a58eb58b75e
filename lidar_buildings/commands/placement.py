"""Arguments of a launch: which machine runs which nodes, and which nodes share tiles. It needs no ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.model.parameters import flat_names
from lidar_buildings.core.model.replicas import MAX_REPLICAS
from lidar_buildings.core.model.stage_table import STAGE_TABLE


def replicas_of(text: str) -> dict[str, int]:
    """Return node → how many share its tiles, of ``roof_selector:2,model_builder:2``; else ParameterError."""
    found: dict[str, int] = {}
    replicable = [stage.node for stage in STAGE_TABLE]
    for word in filter(None, (one.strip() for one in text.split(","))):
        node, _, number = word.partition(":")
        if node not in replicable:
            raise ParameterError(f"replicas: {word}: the node must be one of {', '.join(replicable)}")
        if not number.isdecimal() or not 1 <= int(number) <= MAX_REPLICAS:
            raise ParameterError(f"replicas: {word}: must be NODE:NUMBER, from 1 to {MAX_REPLICAS}")
        found[node] = int(number)
    return found


def replica_name(node: str, number: int, n_replicas: int) -> str:
    """Return what a replica is called, its kind's name where there is one alone."""
    return f"{node}_{number}" if n_replicas > 1 else node


def share_parameters(
    number: int, n_replicas: int, params_files: Iterable[str | Path], node: str
) -> dict[str, Any]:
    """
    Return the parameters of replica `number`: its share, and what parameter files say of its kind.

    ROS finds parameters in a file by the name of a node, which each replica has its own of.
    """
    found: dict[str, Any] = {}
    for path in filter(None, map(str, params_files)):
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        for key, body in (content if isinstance(content, Mapping) else {}).items():
            if str(key).rpartition("/")[2] == node:
                found |= dict(flat_names((body or {}).get("ros__parameters") or {}))
    return found | {"replica": number, "replicas": n_replicas}


def nodes_of(machine: str, path: str | Path, nodes: Collection[str]) -> set[str]:
    """
    Return which nodes a machine has, of a YAML file ``machine: [node, node]``, replicas with their numbers.

    InputError if the file cannot be read; ParameterError if it has no such machine, or a node of the graph is
    not on exactly one.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())})") from error
    if not isinstance(content, dict) or not all(isinstance(one, list) for one in content.values()):
        raise InputError(f"{path}: must have a list of nodes for each machine, as 'disks: [tile_player]'")
    if machine not in content:
        has = ", ".join(map(str, content))
        raise ParameterError(f"machine: {machine}: {path} has {has}: give machine:=NAME")
    counts = Counter(str(node) for of_machine in content.values() for node in of_machine)
    if unknown := sorted(counts.keys() - set(nodes)):
        raise ParameterError(f"{path}: {unknown[0]}: the graph has {', '.join(nodes)}")
    if wrong := [node for node in nodes if counts[node] != 1]:
        raise ParameterError(f"{path}: {wrong[0]}: must be on one machine, and is on {counts[wrong[0]]}")
    return {str(node) for node in content[machine]}
