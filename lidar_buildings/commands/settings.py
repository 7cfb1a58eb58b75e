"""What the user set: presets, parameter files in ROS's own form and ``--set STAGE.NAME=VALUE``, by stage."""

from __future__ import annotations

import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.model.parameters import (
    ADVANCED,
    checked_value,
    flat_names,
    parameter_names,
    spellings,
)
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.config import nearest

#: {stage: {parameter name: value}}
Settings = dict[str, dict[str, Any]]
#: Every stage's config class, and those of sources and results.
CONFIGS = {stage: config for stages in NODE_CONFIGS.values() for stage, config in stages.items()}

_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")
_COMPARE = "compare config/pipeline.param.yaml"
_FORM = "must be STAGE.NAME=VALUE, as in roof_selection.min_height=2.5"
#: The papers whose whole chain one word chooses, each with a page in `doc/papers` and a parameter file.
PRESETS = ("santos", "villalba", "sampath_shan")


def read_settings(params: Path | None, assignments: list[str], *, preset: Path | None = None) -> Settings:
    """
    Merge a preset, a parameter file and assignments; assignments win, then the file.

    The file is YAML as ``ros2 run … --params-file`` takes it; assignments are ``STAGE.NAME=VALUE``, where the
    name of a node stands for its stage if it has just one, and ``advanced.`` before a parameter's name may be
    left out. InputError if a file cannot be read; ParameterError if an assignment is malformed, a name is
    unknown, a value not allowed, or one parameter has two values in a file.
    """
    settings: Settings = {}
    for path in filter(None, (preset, params)):
        try:
            for stage, given in _read_file(path).items():
                settings.setdefault(stage, {}).update(given)
        except RecursionError:
            what = "an anchor refers to itself, or values are nested too deeply"
            raise InputError(f"{path}: {what}: {_COMPARE}") from None
    for text in assignments:
        stage, name, value = _assignment(text)
        settings.setdefault(stage, {})[name] = value
    return settings


def _read_file(path: Path) -> Settings:
    settings: Settings = {}
    for key, body in _content(path).items():
        node = str(key).rsplit("/", maxsplit=1)[-1]
        if node not in NODE_CONFIGS:
            raise ParameterError(f"{path}: there is no node {node!r}{nearest(node, NODE_CONFIGS)}")
        if not isinstance(body, dict) or not isinstance(body.get("ros__parameters"), dict):
            raise ParameterError(f"{path}: {key} has no ros__parameters: {_COMPARE}")
        for given, content in flat_names(body["ros__parameters"]):
            stage, name, value = _checked(str(path), *_stage_of(str(path), node, given), content)
            if settings.setdefault(stage, {}).setdefault(name, value) != value:
                raise ParameterError(
                    f"{path}: two nodes set {stage}.{name}, to {settings[stage][name]!r} and {value!r}: "
                    "give one value"
                )
    return settings


def _content(path: Path) -> dict[Any, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}: give --params a readable YAML file") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where, mark = " ".join(str(error).split()), getattr(error, "problem_mark", None)
        if mark is not None:
            where = f"line {mark.line + 1}, column {mark.column + 1}: {getattr(error, 'problem', None)}"
        raise InputError(f"{path}: not valid YAML ({where}): {_COMPARE}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: no node names at its top: {_COMPARE}")
    return content


def _assignment(text: str) -> tuple[str, str, Any]:
    path, equals, value = text.partition("=")
    stage, dot, name = path.strip().partition(".")
    if not equals or not dot or not name:
        raise ParameterError(f"--set {text}: {_FORM}")
    try:
        parsed = yaml.safe_load(value)
    except (yaml.YAMLError, RecursionError) as error:
        raise ParameterError(f"--set {text}: {value!r} is not a value: {_FORM}") from error
    if stage in NODE_CONFIGS and stage not in CONFIGS:
        stage, name = _stage_of("--set", stage, name)
    return _checked("--set", stage, name, parsed)


def _checked(origin: str, stage: str, name: str, value: Any) -> tuple[str, str, Any]:
    """Return stage, name and the value in its own type, or refuse them."""
    if stage not in CONFIGS:
        raise ParameterError(f"{origin}: there is no stage {stage!r}{nearest(stage, CONFIGS)}")
    members = parameter_names({stage: CONFIGS[stage]})
    known = spellings(members)
    if name not in known:
        meant = nearest(name.removeprefix(ADVANCED), [one.name for _, one in members.values()])
        raise ParameterError(f"{origin}: there is no parameter {stage}.{name}{meant}")
    _, one = members[known[name]]
    # as ROS understands the same YAML
    if isinstance(value, list) and not any(value):
        value = []  # an empty list of texts is written as one empty text
    elif isinstance(value, str) and _EXPONENT.fullmatch(value):
        value = float(value)  # 1e-3 is a text to YAML 1.1
    try:
        return stage, one.name, checked_value(stage, one, value)
    except ParameterError as error:
        raise ParameterError(f"{origin}: {error}") from error


def _stage_of(origin: str, node: str, name: str) -> tuple[str, str]:
    """Return (stage, name) of a node's parameter: the stage is named where the node has several."""
    for stage, config in NODE_CONFIGS[node].items():
        if config.is_of_node and name in {one.name for one in fields(config)}:
            return stage, name
    stages = [stage for stage, config in NODE_CONFIGS[node].items() if not config.is_of_node]
    if len(stages) == 1:
        return next(iter(stages)), name
    stage, dot, rest = name.partition(".")
    if not dot or stage not in stages:
        prefixes = ", ".join(f"{stage}." for stage in stages)
        raise ParameterError(f"{origin}: {node}.{name}: the name must begin with one of {prefixes}")
    return stage, rest


def preset_file(name: str) -> Path:
    """Return a preset's parameter file; ParameterError if there is no such preset, InputError no file."""
    if name not in PRESETS:
        raise ParameterError(f"--preset {name}: must be one of {', '.join(PRESETS)}")
    found = shared_file(f"{name}.param.yaml")
    if found is None:
        raise InputError(f"{name}.param.yaml: not found next to pipeline.param.yaml: give it with --params")
    return found


def shared_file(name: str) -> Path | None:
    """Return a file of `config`: as a ROS workspace or pip installed it, or beside the source."""
    package = Path(__file__).resolve().parents[1]
    candidates = [package.parent / "config" / name]
    try:
        from ament_index_python.packages import get_package_share_directory

        candidates.append(Path(get_package_share_directory(package.name), "config", name))
    except (ImportError, LookupError, OSError):  # no ament, no such package, no AMENT_PREFIX_PATH
        pass
    candidates.append(Path(sys.prefix, "share", package.name, "config", name))
    return next((path for path in candidates if path.is_file()), None)
