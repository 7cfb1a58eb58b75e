"""
Parameters written once: default, unit, range and one sentence, beside the stage that uses them.

Node declarations, ``config/pipeline.param.yaml``, ``--set`` and ``doc/nodes.md`` are generated from here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import Field, dataclass, field, fields
from functools import partial
from typing import Any, ClassVar

from lidar_buildings.core.model.bounds import MAX_PARAMETER
from lidar_buildings.core.model.errors import ParameterError

#: Area of the smallest building in plan [m²]: the default of all stages.
SMALLEST_BUILDING = 12.0
#: Stands before the name of a parameter that few users turn.
ADVANCED = "advanced."


@dataclass(frozen=True)
class ParameterSpec:
    """What is known of a parameter beside its name, type and default."""

    description: str  #: one sentence; says what raising the value does
    unit: str = ""  #: SI symbol, ``"deg"``, ``"spacings"`` (multiples of the measured point spacing) or empty
    within: tuple[float, float | None] | None = None  #: inclusive range, None where it is open
    choices: tuple[str, ...] = ()  #: the allowed words of a text or list parameter, empty where any will do
    read_only: bool = False  #: whether the value is fixed once the node has started
    #: Whether it stands among the many that few users turn, under ``<stage>.advanced`` in ROS.
    advanced: bool = False

    @property
    def is_free(self) -> bool:
        """Whether any value of its type will do."""
        return not self.choices and self.within is None

    def holds(self, number: float) -> bool:
        """Whether a number is finite, and in the range."""
        low, high = self.within or (-math.inf, None)
        return math.isfinite(number) and low <= number and (high is None or number <= high)

    def allowed(self) -> str:
        """Say in words which values are allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        unit = f" [{self.unit}]" if self.unit else ""
        if self.within is None:
            return f"a finite number{unit}"
        low, high = self.within
        return f"at least {low:g}{unit}" if high is None else f"within {low:g} to {high:g}{unit}"


def parameter(default: Any, description: str, **spec: Any) -> Any:
    """Declare a config field: its default, whose type is the parameter's, and what `ParameterSpec` holds."""
    return field(default=default, metadata={"spec": ParameterSpec(description, **spec)})


#: Those that few users turn, and those whose value is fixed once the node has started.
advanced, fixed = partial(parameter, advanced=True), partial(parameter, read_only=True)


def spec_of(config_field: Field[Any]) -> ParameterSpec:
    """Return what was declared of a config field."""
    return config_field.metadata["spec"]


@dataclass(frozen=True)
class StageConfig:
    """
    Base of every stage's config: checks types and ranges when made.

    ParameterError: naming the dotted parameter, the value and what is allowed.
    """

    stage: ClassVar[str] = ""
    #: Whether it is of no stage but of the node: its parameters carry no prefix.
    is_of_node: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for config_field in fields(self):
            value = checked_value(self.stage, config_field, getattr(self, config_field.name))
            object.__setattr__(self, config_field.name, value)


def checked_value(stage: str, config_field: Field[Any], value: Any) -> Any:
    """
    Return `value` in the parameter's own type, or say why it cannot be used.

    ParameterError if the type is wrong or the value out of range.
    """
    spec = spec_of(config_field)
    path = f"{stage}.{config_field.name}"
    kind: Any = type(config_field.default)
    if kind is float and type(value) is int:
        value = float(value)
    if kind is tuple:
        return _checked_texts(path, value, spec)
    if type(value) is not kind:
        raise ParameterError(f"{path} = {value!r}: must be of type {kind.__name__}")
    if kind is str:
        is_allowed = not spec.choices or value in spec.choices
    else:
        is_allowed = kind is bool or spec.holds(value)
    if not is_allowed:
        raise ParameterError(f"{path} = {value!r}: must be {spec.allowed()}")
    if kind in (int, float) and abs(value) > MAX_PARAMETER:
        raise ParameterError(f"{path} = {value!r}: must be at most {MAX_PARAMETER:g}")
    return value


def _checked_texts(path: str, value: Any, spec: ParameterSpec) -> tuple[str, ...]:
    if not isinstance(value, (list, tuple)) or any(type(text) is not str for text in value):
        raise ParameterError(f"{path} = {value!r}: must be a list of texts")
    if spec.choices and not set(value) <= set(spec.choices):
        raise ParameterError(f"{path} = {value!r}: each must be {spec.allowed()}")
    return tuple(value)


def parameter_names(configs: Mapping[str, type[StageConfig]]) -> dict[str, tuple[str, Field[Any]]]:
    """
    Return parameter name → (stage, config field) of a node with these stages.

    ``window`` and ``advanced.noise`` where the node has one stage, ``segmentation.window`` and
    ``segmentation.advanced.noise`` where it has several.
    """
    return {
        f"{prefix_of(stage, configs)}{ADVANCED * spec_of(one).advanced}{one.name}": (stage, one)
        for stage, config in configs.items()
        for one in fields(config)
    }


def prefix_of(stage: str, configs: Mapping[str, type[StageConfig]]) -> str:
    """Return what stands before the names of a stage's parameters, with a dot, or nothing."""
    n_stages = sum(not config.is_of_node for config in configs.values())
    return f"{stage}." if n_stages > 1 and not configs[stage].is_of_node else ""


def spellings(names: Iterable[str]) -> dict[str, str]:
    """Return what users may write → parameter name: they may leave ``advanced.`` out."""
    return {spelling: name for name in names for spelling in (name.replace(ADVANCED, "", 1), name)}


def flat_names(parameters: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and value of nested parameters, names joined by points."""
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from flat_names(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
