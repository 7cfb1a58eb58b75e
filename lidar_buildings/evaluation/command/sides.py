"""What the kinds of score share: the area of interest, and the one reference system."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons

#: A result's building points, and a reference's unless told otherwise.
BUILDING = (int(PointClass.BUILDING),)


def is_inside(points: NDArray[np.float64], area: MetricPolygons | None) -> NDArray[np.bool_]:
    """Whether each point lies within the area of interest."""
    if area is None:
        return np.ones(len(points), dtype=bool)
    limits = shapely.union_all(area.polygons)
    shapely.prepare(limits)
    return np.asarray(shapely.intersects_xy(limits, points[:, 0], points[:, 1]), dtype=bool)


def check_same_system(result: str, reference: str, area: MetricPolygons | None) -> None:
    """Refuse sides in different reference systems; one that does not say its own is trusted."""
    named = [crs for crs in (result, reference, "" if area is None else area.crs) if crs.startswith("EPSG:")]
    if len(set(named)) > 1:
        raise InputError(
            f"the result, the reference and the area of interest are in {', '.join(dict.fromkeys(named))}: "
            "bring them to one reference system"
        )
