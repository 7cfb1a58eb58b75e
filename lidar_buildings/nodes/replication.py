"""
Several nodes of one kind that share their tiles: which, and with what parameters.

It needs no ROS.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import flat_names
from lidar_buildings.core.model.replicas import MAX_REPLICAS
from lidar_buildings.core.model.stage_table import STAGE_TABLE

#: Nodes that may have replicas.
REPLICABLE = tuple(stage.node for stage in STAGE_TABLE)


def replicas_of(text: str) -> dict[str, int]:
    """
    Return node → how many share its tiles, of ``roof_selector:2,model_builder:2``.

    ParameterError if a node cannot have replicas, or a number is none.
    """
    found: dict[str, int] = {}
    for word in filter(None, (one.strip() for one in text.split(","))):
        node, _, number = word.partition(":")
        if node not in REPLICABLE:
            raise ParameterError(f"replicas: {word}: the node must be one of {', '.join(REPLICABLE)}")
        if not number.isdecimal() or not 1 <= int(number) <= MAX_REPLICAS:
            raise ParameterError(
                f"replicas: {word}: must be NODE:NUMBER with a number from 1 to {MAX_REPLICAS}"
            )
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
