"""
From roof points to outlines: this package's three stages, each timed, and what can be asked of an outline.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import rows_by_building
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary
from lidar_buildings.core.stages.regularisation.regularising import regularise_outline
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings
from lidar_buildings.pipeline.config import PipelineConfig

#: Columns of a tile that segmentation can be told.
SCAN_COLUMNS = ("gps_time", "point_source_id")
#: Steps whose time is taken.
STEPS = ("segmentation", "tracing", "regularisation")


class Building(NamedTuple):
    """A building on its way from points to an outline."""

    rows: NDArray[np.intp]  #: its points among the roof points
    #: Before and after regularisation [m].
    traced: Outline
    outline: Outline
    spacing: float  #: of its points, the geometric mean of that along and across the scan lines [m]
    #: Of the traced ring's points about the outline [m].
    sigma: float
    max_offset: float
    is_regular: bool  #: whether the outline is more than the traced one
    reason: str  #: why not, or what was out of the ordinary

    @property
    def polygon(self) -> shapely.Polygon:
        """The outline for scoring [m]."""
        return shapely.Polygon(self.outline.exterior, self.outline.holes)


class Chain(NamedTuple):
    """What the three stages made of roof points."""

    buildings: list[Building]  #: by rising building id
    seconds: dict[str, float]  #: wall time of each step

    @property
    def polygons(self) -> NDArray[Any]:
        """All outlines for scoring [m]."""
        return np.array([building.polygon for building in self.buildings], dtype=object)


def chain_of(roofs: PointTile, configs: PipelineConfig) -> Chain:
    """Run segmentation, tracing and regularisation on roof points, building after building."""
    seconds = dict.fromkeys(STEPS, 0.0)
    scan = {name: getattr(roofs, name) for name in SCAN_COLUMNS}
    found = _timed(
        seconds,
        "segmentation",
        segment_buildings,
        roofs.points,
        configs.segmentation,
        point_spacing=roofs.point_spacing,
        **scan,
    )
    buildings = []
    for number, rows in rows_by_building(found.building_id):
        traced = _timed(
            seconds,
            "tracing",
            trace_boundary,
            roofs.points[rows],
            configs.boundary_tracing,
            pattern=found.patterns[number],
            point_spacing=roofs.point_spacing,
        )
        regular = _timed(
            seconds, "regularisation", regularise_outline, traced.outline, configs.regularisation
        )
        buildings.append(
            Building(
                rows=rows,
                traced=traced.outline,
                outline=regular.outline,
                spacing=found.patterns[number].spacing,
                sigma=regular.sigma,
                max_offset=regular.max_offset,
                is_regular=regular.status is BuildingStatus.OK,
                reason=regular.reason or traced.reason,
            )
        )
    return Chain(buildings, seconds)


def variants(configs: PipelineConfig) -> dict[str, PipelineConfig]:
    """Return the configs to compare by name: the bias of lidar left and corrected, and another ring."""
    corrected = replace(configs.regularisation, correct_bias=True)
    return {
        "through the points": configs,
        "bias corrected": replace(configs, regularisation=corrected),
        "alpha shape": replace(
            configs, boundary_tracing=replace(configs.boundary_tracing, method="alpha_shape")
        ),
    }


def vertex_count(polygon: shapely.Polygon) -> int:
    """Count the vertices of all rings, without those that close them."""
    return int(shapely.get_num_coordinates(polygon)) - len(shapely.get_rings(polygon))


def _timed(
    seconds: dict[str, float], step: str, function: Callable[..., Any], *arguments: Any, **keywords: Any
) -> Any:
    """Call a function and add the time that it took to a step's."""
    start = time.perf_counter()
    result = function(*arguments, **keywords)
    seconds[step] += time.perf_counter() - start
    return result
