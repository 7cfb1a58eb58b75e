"""
What a method could do at best: its main parameters tried one combination after another.

Three figures come of one table of errors (settings × clouds). *Optimised*: the best setting of each cloud,
which is how many papers report. *Best single*: the one setting with the least mean. *Left out*: each cloud
judged with the setting that is best on all the others, which is what a user without a reference could hope
for.
"""

from __future__ import annotations

import itertools
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import Cloud
from bench.ground.peers import own_filter
from bench.ground.scores import score_of
from lidar_buildings.core.stages.ground_filter import GroundFilterConfig

#: Method → its parameters that matter most → multiples of their defaults.
GRIDS: dict[str, dict[str, tuple[float, ...]]] = {
    "consensus": {
        "iteration_angle": (0.6, 1.0, 1.6),
        "profile_max_slope": (0.6, 1.0, 1.6),
        "opening_slope": (0.6, 1.0, 1.6),
        "ground_distance": (0.7, 1.0, 1.4),
    },
    "progressive_tin": {
        "seed_cell": (0.5, 1.0),
        "iteration_angle": (0.6, 1.0, 1.6),
        "iteration_distance": (0.7, 1.0, 1.4),
        "ground_distance": (0.7, 1.0, 1.4),
    },
    "bidirectional_slope": {
        "profile_max_slope": (0.6, 1.0, 1.6),
        "profile_max_object": (0.5, 1.0, 2.0),
        "profile_tolerance": (0.5, 1.0, 2.0),
    },
    "morphological": {
        "opening_radius": (0.5, 1.0, 2.0),
        "opening_slope": (0.6, 1.0, 1.6),
        "opening_distance": (0.7, 1.0, 1.4),
    },
}


class Optimum(NamedTuple):
    """Row numbers of settings: one per cloud, one for all, one per cloud chosen on the others."""

    per_cloud: NDArray[np.int64]
    single: int
    left_out: NDArray[np.int64]


def settings_grid(method: str) -> list[dict[str, Any]]:
    """Every combination; the defaults come first."""
    factors = GRIDS[method]
    defaults = {field.name: field.default for field in fields(GroundFilterConfig)}
    combinations = [
        {name: defaults[name] * factor for name, factor in zip(factors, chosen, strict=True)}
        for chosen in itertools.product(*factors.values())
    ]
    return sorted(combinations, key=lambda combination: any(combination[n] != defaults[n] for n in factors))


def errors_of(method: str, settings: list[dict[str, Any]], clouds: list[Cloud]) -> NDArray[np.float64]:
    """Total error, one row per setting and one column per cloud."""
    return np.array(
        [[score_of(own_filter(method, chosen), cloud).total_error for cloud in clouds] for chosen in settings]
    )


def optimum_of(errors: NDArray[np.float64]) -> Optimum:
    """Choose the settings; of equally good ones the first."""
    n_clouds = errors.shape[1]
    left_out = [np.delete(errors, column, axis=1).mean(axis=1).argmin() for column in range(n_clouds)]
    return Optimum(errors.argmin(axis=0), int(errors.mean(axis=1).argmin()), np.array(left_out))
