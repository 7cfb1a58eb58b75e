"""True lengths: where a projection is not true to scale, what is compared is scaled alike."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.evaluation.readers.city_model import CityModel
from lidar_buildings.evaluation.readers.labelled_points import LabelledPoints
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons
from lidar_buildings.io.files.reference_systems import stated_unit, true_scale

_Side = TypeVar("_Side", LabelledPoints, MetricPolygons, CityModel)


def scale_of(side: LabelledPoints | MetricPolygons | CityModel) -> float:
    """Return the length on the ground, in its middle, of a metre of x and y; 1 where that is not known."""
    if isinstance(side, CityModel):
        of_parts = [
            part.vertices for one in side.buildings for parts in one.solids.values() for part in parts
        ]
        places = np.concatenate([np.empty((0, 3)), *of_parts])[:, :2]
    elif isinstance(side, MetricPolygons):
        places = shapely.get_coordinates(side.polygons)
    else:
        places = side.points[:, :2]
    unit = stated_unit(side.crs)
    if unit is None or not len(places):
        return 1.0
    return true_scale(side.crs, (places.min(axis=0) + places.max(axis=0)) / 2.0 / unit)


def scaled(side: _Side, scale: float) -> _Side:
    """Return a side of a comparison with x and y times a factor."""
    if scale == 1.0:
        return side
    factors = np.array([scale, scale, 1.0])
    if isinstance(side, CityModel):

        def stretched(part: Solid) -> Solid:
            return replace(part, vertices=part.vertices * factors)

        buildings = (
            replace(one, solids={lod: tuple(map(stretched, parts)) for lod, parts in one.solids.items()})
            for one in side.buildings
        )
        return replace(side, buildings=tuple(buildings))
    if isinstance(side, MetricPolygons):
        polygons: NDArray[np.object_] = shapely.transform(side.polygons, lambda xy: xy * scale)
        return replace(side, polygons=polygons, scale=scale)
    return replace(side, points=side.points * factors)
