"""What is said of a building, and the parameters that bear on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import Field, fields
from typing import Any, NamedTuple, TypeVar

from lidar_buildings.core.model.parameters import StageConfig, spec_of
from lidar_buildings.pipeline.config import STAGE_CONFIGS
from lidar_buildings.report.summary_words import changed_parameters

_Config = TypeVar("_Config", bound=StageConfig)


class Finding(NamedTuple):
    """One line, and which parameters would change what it tells."""

    text: str
    parameters: tuple[str, ...] = ()  #: ``stage.name``


class Limits:
    """The values of a run's parameters, of which many are multiples of the building's point spacing [m]."""

    def __init__(self, run: dict[str, Any], spacing: float) -> None:
        self._told = run.get("parameters", {})
        self._spacing = spacing

    def value(self, parameter: str) -> Any:
        """Return what a parameter was set to; lengths in spacings as metres."""
        value, member = self._of(parameter)
        return value * self._spacing if spec_of(member).unit == "spacings" else value

    def config(self, kind: type[_Config]) -> _Config:
        """Return a stage's config as it was in the run."""
        told = {f"{kind.stage}.{one.name}" for one in fields(kind)}
        return kind(**{name.split(".")[1]: self._of(name)[0] for name in told})

    def lines(self, parameters: Iterable[str]) -> list[str]:
        """Return a line on each of some parameters, those first that differ from their defaults."""
        once = dict.fromkeys(parameters)
        return [self._line(one) for one in sorted(once, key=lambda one: not self._is_changed(one))]

    def other_changes(self, parameters: Iterable[str]) -> list[str]:
        """Return a line on each stage's parameter that differs from its default and is not among these."""
        known = set(parameters)
        return [
            f"{name} = {value}, the default is {default}"
            for name, value, default in changed_parameters({"parameters": self._told})
            if name not in known and name.split(".")[0] in STAGE_CONFIGS
        ]

    def _is_changed(self, parameter: str) -> bool:
        value, member = self._of(parameter)
        return bool(value != member.default)

    def _line(self, parameter: str) -> str:
        value, member = self._of(parameter)
        unit = spec_of(member).unit
        here = f", {value * self._spacing:.2f} m here" if unit == "spacings" else ""
        changed = f", the default is {member.default}" if self._is_changed(parameter) else ""
        return f"{parameter} = {value} {unit}".rstrip() + f"{here}{changed}: {spec_of(member).description}"

    def _of(self, parameter: str) -> tuple[Any, Field[Any]]:
        stage, name = parameter.split(".")
        member = next(one for one in fields(STAGE_CONFIGS[stage]) if one.name == name)
        return self._told.get(stage, {}).get(name, member.default), member
