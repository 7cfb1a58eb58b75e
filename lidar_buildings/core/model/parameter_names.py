"""How the members of configs are named as the parameters of a node."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import Field, fields
from typing import Any

from lidar_buildings.core.model.parameters import StageConfig, spec_of

#: Stands before the name of a parameter that few users turn.
ADVANCED = "advanced."


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
