"""The methods of the ground filter as the benchmarks call them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import Cloud
from lidar_buildings.core.model.parameters import spec_of
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.evaluation.scores.cells import RESULT_GROUND

#: The methods there are, the default one first; not the one for clouds without ground.
METHODS = tuple(
    name
    for field in fields(GroundFilterConfig)
    if field.name == "method"
    for name in spec_of(field).choices
    if name != "none"
)


def ground_mask(cloud: Cloud, method: str, settings: Mapping[str, Any] | None = None) -> NDArray[np.bool_]:
    """Return which points a method takes for ground, with the defaults but for `settings`."""
    config = GroundFilterConfig(**{**(settings or {}), "method": method})
    return np.isin(classify_ground(cloud.points, config, **cloud.scan).classification, RESULT_GROUND)
