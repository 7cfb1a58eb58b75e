"""The configs of all stages, by name."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import field, fields, make_dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.model.stage_table import STAGE_TABLE


def _config_of(name: str) -> type[StageConfig]:
    declared = vars(import_module(f"lidar_buildings.core.stages.{name}.config")).values()
    return next(one for one in declared if getattr(one, "stage", "") == name)


#: Stage name → its config class, in the order of the chain.
STAGE_CONFIGS = {name: _config_of(name) for stage in STAGE_TABLE for name in stage.configs}

_Members = make_dataclass(
    "_Members",
    [(name, kind, field(default_factory=kind)) for name, kind in STAGE_CONFIGS.items()],
    frozen=True,
)


class PipelineConfig(_Members):  # type: ignore[misc]
    """The configs of all stages as members, each called as its stage."""

    @classmethod
    def from_settings(cls, settings: Mapping[str, Mapping[str, Any]]) -> PipelineConfig:
        """
        Make a config from ``{stage: {name: value}}``; what is not named keeps its default.

        ParameterError if a stage or name is unknown, or a value out of range.
        """
        for stage, values in settings.items():
            if stage not in STAGE_CONFIGS:
                raise ParameterError(f"there is no stage {stage!r}{nearest(stage, STAGE_CONFIGS)}")
            known = [member.name for member in fields(STAGE_CONFIGS[stage])]
            for name in values:
                if name not in known:
                    raise ParameterError(f"there is no parameter {stage}.{name}{nearest(name, known)}")
        return cls(**{stage: STAGE_CONFIGS[stage](**values) for stage, values in settings.items()})


def nearest(word: str, known: Collection[str]) -> str:
    """Suggest the nearest known name, or list them all."""
    near = get_close_matches(word, known, n=1)
    return f" (did you mean {near[0]}?)" if near else f" (there are {', '.join(known)})"
