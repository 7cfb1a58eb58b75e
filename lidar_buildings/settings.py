"""
What the user set: a parameter file in ROS's own form and ``--set STAGE.NAME=VALUE``, by stage.

"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from lidar_buildings.core.errors import InputError, ParameterError
from lidar_buildings.core.parameters import StageConfig

#: {stage: {parameter name: value}}
Settings = dict[str, dict[str, Any]]
#: {node: {stage: config class}}
NodeConfigs = Mapping[str, Mapping[str, type[StageConfig]]]


def read_settings(params: Path | None, assignments: list[str], nodes: NodeConfigs) -> Settings:
    """
    Merge a parameter file with assignments; assignments win.

    Parameters
    ----------
    params : Path or None
        YAML as ``ros2 run … --params-file`` takes it.
    assignments : list of str
        ``STAGE.NAME=VALUE``; the name of a node stands for its stage where it has just one.
    nodes : mapping
        Which node has which stages.

    Raises
    ------
    InputError
        If the file cannot be read.
    ParameterError
        If an assignment is malformed.

    """
    settings: Settings = {}
    for stage, name, value in [*_from_file(params, nodes), *(_assignment(a, nodes) for a in assignments)]:
        settings.setdefault(stage, {})[name] = value
    return settings


def _from_file(path: Path | None, nodes: NodeConfigs) -> Iterator[tuple[str, str, Any]]:
    """
    Yield (stage, name, value) for every parameter of a file.

    """
    if path is None:
        return
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}: give --params a readable YAML file") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        place = str(error).replace("\n", " ")
        raise InputError(f"{path}: not valid YAML ({place}): compare config/pipeline.param.yaml") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: no node names at its top: compare config/pipeline.param.yaml")
    for key, body in content.items():
        node = str(key).rsplit("/", maxsplit=1)[-1]
        if node not in nodes:
            raise ParameterError(f"{path}: there is no node {node!r} (there are {', '.join(nodes)})")
        if not isinstance(body, dict) or not isinstance(body.get("ros__parameters"), dict):
            raise ParameterError(f"{path}: {key} has no ros__parameters: compare config/pipeline.param.yaml")
        for name, value in _flat(body["ros__parameters"]):
            yield (*_stage_of(node, name, nodes), value)


def _assignment(text: str, nodes: NodeConfigs) -> tuple[str, str, Any]:
    """
    Split ``STAGE.NAME=VALUE``.

    """
    path, equals, value = text.partition("=")
    stage, dot, name = path.strip().partition(".")
    if not equals or not dot or not name:
        raise ParameterError(f"--set {text}: must be STAGE.NAME=VALUE, as in ground_filter.max_distance=1.0")
    try:
        parsed = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise ParameterError(f"--set {text}: {value!r} is not a value") from error
    if stage in nodes and not any(stage in stages for stages in nodes.values()):
        stage, name = _stage_of(stage, name, nodes)
    return stage, name, parsed


def _flat(parameters: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """
    Yield (dotted name, value).

    """
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _stage_of(node: str, name: str, nodes: NodeConfigs) -> tuple[str, str]:
    """
    Return (stage, name) of a node's parameter: the stage is named where the node has several.

    """
    stages = nodes[node]
    if len(stages) == 1:
        return next(iter(stages)), name
    stage, dot, rest = name.partition(".")
    if not dot or stage not in stages:
        raise ParameterError(f"{node}.{name}: must begin with one of {', '.join(f'{s}.' for s in stages)}")
    return stage, rest
