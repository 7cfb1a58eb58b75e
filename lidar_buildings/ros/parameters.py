"""Config dataclasses as ROS parameters: declared from them, read back into them, changed at run time."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import Field, asdict, replace
from difflib import get_close_matches
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import (
    ADVANCED,
    StageConfig,
    checked_value,
    parameter_names,
    spec_of,
    spellings,
)

Config = TypeVar("Config", bound=StageConfig)

_MAX_INTEGER = 2**63 - 1
#: Parameters that rclpy declares for every node.
_BUILT_IN = ("use_sim_time", "start_type_description_service")


def ros_value(value: Any) -> Any:
    """Return a config value as ROS holds it: ROS lists have no type when empty, an empty one is [""]."""
    return (list(value) or [""]) if isinstance(value, tuple) else value


def config_value(value: Any) -> Any:
    """Return a ROS value as a config holds it."""
    return tuple(text for text in value if text != "") if isinstance(value, list | tuple) else value


def parameter_overrides(
    configs: Mapping[str, type[StageConfig]], settings: Mapping[str, Mapping[str, Any]]
) -> list[Parameter]:
    """Return a node's start values from ``{stage: {name: value}}``; other nodes' stages are left out."""
    return [
        Parameter(name, value=ros_value(settings[stage][one.name]))
        for name, (stage, one) in parameter_names(configs).items()
        if one.name in settings.get(stage, {})
    ]


def descriptor_of(config_field: Field[Any]) -> ParameterDescriptor:
    """Return what ROS tools show of a parameter: description, unit, inclusive range, if it can change."""
    spec = spec_of(config_field)
    unit = f" [{spec.unit}]" if spec.unit else ""
    descriptor = ParameterDescriptor(
        description=f"{spec.description}{unit}",
        additional_constraints="" if spec.is_free else spec.allowed(),
        read_only=spec.read_only,
    )
    if spec.within is None:
        return descriptor
    low, high = spec.within
    if isinstance(config_field.default, float):
        most = sys.float_info.max if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=most)]
    else:
        most = _MAX_INTEGER if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=most, step=1)]
    return descriptor


class NodeParameters:
    """
    A node's parameters, kept as the config dataclasses of its stages and declared at it.

    `parameter_names` says how their members are called; start values may leave ``advanced.`` out, and may
    have the stage's name in front. The node declares its start values by itself.
    ParameterError, in one line, if one has the wrong type or is out of range, or a name is unknown.
    """

    def __init__(self, node: Node, configs: Mapping[str, type[StageConfig]]) -> None:
        self._name = node.get_name()
        self._fields = parameter_names(configs)
        members = self._members(self._start_values(node))
        self._configs = {stage: kind(**members.get(stage, {})) for stage, kind in configs.items()}
        for name, (stage, one) in self._fields.items():
            value = ros_value(getattr(self._configs[stage], one.name))
            node.declare_parameter(name, value, descriptor_of(one), ignore_override=True)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(lambda new: self._configs.update(self._changed(new)))

    def __getitem__(self, config: type[Config]) -> Config:
        """Return a stage's config as it is now."""
        return self._configs[config.stage]  # type: ignore[return-value]

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return ``{stage: {name: value}}``."""
        return {stage: asdict(config) for stage, config in self._configs.items()}

    def _start_values(self, node: Node) -> dict[str, Any]:
        """Return the start values by our names, which are left to be declared; refuse a wrong one."""
        known = spellings(self._fields)
        for name, (stage, one) in self._fields.items():
            known |= {f"{stage}.{one.name}": name, f"{stage}.{ADVANCED}{one.name}": name}
        given = {}
        for name, one in node.get_parameters_by_prefix("").items():
            if name in _BUILT_IN or name.startswith("qos_overrides."):
                continue
            if name not in known:
                near = get_close_matches(name, known, n=1)
                hint = f"did you mean {known[near[0]]}?" if near else f"there are {', '.join(self._fields)}"
                raise ParameterError(f"{self._name}.{name}: there is no such parameter ({hint})")
            node.undeclare_parameter(name)
            given[known[name]] = one.value
        return given

    def _members(self, given: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        """Return ``{stage: {name: value}}`` of values by the parameters' names, or refuse one."""
        members: dict[str, dict[str, Any]] = {}
        for name, value in given.items():
            stage, one = self._fields[name]
            path = f"{self._name}.{name}"[: -len(one.name) - 1]
            members.setdefault(stage, {})[one.name] = checked_value(path, one, config_value(value))
        return members

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._changed(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _changed(self, parameters: list[Parameter]) -> dict[str, StageConfig]:
        """Return the configs that new values make, which check them against one another."""
        members = self._members({one.name: one.value for one in parameters if one.name in self._fields})
        return {stage: replace(self._configs[stage], **new) for stage, new in members.items()}
